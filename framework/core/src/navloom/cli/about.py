"""`navloom --version`, and the other options before a command."""

from __future__ import annotations

import os
from typing import Annotated

import typer

from navloom.entry_kinds import TRACE_HOOKS
from navloom.installed import print_versions

__all__ = ["about"]


def about(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", help="Print the versions of navloom, Python and plugin distributions.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="With --version: print JSON.")] = False,
    trace_hooks: Annotated[
        bool, typer.Option("--trace-hooks", help="Print every call of a plugin's hook to standard error.")
    ] = False,
) -> None:
    """Plugin-based navigation for mobile robots."""
    if trace_hooks:
        os.environ[TRACE_HOOKS] = "1"  # child processes inherit it
    if version:
        print_versions(as_json)
        raise typer.Exit()
    if as_json:
        command = context.invoked_subcommand or "COMMAND"
        raise typer.BadParameter(f"--json comes after the command: navloom {command} … --json")
    if context.invoked_subcommand is None:
        raise typer.BadParameter("expected a command; `navloom --help` lists them")

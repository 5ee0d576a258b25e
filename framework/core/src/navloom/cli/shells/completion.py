"""`navloom completion`: scripts that let a shell complete commands, options and values."""

from __future__ import annotations

from typing import Annotated

import typer

__all__ = ["completion"]


def completion(
    context: typer.Context, shell: Annotated[str, typer.Argument(metavar="SHELL", help="bash, zsh or fish.")]
) -> None:
    """Print a completion script for bash, zsh or fish.

    It completes commands, options, configs, plugins, worlds and robots.

    Save it where the shell looks for it: bash, ~/.local/share/bash-completion/completions/navloom; zsh, a file _navloom
    in a folder of $fpath; fish, ~/.config/fish/completions/navloom.fish. Save it again after an upgrade.
    """
    from navloom.cli.shells.scripts import SCRIPTS
    from navloom.cli.shells.tree import commands

    if shell not in SCRIPTS:
        raise typer.BadParameter(f"shell {shell!r}: expected {', '.join(SCRIPTS)}")
    typer.echo(SCRIPTS[shell](commands(context.find_root().command)), nl=False)

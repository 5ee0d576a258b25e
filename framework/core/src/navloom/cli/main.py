"""`navloom`: options before a command, the command, and errors as one message and an exit code."""

from __future__ import annotations

import contextlib
import errno
import logging
import os
import sys
from typing import Annotated

import typer

from navloom.cli import distribution_commands
from navloom.cli.command import App
from navloom.cli.tracebacks import with_traceback
from navloom.entry_kinds import TRACE_HOOKS
from navloom.errors import NavloomError
from navloom.installed import print_versions
from navloom.logs import Level, set_up_logging

__all__ = ["app", "main"]


def _about(
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


app = App(
    cls=distribution_commands.Commands,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
app.callback(invoke_without_command=True)(_about)


FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO}
"""Error numbers of a full disk or an exhausted quota."""


def main() -> None:
    """Entry point. Exit codes: 0 done, 1 the run ended otherwise or something failed, 2 the request was wrong."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed by the parent process: nothing reads it
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115
    try:
        _run()
    except KeyboardInterrupt as error:
        _say("interrupted", error)
        sys.exit(1)
    except BrokenPipeError:
        sys.exit(1)
    except Exception as error:
        code = _exit_code(error)
        if code is not None:
            _say(_words(error), error)
            sys.exit(code)
        internal = f"internal error, please report it: {type(error).__name__}: {error} ({_place(error)})"
        _say(distribution_commands.blamed(error) or internal, error)
        sys.exit(1)


def _run() -> None:
    """Run the command and flush its output, so that a full disk fails here and not when Python exits."""
    try:
        app(prog_name="navloom")  # also of `python -m navloom`: completion scripts ask for this name
    finally:
        try:
            sys.stdout.flush()
        except OSError:
            with contextlib.suppress(OSError):
                sys.stdout.close()
            sys.stdout = open(os.devnull, "w")  # noqa: SIM115
            raise


def _exit_code(error: Exception) -> int | None:
    """1 or 2 for an error that is meant for the user; None for an unexpected one."""
    if isinstance(error, NavloomError):
        return error.exit_code
    if isinstance(error, OSError):
        return 1 if error.errno in FULL else 2
    return None


def _words(error: Exception) -> str:
    """The message of an error; for an OSError, the file and the text without its number."""
    if isinstance(error, OSError) and error.strerror:
        where = error.filename or ("standard output or a temporary file" if error.errno in FULL else "")
        return f"{where}: {error.strerror}" if where else error.strerror
    return str(error)


def _place(error: Exception) -> str:
    """File and line an error came from."""
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    return "unknown place" if trace is None else f"{trace.tb_frame.f_code.co_filename}:{trace.tb_lineno}"


def _say(text: str, error: BaseException) -> None:
    if not logging.getLogger("navloom").handlers:  # the command has not begun
        set_up_logging(Level.INFO, as_json=False)
    logging.getLogger("navloom.cli").error(text, extra=with_traceback(error))

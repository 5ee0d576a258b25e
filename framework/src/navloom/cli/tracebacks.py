"""`--traceback`, which every command takes: the whole traceback below the one message of an error."""

from __future__ import annotations

import os
import sys
from functools import cache
from typing import Annotated, Any

import typer

from navloom.entry_kinds import TRACEBACK

__all__ = ["accept_traceback", "tell_traceback", "tell_traceback_of"]


def accept_traceback(command: Any) -> Any:
    """Give a command the option, and all commands in it where it is a group."""
    if not any(one.name == "traceback" for one in command.params):
        command.params.append(_option())
    for inner in getattr(command, "commands", {}).values():
        accept_traceback(inner)
    return command


@cache
def _option() -> Any:
    """The option, as typer makes it."""
    around = typer.Typer(add_completion=False)

    @around.command()
    def only(
        traceback: Annotated[
            bool,
            typer.Option(
                "--traceback",
                help="Print the whole traceback below the message of an error.",
                callback=_ask,
                expose_value=False,
            ),
        ] = False,
    ) -> None: ...

    return next(one for one in typer.main.get_command(around).params if one.name == "traceback")


def _ask(given: bool) -> None:
    if given:
        os.environ[TRACEBACK] = "1"  # what the command starts inherits it


def tell_traceback(error: BaseException) -> None:
    """Print the traceback of an error that ended the command, if it was asked for."""
    if os.environ.get(TRACEBACK):
        from navloom.plugins.blame import traceback_of, whole_traceback

        print(traceback_of(str(error)) or whole_traceback(error), file=sys.stderr, end="")


def tell_traceback_of(message: str) -> None:
    """Print the traceback behind a message that was printed, if it was asked for."""
    if os.environ.get(TRACEBACK):
        from navloom.plugins.blame import traceback_of

        print(traceback_of(message), file=sys.stderr, end="", flush=True)

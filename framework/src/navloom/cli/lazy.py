"""Commands that the help lists by name and one line; their modules are imported on first use."""

from __future__ import annotations

from typing import Any

import typer
from typer.core import TyperCommand

from navloom.cli.command import App, with_groups_within

__all__ = ["LazyCommand", "made_by_typer"]


class LazyCommand(TyperCommand):
    """A command, or a group of commands, that is imported and made when it is used."""

    def made(self) -> Any:
        """The real command, with its options."""
        raise NotImplementedError

    def make_context(self, info_name: Any, args: Any, parent: Any = None, **extra: Any) -> Any:
        """Make the real command and create its context."""
        return self.made().make_context(info_name, args, parent=parent, **extra)


def made_by_typer(name: str, given: Any, **settings: Any) -> Any:
    """The command or group that typer makes of a function or a Typer app.

    Args:
        name: Name of the command, typed after `navloom`.
        given: Its function or its app.
        settings: Further settings of a function's command, as `Typer.command` takes them.
    """
    around = App(add_completion=False, rich_markup_mode=None)
    around.callback()(lambda: None)  # with it, typer makes a group even of one command
    if isinstance(given, typer.Typer):
        around.add_typer(with_groups_within(given), name=name)
    else:
        around.command(name, **settings)(given)
    made: Any = typer.main.get_command(around)
    return made.commands[name]

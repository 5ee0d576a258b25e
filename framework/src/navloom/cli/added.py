"""Commands that distributions add: listed from their metadata, imported on first use."""

from __future__ import annotations

from functools import cached_property
from typing import Any, ClassVar

from typer.core import TyperGroup

from navloom.cli.built_in import BUILT_IN, BuiltInCommand
from navloom.cli.lazy import LazyCommand, made_by_typer
from navloom.entry_kinds import CommandPoint, added_commands

__all__ = ["Commands", "blamed"]


class Commands(TyperGroup):
    """The commands of navloom, then those of entry points `command.NAME` whose names navloom does not use itself."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.commands.update((entry.name, BuiltInCommand(entry)) for entry in BUILT_IN)

    def list_commands(self, ctx: Any) -> list[str]:
        """Names in the order of the help."""
        return [*super().list_commands(ctx), *self._added]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """A command by its name."""
        return super().get_command(ctx, cmd_name) or self._added.get(cmd_name)

    def whole(self) -> dict[str, Any]:
        """Every command, imported, with its options. A broken one of a distribution appears as in the help."""
        own = {entry.name: BuiltInCommand(entry).made() for entry in BUILT_IN}
        return own | {name: command.made_or_listed() for name, command in self._added.items()}

    @cached_property
    def _added(self) -> dict[str, AddedCommand]:
        return {point.name: AddedCommand(point) for point in added_commands() if point.name not in self.commands}


class AddedCommand(LazyCommand):
    """A distribution's command: the help shows the distribution's summary; the module is imported when it is used."""

    used: ClassVar[CommandPoint | None] = None
    """The added command that this process runs; None if it runs none."""

    def __init__(self, point: CommandPoint) -> None:
        super().__init__(point.name, help=point.summary or f"Of {point.distribution}.")
        self._point = point

    def made(self) -> Any:
        """The command that its module registers. Raises PluginError."""
        from navloom.plugins import Discovery, PluginError
        from navloom.plugins.blame import raised_in

        name = str(self.name)
        given = Discovery().command(name)
        try:
            return made_by_typer(name, given)
        except Exception as error:  # typer raises many kinds for annotations that no option can have
            raise PluginError(
                f"command {name!r}: typer cannot make a command of it: {raised_in(error, given)}"
            ) from error

    def made_or_listed(self) -> Any:
        """The real command, or this one if it is broken."""
        from navloom.plugins import PluginError

        try:
            return self.made()
        except PluginError:
            return self

    def make_context(self, info_name: Any, args: Any, parent: Any = None, **extra: Any) -> Any:
        """Make the real command and create its context; from then on, unexpected errors are blamed on it."""
        made = self.made()
        AddedCommand.used = self._point
        return made.make_context(info_name, args, parent=parent, **extra)


def blamed(error: Exception) -> str:
    """The distribution and line of an unexpected exception; empty if no distribution's command ran."""
    point = AddedCommand.used
    if point is None:
        return ""
    from navloom.plugins.blame import raised_in
    from navloom.plugins.loading import module_of

    return f"command.{point.name} of {point.distribution} failed: {raised_in(error, module_of(point))}"

"""Commands that distributions add: listed by their metadata alone, and imported when they are used."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import typer
from typer.core import TyperCommand, TyperGroup

from navloom.entry_kinds import installed_points, is_any_of

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

__all__ = ["Commands", "blamed"]

KIND = "command"


class Commands(TyperGroup):
    """The commands of navloom, then those of entry points `command.NAME` whose names navloom does not have itself."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Names in the order of the help."""
        return [*super().list_commands(ctx), *self._added]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """A command by its name."""
        return super().get_command(ctx, cmd_name) or self._added.get(cmd_name)

    @cached_property
    def _added(self) -> dict[str, AddedCommand]:
        points = installed_points() if is_any_of(KIND) else ()
        named = {point.name.partition(".")[2]: point for point in points if point.name.startswith(f"{KIND}.")}
        return {name: AddedCommand(name, named[name]) for name in sorted(named) if name not in self.commands}


class AddedCommand(TyperCommand):
    """A distribution's command: to the help its name and the distribution's summary, else what its module registers."""

    used: ClassVar[EntryPoint | None] = None
    """The one that this process runs."""

    def __init__(self, name: str, point: EntryPoint) -> None:
        super().__init__(name, help=_summary(point) or f"Of {point.value}.")
        self._point = point

    def make_context(self, info_name: Any, args: Any, parent: Any = None, **extra: Any) -> Any:
        """Import it: the context is of the real command."""
        from navloom.plugins import Discovery, PluginError
        from navloom.plugins.blame import raised_in

        name = str(self.name)
        given = Discovery().command(name)
        AddedCommand.used = self._point
        around = typer.Typer(add_completion=False, rich_markup_mode=None)
        around.callback()(lambda: None)
        try:
            if isinstance(given, typer.Typer):
                around.add_typer(given, name=name)
            else:
                around.command(name)(given)
            made: Any = typer.main.get_command(around)
        except Exception as error:  # typer's own of many kinds, of annotations that no option can have
            raise PluginError(
                f"command {name!r}: typer cannot make a command of it: {raised_in(error, given)}"
            ) from error
        return made.commands[name].make_context(info_name, args, parent=parent, **extra)


def _summary(point: EntryPoint) -> str:
    """What the distribution says of itself in one line; empty where its metadata is damaged."""
    try:
        found = None if point.dist is None else point.dist.metadata["Summary"]
    except Exception:  # of many kinds, by version of Python
        return ""
    return str(found or "")


def blamed(error: Exception) -> str:
    """Whose command raised what nobody expected, and where; empty where no distribution's command ran."""
    point = AddedCommand.used
    if point is None:
        return ""
    from navloom.plugins.blame import raised_in
    from navloom.plugins.loading import module_of, owner_of

    return f"{point.name} of {owner_of(point)} failed: {raised_in(error, module_of(point))}"

"""The commands of every distribution, navloom's own among them: listed from metadata, imported on first use."""

from __future__ import annotations

from functools import cached_property
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, ClassVar

import typer
from typer.core import TyperCommand, TyperGroup

from navloom.cli.command import App, with_groups_within
from navloom.entry_kinds import GROUP, CommandPoint, added_commands
from navloom.misspelt import close_to
from navloom.parts import OF_FRAMEWORK

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

__all__ = ["AddedCommand", "Commands", "blamed"]


class Commands(TyperGroup):
    """The commands of the entry points `command.NAME`."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Names in the order of the help."""
        return [*super().list_commands(ctx), *self._added]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """A command by its name. Raises MissingPartError for one of a part that is not installed."""
        found = super().get_command(ctx, cmd_name) or self._added.get(cmd_name)
        if found is None:
            from navloom.parts import MissingPartError
            from navloom.plugins.shipped_plugins import distribution_of

            if distribution := distribution_of(f"command.{cmd_name}"):
                raise MissingPartError(
                    f"`navloom {cmd_name}` is a command of {distribution}, which is not installed: "
                    f"pip install {distribution}"
                )
        return found

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """The command of the first word. Refuses an unknown one with a suggestion; typer's own knows none of ours."""
        name, *rest = args
        if not name.startswith("-") and self.get_command(ctx, name) is None:
            if name == "help":
                ctx.fail(f"No such command 'help'. Write `navloom {' '.join([*rest[:1], '--help'])}`.")
            ctx.fail(f"No such command {name!r}{close_to(name, self.list_commands(ctx)) or '.'}")
        return super().resolve_command(ctx, args)

    def whole(self) -> dict[str, Any]:
        """Every command, imported, with its options. A broken one appears as in the help."""
        return {name: command.made_or_listed() for name, command in self._added.items()}

    @cached_property
    def _added(self) -> dict[str, AddedCommand]:
        points: dict[str, list[CommandPoint]] = {}
        for point in added_commands():  # navloom's own first
            of_one_name = points.setdefault(point.name, [])
            if not of_one_name or of_one_name[0].distribution not in OF_FRAMEWORK:
                of_one_name.append(point)
        return {name: AddedCommand(of_one_name) for name, of_one_name in points.items()}


class AddedCommand(TyperCommand):
    """A command, or a group of commands, that is imported and made when it is used.

    Args:
        points: The entry points of its name; with more than one it is refused when it is used.
    """

    used: ClassVar[CommandPoint | None] = None
    """The command that this process runs; None if it runs none."""

    def __init__(self, points: list[CommandPoint]) -> None:
        self._points = points
        super().__init__(points[0].name, help=points[0].summary or f"Of {points[0].distribution}.")

    def made(self) -> Any:
        """The command that its module registers. Raises PluginError."""
        from navloom.plugins import Discovery, PluginError
        from navloom.plugins.error_origin import raised_in

        name = str(self.name)
        given = Discovery(found=map(_entry_point, self._points)).command(name)
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
        AddedCommand.used = self._points[0]
        return made.make_context(info_name, args, parent=parent, **extra)


def made_by_typer(name: str, given: Any) -> Any:
    """The command or group that typer makes of a function or a Typer app.

    Args:
        name: Name of the command, typed after `navloom`.
        given: Its function or its app.
    """
    around = App(add_completion=False, rich_markup_mode=None)
    around.callback()(lambda: None)  # with it, typer makes a group even of one command
    if isinstance(given, typer.Typer):
        around.add_typer(with_groups_within(given), name=name)
    else:
        around.command(name, **getattr(given, "typer_settings", {}))(given)
    made: Any = typer.main.get_command(around)
    return made.commands[name]


def blamed(error: Exception) -> str:
    """The distribution and line of an unexpected exception; empty if no other distribution's command ran."""
    point = AddedCommand.used
    if point is None or point.distribution in OF_FRAMEWORK:
        return ""
    from navloom.plugins.error_origin import raised_in
    from navloom.plugins.loading import module_of

    return f"command.{point.name} of {point.distribution} failed: {raised_in(error, module_of(point))}"


def _entry_point(point: CommandPoint) -> EntryPoint:
    from importlib.metadata import EntryPoint  # the help needs none, and the import takes 30 ms

    made = EntryPoint(f"command.{point.name}", point.value, GROUP)
    vars(made).update(dist=SimpleNamespace(name=point.distribution, version=point.version))
    return made

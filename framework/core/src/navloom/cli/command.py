"""Turns functions into commands: option groups, the options of every command, and help in sections."""

from __future__ import annotations

import difflib
import functools
import inspect
import itertools
import os
from collections.abc import Callable, Iterator
from dataclasses import MISSING, dataclass, fields, is_dataclass
from typing import Annotated, Any, TypeVar, get_type_hints

import typer
from typer.core import TyperCommand

from navloom.cli.completion import proposing_names
from navloom.entry_kinds import TRACEBACK
from navloom.logs import Level, set_up_logging

__all__ = ["App", "EveryCommand", "SectionedCommand", "made_with", "with_groups", "with_groups_within"]

F = TypeVar("F", bound=Callable[..., Any])
SECTION = "Every command"


def made_with(**settings: Any) -> Callable[[F], F]:
    """Give a command further settings, as `typer.Typer.command` takes them."""

    def mark(command: F) -> F:
        command.typer_settings = settings  # type: ignore[attr-defined]
        return command

    return mark


@dataclass(frozen=True)
class EveryCommand:
    """Options of every command. Each field is an option of all commands; `begin` applies them."""

    log_level: Annotated[
        Level,
        typer.Option(
            "--log-level",
            metavar="LEVEL",
            help="Lowest level logged to standard error: debug, info, warning or error.",
            rich_help_panel=SECTION,
        ),
    ] = Level.INFO
    log_json: Annotated[
        bool,
        typer.Option("--log-json", help="Log to standard error as JSON, one object per line.", rich_help_panel=SECTION),
    ] = False

    traceback: Annotated[
        bool,
        typer.Option(
            "--traceback", help="Print the whole traceback below the message of an error.", rich_help_panel=SECTION
        ),
    ] = False

    def begin(self) -> None:
        """Apply the options before the command runs."""
        if self.traceback:
            os.environ[TRACEBACK] = "1"  # child processes inherit it
        set_up_logging(self.log_level, self.log_json)


class SectionedCommand(TyperCommand):
    """A command whose help lists its options in sections, by their `rich_help_panel`."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Refuse unknown options also where `ignore_unknown_options` lets negative numbers be arguments."""
        if ctx.ignore_unknown_options:
            known = [name for param in self.get_params(ctx) for name in (*param.opts, *param.secondary_opts)]
            for word in itertools.takewhile(lambda word: word != "--", args):
                name = word.partition("=")[0]
                if name.startswith("--") and name not in known:
                    near = " or ".join(difflib.get_close_matches(name, known))
                    raise typer.BadParameter(f"no option {name}" + (f"; did you mean {near}?" if near else ""), ctx=ctx)
        return super().parse_args(ctx, args)

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write the arguments, the command's own options, then those of each group."""
        sections: dict[str, list[tuple[str, str]]] = {"Arguments": [], "Options": []}
        for param in self.get_params(ctx):
            if (record := param.get_help_record(ctx)) is not None:
                own = "Arguments" if param.param_type_name == "argument" else "Options"
                sections.setdefault(getattr(param, "rich_help_panel", None) or own, []).append(record)
        for name, records in sections.items():
            if records:
                with formatter.section(name):
                    formatter.write_dl(records)


class App(typer.Typer):
    """Typer app whose functions may take option groups, and whose commands have the options of every command."""

    def command(
        self, name: str | None = None, *, cls: type[TyperCommand] | None = None, **settings: Any
    ) -> Callable[[F], F]:
        """Register a command as typer does, with its option groups expanded."""
        register = super().command(name, cls=cls or SectionedCommand, **settings)

        def registered(function: F) -> F:
            register(with_groups(function))
            return function

        return registered


def with_groups(function: Callable[..., Any]) -> Callable[..., Any]:
    """Wrap a function for typer: each parameter whose type is a dataclass of options is replaced by those options.

    The options of every command follow, except those that the function already has.
    """
    parameters = inspect.signature(function, eval_str=True).parameters
    groups: dict[str, Any] = {
        name: parameter.annotation for name, parameter in parameters.items() if is_dataclass(parameter.annotation)
    }
    options = (option for name, parameter in parameters.items() for option in _options(groups.get(name), parameter))
    spelled = list(map(proposing_names, options))
    own = {one.name for one in spelled}
    every = [parameter for parameter in _fields_of(EveryCommand) if parameter.name not in own]

    @functools.wraps(function)
    def called(**given: Any) -> Any:
        EveryCommand(**{one.name: given.pop(one.name) for one in every}).begin()
        for name, group in groups.items():
            given[name] = group(**{field.name: given.pop(field.name) for field in fields(group)})
        return function(**given)

    called.__signature__ = inspect.Signature([*spelled, *every])  # type: ignore[attr-defined]
    called.__annotations__ = {one.name: one.annotation for one in (*spelled, *every)}
    return called


def with_groups_within(app: typer.Typer) -> typer.Typer:
    """Apply `with_groups` to every command of a distribution's app."""
    for command in app.registered_commands:
        if command.callback is not None and not isinstance(app, App):
            command.callback = with_groups(command.callback)
    for group in app.registered_groups:
        if group.typer_instance is not None:
            with_groups_within(group.typer_instance)
    return app


def _options(group: Any, parameter: inspect.Parameter) -> Iterator[inspect.Parameter]:
    if group is None:
        yield parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY)
    else:
        yield from _fields_of(group)


@functools.cache
def _fields_of(group: Any) -> tuple[inspect.Parameter, ...]:
    """The fields of a dataclass of options, as function parameters."""
    hints = get_type_hints(group, include_extras=True)
    return tuple(
        inspect.Parameter(
            field.name,
            inspect.Parameter.KEYWORD_ONLY,
            default=inspect.Parameter.empty if field.default is MISSING else field.default,
            annotation=hints[field.name],
        )
        for field in fields(group)
    )

"""Parameter changes during a run, by events and by operators."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from navloom.config import ConfigError, check_params
from navloom.config.schema import Config
from navloom.config.tables import EventTable
from navloom.engine.system import System
from navloom.inputs.texts import toml_of

__all__ = ["blamed_on_event", "changed_params", "set_events"]


def changed_params(system: System, role: str, instance: str, assignments: tuple[str, ...]) -> Any:
    """An instance's parameters with some changed. Raises ConfigError that names a value that does not fit."""
    part = system.parts[(role, instance)]
    current = part.params if part.plugin is None else part.plugin.params
    values = {**current.model_dump(exclude_unset=True), **toml_of("\n".join(assignments), "parameters", ConfigError)}
    return check_params(part.cls.Params, values, role if part.place == role else f"{role}.{instance}")


def set_events(config: Config) -> Iterator[tuple[int, EventTable, tuple[str, str]]]:
    """Each event that changes parameters: its number, the event, and (role, instance)."""
    for number, event in enumerate(config.event):
        if event.do == "set":
            role = event.role or ""
            yield number, event, (role, event.name or config.role_table(role).instance)


@contextmanager
def blamed_on_event(number: int) -> Iterator[None]:
    """Add the event's place in the config to a ConfigError."""
    try:
        yield
    except ConfigError as error:
        raise ConfigError(*(f"event.{number}.values: {problem}" for problem in error.problems)) from None

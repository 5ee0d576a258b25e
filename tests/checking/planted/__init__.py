"""Plugins with one fault each, and the check that must catch it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, TypeVar

from navloom import Registry, hookimpl

T = TypeVar("T")


@dataclass(frozen=True)
class Entry:
    """Target of the entry point of a planted plugin.

    Attributes:
        kind, name: Kind and name of the plugin.
        thing: The class or function that is registered.
        caught_by: The check that must catch it; empty for a sound plugin.
    """

    kind: str
    name: str
    thing: Any
    caught_by: str

    @hookimpl
    def navloom_register(self, registry: Registry) -> None:
        if self.kind == "world":
            registry.world(self.name, self.thing)
        elif self.kind == "scheme":
            registry.world_scheme(self.name, self.thing)
        elif self.kind in ("metric", "panel", "message", "node"):
            getattr(registry, self.kind)(self.thing)
        else:
            registry.add(self.thing)


class Entries(SimpleNamespace):
    """The entries of one module, by name."""

    def plant(self, name: str, caught_by: str = "", kind: str = "") -> Callable[[T], T]:
        """Declare a plugin."""

        def declare(thing: T) -> T:
            role = kind or getattr(thing, "role", "")
            if isinstance(thing, type) and role not in ("message", "metric", "panel"):
                thing.name = name  # type: ignore[attr-defined]
            setattr(self, name, Entry(role, name, thing, caught_by))
            return thing

        return declare

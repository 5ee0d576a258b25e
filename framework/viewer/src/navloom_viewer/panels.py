"""Viewer panels: how messages of one type are drawn. Plugins register theirs like the built-in ones."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from navloom.messages import Message, Pose2D
from navloom.plugins import Discovery, PluginError
from numpy.typing import NDArray

if TYPE_CHECKING:
    from navloom_viewer.picture_setup import Actor, Variant

__all__ = ["Change", "Drawn", "Panel", "Seen", "panels_of"]

Drawn = Iterable[tuple[str, Any]]
"""Pairs of entity path and rerun archetype, or archetype in a `Change`."""


@dataclass(frozen=True, eq=False)
class Change:
    """A drawing that is sent only if its key differs from the last one of the same path: a state, a log line."""

    key: str
    archetype: Any


@dataclass(frozen=True, eq=False)
class Seen:
    """Context for drawing a message.

    Attributes:
        actor: The robot or shadow that published it, with `name`, `colour` and `is_shadow`.
        robot: The robot it belongs to, with `footprint`, `height`, `goal` and `sweep_rule`.
        role, instance, port: The stream that it was published on.
        pose: Newest estimate of base in the map frame, or None before the first one.
        track: (n, 4) recent poses: run clock, s, increasing; x, y, m; heading, rad. At least one row after the first
            pose.
        is_alone: Whether this is the only robot in the picture, so that colours may distinguish objects, not robots.
        time: Run clock, s.
        stripe: Index of the robot and number of robots: each draws its share of a line that several may have in common.
    """

    actor: Actor
    robot: Variant
    role: str
    instance: str
    port: str
    pose: Pose2D | None
    track: NDArray[np.float64]
    is_alone: bool
    time: float
    stripe: tuple[int, int] = (0, 1)

    def lane(self, name: str) -> str:
        """Entity path of a lane of the state timeline, as `goal`."""
        return self.actor.lane(name, self.is_alone)

    def in_map(self, name: str) -> str:
        """Entity path of an object in the map frame, as `plan`."""
        return f"/run/{self.actor.name}/{name}"

    def in_base(self, name: str) -> str:
        """Entity path of an object in the base frame, as `sonars`; it moves with the robot."""
        return f"/run/{self.actor.name}/base/{name}"


@dataclass(frozen=True)
class Panel:
    """How the messages of one type are drawn.

    Attributes:
        name: Its name: lower case letters, digits and _.
        message: The type of message, or a base class of several types.
        to_rerun: Pure function that gives entity paths and rerun archetypes. For paths use `Seen.in_map` and
            `Seen.in_base`.
        max_hz: Largest rate of drawn messages for each stream, in robot time, Hz.
        view: Makes a `rerun.blueprint` view for drawings outside the 3D view; None for none.
    """

    name: str
    message: type[Message]
    to_rerun: Callable[[Any, Seen], Drawn]
    max_hz: float = 10.0
    view: Callable[[], Any] | None = None


def panels_of(discovery: Discovery) -> tuple[Sequence[Panel], list[str]]:
    """The panels of plugins, in order of name, and a message for each unusable one; these do not stop a run."""
    panels: list[Panel] = []
    wrong: list[str] = []
    for name in discovery.names("panel"):
        try:
            panel = discovery.panel(name)
        except PluginError as error:
            wrong.append(str(error))
            continue
        if isinstance(panel, Panel):
            panels.append(panel)
        else:
            wrong.append(f"panel.{name} is a {type(panel).__name__}, expected a navloom_viewer.Panel")
    return panels, wrong

"""What a viewer panel is: how one type of message becomes a picture. Plugins add theirs by the same door."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from navloom.messages import Message, Pose2D
from navloom.plugins import Discovery, PluginError

if TYPE_CHECKING:
    from navloom.viewer.facts import Actor, Variant

__all__ = ["Change", "Drawn", "Panel", "Seen", "panels_of"]

Drawn = Iterable[tuple[str, Any]]
"""Entity paths and rerun archetypes, or such in a `Change`."""


@dataclass(frozen=True, eq=False)
class Change:
    """Something that is drawn only where its key is not that of the last one of the same path: a state, a log line."""

    key: str
    archetype: Any


@dataclass(frozen=True, eq=False)
class Seen:
    """What is known when a message is drawn.

    Attributes:
        actor: Whose message it is: a robot, or one of its shadow instances; has `name`, `colour` and `is_shadow`.
        robot: The robot it belongs to: `footprint`, `height`, `goal`, `sweep_rule`.
        role, instance, port: Where it was published.
        pose: Newest estimate of base in the map frame, or None before the first.
        track: (n, 4) recent poses: run clock, s, x, y, m, heading, rad, rising; at least one row once there is a pose.
        is_alone: No other robot is in the picture, so that colours may tell things apart instead of robots.
        time: Run clock, s.
        stripe: Which of how many robots: each draws its share of a line that others may have at the same place.
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
        """Entity path of something in the map frame, as `plan`."""
        return f"/run/{self.actor.name}/{name}"

    def in_base(self, name: str) -> str:
        """Entity path of something in the base frame of the robot, as `sonars`: it moves with the robot."""
        return f"/run/{self.actor.name}/base/{name}"


@dataclass(frozen=True)
class Panel:
    """How the messages of one type are drawn.

    Attributes:
        name: By which it is asked for; lower case letters, digits and _.
        message: The type, or a base class of the types.
        to_rerun: Pure: gives entity paths and rerun archetypes. Paths as of `Seen.in_map` and `Seen.in_base`.
        max_hz: More messages a second of robot time than this are left out, of each stream on its own.
        view: Makes a `rerun.blueprint` view for what it draws outside the 3D view; None where there is none.
    """

    name: str
    message: type[Message]
    to_rerun: Callable[[Any, Seen], Drawn]
    max_hz: float = 10.0
    view: Callable[[], Any] | None = None


def panels_of(discovery: Discovery) -> tuple[Sequence[Panel], list[str]]:
    """The panels of plugins, in order of name, and what is wrong with those that cannot be used: none stops a run."""
    found: list[Panel] = []
    wrong: list[str] = []
    for name in discovery.names("panel"):
        try:
            panel = discovery.panel(name)
        except PluginError as error:
            wrong.append(str(error))
            continue
        if isinstance(panel, Panel):
            found.append(panel)
        else:
            wrong.append(f"panel.{name} is a {type(panel).__name__}, expected a navloom.viewer.Panel")
    return found, wrong

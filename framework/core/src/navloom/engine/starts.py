"""The start pose that a robot believes in, the true one of a simulated robot, and whether its localizers can search."""

from __future__ import annotations

import math
from typing import Any

from navloom.config import ConfigError
from navloom.config.schema import Config
from navloom.config.tables import OffsetTable, PlaceTable
from navloom.engine.system import System
from navloom.geometry.world import Place, World
from navloom.messages import Pose2D
from navloom.plugins import Discovery, PluginError
from navloom.roles import ANYWHERE, Localizer

__all__ = ["check_search", "searching_localizers", "starts_of"]

ORIGIN = Pose2D(0.0, 0.0, 0.0)
Sigma = tuple[float, float]


def starts_of(config: Config, world: World | None) -> tuple[Pose2D, Sigma | None, Pose2D]:
    """The start that the robot believes in, its standard deviations, see `Context.start_sigma`, and the true start.

    Raises:
        ConfigError: The start is unknown, and nothing says where the simulated robot truly stands.
    """
    given, table = config.navigation.start, config.world
    authored = None if world is None or world.start is None else _pose(world.start)
    sigma: Sigma | None = None
    if given == "unknown":
        # Plugins that place a grid at the start, such as mappers, get one that does not depend on the truth.
        told, sigma, true = ORIGIN, ANYWHERE, authored
    else:
        # A real robot without a map begins at the origin of the map that it makes.
        told = true = (authored or ORIGIN) if given is None else _pose(given)
        sigma = None if given is None else given.sigma
    if table is not None and table.start is not None:
        true = _pose(table.start)
    if true is None and world is not None:
        raise ConfigError(
            f'navigation.start: is "unknown", and the world {world.name} has no start: say where the simulated robot '
            "truly stands, as in [world] start = { x = 1.0, y = 2.0, heading_deg = 90.0 }"
        )
    return told, sigma, _moved(true or told, OffsetTable() if table is None else table.start_offset)


def _pose(place: PlaceTable | Place) -> Pose2D:
    if isinstance(place, Place):
        return Pose2D(place.x, place.y, place.heading)
    return Pose2D(place.x, place.y, math.radians(math.remainder(place.heading_deg or 0.0, 360.0)))


def _moved(pose: Pose2D, offset: OffsetTable) -> Pose2D:
    heading = math.remainder(pose.heading + math.radians(offset.heading_deg), math.tau)
    return Pose2D(pose.x + offset.x, pose.y + offset.y, heading)


def check_search(system: System, discovery: Discovery) -> None:
    """Refuse a start or an event for which a localizer has to search, if it cannot.

    Raises:
        ConfigError: One line for each such place, with the localizers that can.
    """
    parts = [part for part in system.parts.values() if part.role == "localizer"]
    assert all(issubclass(part.cls, Localizer) for part in parts)
    unable = [part for part in parts if not part.cls.can_search]  # type: ignore[attr-defined]
    asks = []
    if system.start_sigma is not None and unable:
        asks.append(f"navigation.start: is {'unknown' if system.start_sigma == ANYWHERE else 'a guess'}")
    if len(unable) == len(parts):
        asks += [
            f'event.{number}.do: "{event.do}"{" with a spread" if event.do == "place" else ""} makes the robot search'
            for number, event in enumerate(system.config.event)
            if event.do == "relocalise" or (event.do == "place" and event.sigma is not None)
        ]
    if asks:
        able = " or ".join(f'"{name}"' for name in searching_localizers(discovery))
        fix = f"take one that can, as localizer.plugin = {able}" if able else "no installed localizer can"
        raise ConfigError(*(f"{ask}, and {_names(unable)} cannot search for it: {fix}" for ask in asks))


def _names(parts: list[Any]) -> str:
    return " and ".join(f"{part.role} {part.table.instance}" for part in parts)


def searching_localizers(discovery: Discovery) -> list[str]:
    """Names of the installed localizers that can search."""
    found = []
    for name in discovery.names("localizer"):
        try:
            cls = discovery.role("localizer", name)
        except PluginError:  # a broken plugin is no fix; `navloom plugins` tells about it
            continue
        if getattr(cls, "can_search", False):
            found.append(name)
    return found

"""World scheme `floor:SEED`: storeys of buildings for tests of localisation, with rooms that look alike."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from navloom.geometry.world import Box, Obstacle, Place, Raster, World
from navloom.worlds import WorldError, options_of, seed_of

from navloom_maps.floor_plan import CELL, LEAST_SIZE, FloorPlan, Room, most_corridors, plan_floor
from navloom_maps.furniture import Glass, furnish, glaze, solids_of
from navloom_maps.option_values import share_of

__all__ = ["DEVELOPMENT_SEEDS", "TEST_SEEDS", "Floor", "floor_of", "floor_world", "lookalikes"]

DEVELOPMENT_SEEDS = range(100)
"""Seeds for developing and tuning a method."""
TEST_SEEDS = range(1000, 1100)
"""Seeds for measuring a method that is finished. Do not look at their pictures while developing."""
_MOST_SIZE = 200.0
"""Largest width or height of a storey, m."""
_BEHIND_DOOR = 0.8
"""Distance of start and goal from the doors of their rooms, m: what stays free of furniture."""
_DEFAULTS = {
    "size": "30x20", "corridors": "", "lookalike": "0.2", "furniture": "0.3", "unmapped": "0.3", "glass": "0",
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Floor:
    """A storey with its truth.

    Attributes:
        world: The world.
        rooms: Its rooms. Those of equal `alike` look alike: they are the same in the frame of their `door`.
    """

    world: World
    rooms: tuple[Room, ...]

    def room_at(self, x: float, y: float) -> Room | None:
        """The room that contains a place, m, map frame; None for corridors, doorways and walls."""
        column, row = math.floor(x / CELL), math.floor(y / CELL)
        for room in self.rooms:
            c0, c1, r0, r1 = room.inside
            if c0 <= column < c1 and r0 <= row < r1:
                return room
        return None


def floor_world(argument: str, base: Path) -> World:
    """World scheme `floor:SEED`, with options as `?size=30x20&lookalike=0.2`. See `floor_of`; no file is read."""
    return floor_of(argument).world


def floor_of(argument: str) -> Floor:
    """A storey by its seed and options, the text after `floor:`.

    Options:
        size: Width x height, m.
        corridors: Number of long corridors; default: one to about 10 m of height.
        lookalike: Share of rooms, from 0 to 1, that copy the shape and furniture of an earlier room, where one fits.
        furniture: Density of the furniture, from 0, none, to 1: hardly a further piece fits that a robot of 0.5 m width
            gets round.
        unmapped: Share of the furniture, from 0 to 1, that is not on the map. Of a chair, the map shows the legs.
        glass: Share of the walls between rooms and corridors, from 0 to 1, that is glass. Posts beside doors stay.

    Raises:
        WorldError: The seed or an option is not valid.
    """
    reference = f"floor:{argument}"
    name, options = options_of(argument, _DEFAULTS)
    seed = seed_of("floor", name)
    width, height = _size(reference, options["size"])
    corridors = _corridors(reference, options["corridors"], height) if options["corridors"] else None
    shares = {key: share_of(reference, key, options[key]) for key in ("lookalike", "furniture", "unmapped", "glass")}
    # Streams of their own: another density of furniture or glass must not change the walls.
    walls, furniture, glass = (np.random.default_rng((seed, number)).random for number in range(3))
    plan = plan_floor(walls, width, height, corridors, shares["lookalike"])
    alike: dict[int, list[Room]] = {}
    for room in plan.rooms:
        alike.setdefault(room.alike, []).append(room)
    groups = list(alike.values())
    solids: list[Obstacle] = []
    for rooms in groups:
        pieces = furnish(furniture, rooms[0].shape, shares["furniture"], shares["unmapped"])
        for room in rooms:
            solids += solids_of(room, pieces)
    for rooms, panes in zip(groups, glaze(glass, groups, shares["glass"]), strict=True):
        for room in rooms:
            solids += _panes(plan, room, panes)
    start, goal = _task(plan)
    raster = Raster("wall", plan.occupied, CELL)
    bounds = (0.0, 0.0, width * CELL, height * CELL)
    return Floor(World(reference, tuple(solids), raster, start, goal, bounds), plan.rooms)


def _panes(plan: FloorPlan, room: Room, panes: list[Glass]) -> Iterator[Box]:
    """The panes of a room as boxes, in place of the wall."""
    for number, pane in enumerate(panes, start=1):
        c0, c1, r0, r1 = room.cells((-room.wall, 0), (pane.first, pane.last))
        plan.occupied[r0:r1, c0:c1] = False
        x, y = (c0 * CELL, c1 * CELL), (r0 * CELL, r1 * CELL)
        yield Box(f"glass {number} of room {room.number}", x, y, material="glass")


def lookalikes(floor: Floor, pose: Place) -> tuple[Place, ...]:
    """The other poses of a storey from which its look-alike rooms appear the same, but for what is seen through doors.

    Args:
        floor: The storey.
        pose: A pose in a room, map frame.

    Returns:
        One pose for each other room of the same shape and furniture; none for a pose that is in no room.
    """
    room = floor.room_at(pose.x, pose.y)
    if room is None:
        return ()
    others = [other for other in floor.rooms if other.alike == room.alike and other is not room]
    return tuple(_moved(pose, room, other) for other in others)


def _moved(pose: Place, room: Room, other: Room) -> Place:
    """A pose, moved with its room's door to another one's: the rooms are turned by half a turn, or not at all."""
    turned = room.up != other.up
    sign = -1.0 if turned else 1.0
    x = other.door.x + sign * (pose.x - room.door.x)
    y = other.door.y + sign * (pose.y - room.door.y)
    heading = math.remainder(pose.heading + (math.pi if turned else 0.0), math.tau)
    return Place(x, y, heading)


def _task(plan: FloorPlan) -> tuple[Place, Place]:
    """Start and goal behind the doors that are farthest from each other along x and y; the start faces its door."""

    def ends(slope: int) -> tuple[int, Room, Room]:
        along = {room.number: room.column + slope * room.row for room in plan.rooms}
        first, *_, last = sorted(plan.rooms, key=lambda room: along[room.number])
        return along[last.number] - along[first.number], first, last

    # The greatest distance along x and y together is that along one of the two diagonals.
    _, first, second = max(ends(1), ends(-1), key=lambda pair: pair[0])
    (x, y), (goal_x, goal_y) = _behind_door(first), _behind_door(second)
    return Place(x, y, -first.door.heading), Place(goal_x, goal_y)


def _behind_door(room: Room) -> tuple[float, float]:
    return room.door.x, room.door.y + (_BEHIND_DOOR if room.up else -_BEHIND_DOOR)


def _size(reference: str, text: str) -> tuple[int, int]:
    """Width and height of an option, cells."""
    found = re.fullmatch(r"(\d{1,3}(?:\.\d{1,3})?)x(\d{1,3}(?:\.\d{1,3})?)", text, re.ASCII)
    sides = [float(side) for side in found.groups()] if found else []
    if not sides or not all(least <= side <= _MOST_SIZE for least, side in zip(LEAST_SIZE, sides, strict=True)):
        raise WorldError(
            f"{reference}: size={text}: expected width x height from {LEAST_SIZE[0]:g}x{LEAST_SIZE[1]:g} to "
            f"{_MOST_SIZE:g}x{_MOST_SIZE:g} m, as in size=30x20"
        )
    width, height = (round(side / CELL) for side in sides)
    return width, height


def _corridors(reference: str, text: str, height: int) -> int:
    most = most_corridors(height)
    if not (text.isascii() and text.isdigit() and len(text) <= 3 and 1 <= int(text) <= most):
        raise WorldError(f"{reference}: corridors={text}: expected a number from 1 to {most} for this size")
    return int(text)

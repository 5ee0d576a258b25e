"""Plans of building storeys: rooms on both sides of long corridors, from a seed.

All lengths are whole cells of `CELL`, and every choice is a comparison of draws in [0, 1): the same seed gives the same
storey, bit for bit, on every machine.

Corridors run along x. The rows of rooms beside them are cut by cross corridors, which join two corridors or end at the
outer wall. A room is described in the frame of its door, so that a look-alike room is the same shape at another door.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from navloom.geometry.world import Place
from numpy.typing import NDArray

__all__ = ["CELL", "LEAST_SIZE", "Draw", "FloorPlan", "Room", "Shape", "most_corridors", "plan_floor"]

CELL = 0.05
"""Edge of a cell, m."""
LEAST_SIZE = (12.0, 9.0)
"""Least width and height of a storey, m."""
_OUTER = 4
"""Thickness of the outer wall, cells."""
_WALLS = (2, 4)
"""Thinnest and thickest inner wall, cells: 0.1 to 0.2 m."""
_CORRIDOR = (32, 48)
"""Narrowest and widest corridor, cells: 1.6 to 2.4 m."""
_ROOM = (54, 150)
"""Least and largest width of a room that is drawn, cells: 2.7 to 7.5 m."""
_LEAST_DEPTH = 54
"""Least depth of a room, cells."""
_BAND = 210
"""Height of a storey for each corridor, cells: a corridor with a row of rooms on either side."""
_DOORS = (18, 24)
"""Narrowest and widest door, cells, both even: 0.9 to 1.2 m."""
_JAMB = 4
"""Least wall beside a door, cells."""
_CROSS_EVERY = 800
"""Length of a corridor for each further cross corridor, cells."""

Draw = Callable[[], float]
"""Gives the next draw in [0, 1)."""


@dataclass(frozen=True)
class Shape:
    """A room's outline in the frame of its door: origin in the door's middle on the room's side, x into the room.

    Attributes:
        left, right: From the middle of the door to the walls on either side, cells.
        depth: Depth of the room, cells.
        door: Width of the door, cells, even.
    """

    left: int
    right: int
    depth: int
    door: int


@dataclass(frozen=True)
class Room:
    """A room of a storey.

    Attributes:
        number: Its number, from 0.
        alike: Number of the first room of the same shape and furniture; its own if it copies none.
        shape: Its outline.
        column, row: Cell corner of the door's middle on the room's side.
        up: The room lies above its corridor, so its door is entered along y; otherwise against y.
        wall: Thickness of the wall between room and corridor, cells.
    """

    number: int
    alike: int
    shape: Shape
    column: int
    row: int
    up: bool
    wall: int

    @property
    def door(self) -> Place:
        """Frame of the door: middle of the doorway on the room's side, heading into the room; m, map frame."""
        return Place(CELL * self.column, CELL * self.row, math.copysign(0.5 * math.pi, 1 if self.up else -1))

    def cells(self, x: tuple[int, int], y: tuple[int, int]) -> tuple[int, int, int, int]:
        """First and last + 1 column, then row, of a rectangle in the door's frame, cells."""
        if self.up:
            return self.column - y[1], self.column - y[0], self.row + x[0], self.row + x[1]
        return self.column + y[0], self.column + y[1], self.row - x[1], self.row - x[0]

    def place(self, x: float, y: float) -> tuple[float, float]:
        """A place in the door's frame, cells, in m, map frame."""
        if self.up:
            return CELL * (self.column - y), CELL * (self.row + x)
        return CELL * (self.column + y), CELL * (self.row - x)

    @property
    def inside(self) -> tuple[int, int, int, int]:
        """First and last + 1 column, then row, of the room within its walls."""
        shape = self.shape
        return self.cells((0, shape.depth), (-shape.right, shape.left))


@dataclass(frozen=True, eq=False)
class FloorPlan:
    """A storey without furniture and glass.

    Attributes:
        occupied: (rows, cols) bool; row 0 is the lowest y.
        rooms: Its rooms.
    """

    occupied: NDArray[np.bool_]
    rooms: tuple[Room, ...]


def most_corridors(height: int) -> int:
    """Most corridors for which a storey of this height, cells, has room."""
    # Each with two rows of rooms and, at the most, the walls beside them.
    return max(1, (height - 2 * _OUTER) // (_CORRIDOR[1] + 3 * _WALLS[1] + 2 * _LEAST_DEPTH + 16))


def plan_floor(draw: Draw, width: int, height: int, corridors: int | None, lookalike: float) -> FloorPlan:
    """Draw a storey.

    Args:
        draw: Draws in [0, 1).
        width, height: Size along x and y, cells.
        corridors: Number of corridors along x; None for one to about 10 m of height.
        lookalike: Probability that a room copies an earlier one that fits.
    """
    count = corridors or min(max(1, round(height / _BAND)), most_corridors(height))
    occupied = np.ones((height, width), dtype=np.bool_)
    aisles, rows = _levels(draw, height, count)
    for low, high in aisles:
        occupied[low:high, _OUTER : width - _OUTER] = False
    rooms: list[Room] = []
    for region in range(count + 1):
        cuts = _cuts(draw, width, is_inner=0 < region < count)
        # The lower row of a region belongs to the corridor below it, the upper row to the one above.
        low = aisles[region - 1][1] if region else _OUTER
        high = aisles[region][0] if region < count else height - _OUTER
        for first, last in cuts:
            occupied[low:high, first:last] = False
        for row in rows[region]:
            for segment in _between(draw, cuts, width):
                rooms += _rooms(draw, segment, row, rooms, lookalike)
    for room in rooms:
        _carve(occupied, room)
    return FloorPlan(occupied, tuple(rooms))


@dataclass(frozen=True)
class _Row:
    """A row of rooms: the cell row at which they begin on the side of the corridor, and what they share."""

    at: int
    up: bool
    depth: int
    wall: int


def _between_of(draw: Draw, ends: tuple[int, int]) -> int:
    """A whole number from the first to the last of `ends`."""
    return ends[0] + int(draw() * (ends[1] - ends[0] + 1))


def _levels(draw: Draw, height: int, count: int) -> tuple[list[tuple[int, int]], list[list[_Row]]]:
    """Lowest and highest + 1 cell row of each corridor, and the rows of rooms below, between and above them."""
    widths = [_between_of(draw, _CORRIDOR) for _ in range(count)]
    walls = [(_between_of(draw, _WALLS), _between_of(draw, _WALLS)) for _ in range(count)]
    backs = [_between_of(draw, _WALLS) for _ in range(count - 1)]
    depth = (height - 2 * _OUTER - sum(widths) - sum(map(sum, walls)) - sum(backs)) // (2 * count)
    # Two depths only, so that many rooms of a storey may look alike.
    more = int(draw() * min(0.3 * depth, depth - _LEAST_DEPTH + 1))
    aisles: list[tuple[int, int]] = []
    rows: list[list[_Row]] = [[] for _ in range(count + 1)]
    at = _OUTER
    for number in range(count):
        below, above = (depth + more, depth - more) if draw() < 0.5 else (depth - more, depth + more)
        low = at + below + walls[number][0]
        high = low + widths[number]
        aisles.append((low, high))
        rows[number].append(_Row(low - walls[number][0], False, below, walls[number][0]))
        rows[number + 1].append(_Row(high + walls[number][1], True, above, walls[number][1]))
        at = high + walls[number][1] + above + (backs[number] if number + 1 < count else 0)
    return aisles, rows


def _cuts(draw: Draw, width: int, is_inner: bool) -> list[tuple[int, int]]:
    """First and last + 1 column of the cross corridors of a region, by x; an outer region's are dead ends."""
    count = 1 + int(draw() * (1.0 + width / _CROSS_EVERY)) if is_inner else int(draw() * (1.0 + width / _CROSS_EVERY))
    cuts = []
    for number in range(count):
        # One in each of `count` equal parts, so that rooms fit between them.
        part = (width - 2 * _OUTER) // count
        wide = _between_of(draw, _CORRIDOR)
        free = max(part - wide, 1)
        first = _OUTER + number * part + int((0.1 + 0.8 * draw()) * free)
        cuts.append((first, first + wide))
    return cuts


def _between(draw: Draw, cuts: list[tuple[int, int]], width: int) -> Iterator[tuple[int, int]]:
    """First and last + 1 column of what rooms and their walls fill between outer walls and cross corridors."""
    begin = _OUTER
    for first, last in cuts:
        yield begin, first - _between_of(draw, _WALLS)
        begin = last + _between_of(draw, _WALLS)
    yield begin, width - _OUTER


def _rooms(draw: Draw, segment: tuple[int, int], row: _Row, others: list[Room], lookalike: float) -> list[Room]:
    """The rooms of a segment, from its lowest column up. What is too narrow for a room stays solid, as a shaft."""
    made: list[Room] = []
    begin, end = segment
    while end - begin >= _ROOM[0]:
        left = end - begin
        fits = [r for r in (*others, *made) if r.shape.depth == row.depth and r.shape.left + r.shape.right <= left]
        is_copy, pick = draw() < lookalike, draw()
        number = len(others) + len(made)
        if is_copy and fits:
            twin = fits[int(pick * len(fits))]
            shape, alike = twin.shape, twin.alike
        else:
            shape, alike = _shape(draw, left, row), number
        middle = begin + (shape.left if row.up else shape.right)
        made.append(Room(number, alike, shape, middle, row.at, row.up, row.wall))
        begin += shape.left + shape.right + _between_of(draw, _WALLS)
    return made


def _shape(draw: Draw, left: int, row: _Row) -> Shape:
    """A new room within the `left` cells of its segment."""
    wide = min(_between_of(draw, _ROOM), left)
    if left - wide < _ROOM[0] + _WALLS[1]:
        # The rest is too narrow for a room: it belongs to this one.
        wide = left
    door = 2 * _between_of(draw, (_DOORS[0] // 2, _DOORS[1] // 2))
    margin = _JAMB + door // 2
    to_left = margin + int(draw() * (wide - 2 * margin + 1))
    return Shape(to_left, wide - to_left, row.depth, door)


def _carve(occupied: NDArray[np.bool_], room: Room) -> None:
    half = room.shape.door // 2
    for c0, c1, r0, r1 in (room.inside, room.cells((-room.wall, 0), (-half, half))):
        occupied[r0:r1, c0:c1] = False

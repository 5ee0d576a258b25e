"""Furniture and glass walls of the rooms of a storey.

A piece stands flush with a wall or free. From every other piece, and from every wall that it does not touch, it is at
least `_GAP` away, so a robot of 0.5 m width gets round all of them, whatever was drawn.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

from navloom.geometry.world import Box, Cylinder, Obstacle

from navloom_maps.floor_plan import CELL, Draw, Room, Shape

__all__ = ["ENTRY", "Glass", "Piece", "furnish", "glaze", "solids_of"]

ENTRY = 26
"""Depth of what stays free behind each door, cells."""
_BESIDE_DOOR = 2
"""What stays free on either side of a door, cells."""
_GAP = 17
"""Least gap between two pieces, cells: 0.85 m."""
_POST = 2
"""Wall that stays at either end of a pane of glass, cells."""
_LEAST_PANE = 8
"""Shortest pane, cells."""
_TRIES = 2
"""Tries for each m² of a room at a density of 1."""
_TABLE_TOP, _SEAT = (0.72, 0.76), (0.42, 0.46)
"""Height intervals, m."""
_LEG, _CHAIR_LEG = 0.03, 0.02
"""Radii, m."""
_CHAIR = 9
"""Edge of a chair, cells."""

Rectangle = tuple[int, int, int, int]
"""First and last + 1 cell along x and y of a door's frame."""


@dataclass(frozen=True)
class Piece:
    """A piece of furniture in the frame of its room's door.

    Attributes:
        kind: "shelf", "cabinet", "table" or "chair".
        area: What it covers, cells.
        is_mapped: The map shows it.
    """

    kind: str
    area: Rectangle
    is_mapped: bool = True


@dataclass(frozen=True)
class Glass:
    """A pane in the wall between a room and its corridor: first and last + 1 cell along y of the door's frame."""

    first: int
    last: int


def furnish(draw: Draw, shape: Shape, density: float, unmapped: float) -> list[Piece]:
    """Draw the furniture of a room.

    Args:
        draw: Draws in [0, 1).
        shape: The room.
        density: From 0, none, to 1: hardly a further piece fits.
        unmapped: Probability that a piece and what stands with it are not on the map.
    """
    free = (0, ENTRY, -shape.door // 2 - _BESIDE_DOOR, shape.door // 2 + _BESIDE_DOOR)
    pieces: list[Piece] = []
    taken: list[Rectangle] = []
    for _ in range(round(density * _TRIES * shape.depth * (shape.left + shape.right) * CELL**2)):
        # All draws before the test: a piece that does not fit must not shift the draws of the next.
        kind, wide, where, side = draw(), draw(), draw(), int(4.0 * draw())
        group, is_mapped = _group(kind, wide), draw() >= unmapped
        area, place = _placed(group.size, shape, side, where, is_free=kind >= _FREE_STANDING, across=draw())
        if _meets(area, free) or any(_meets(_grown(area), other) for other in taken) or not _fits(area, shape):
            continue
        taken.append(area)
        pieces += (replace(piece, area=place(piece.area), is_mapped=is_mapped) for piece in group.pieces)
    return pieces


_FREE_STANDING = 0.75
"""Draw from which a group stands free."""


@dataclass(frozen=True)
class _Group:
    """Pieces that stand together: `size` along the wall and away from it, cells, with areas in these coordinates."""

    size: tuple[int, int]
    pieces: tuple[Piece, ...]


def _group(kind: float, wide: float) -> _Group:
    """A group by two draws. Coordinates are x along the wall and y away from it."""
    if kind < 0.25:
        return _single("shelf", 16 + int(wide * 25), 8)
    if kind < 0.5:
        return _single("cabinet", 10 + int(wide * 9), 10)
    if kind < _FREE_STANDING:
        along, deep = 24 + int(wide * 9), 14
        chair = (along // 2 - 4, along // 2 - 4 + _CHAIR, deep + 1, deep + 1 + _CHAIR)
        desk = Piece("table", (0, along, 0, deep))
        return _Group((along, deep + 1 + _CHAIR), (desk, Piece("chair", chair)))
    if kind < 0.9:
        return _table_with_chairs(24 + int(wide * 17), 16)
    return _Group((_CHAIR, _CHAIR), (Piece("chair", (0, _CHAIR, 0, _CHAIR)),))


def _single(kind: str, along: int, deep: int) -> _Group:
    return _Group((along, deep), (Piece(kind, (0, along, 0, deep), True),))


def _table_with_chairs(along: int, deep: int) -> _Group:
    """A table with two chairs on either long side."""
    low = _CHAIR + 1
    chairs = [
        Piece("chair", (x, x + _CHAIR, y, y + _CHAIR)) for x in (2, along - 2 - _CHAIR) for y in (0, low + deep + 1)
    ]
    return _Group((along, deep + 2 * low), (Piece("table", (0, along, low, low + deep)), *chairs))


def _placed(
    size: tuple[int, int], shape: Shape, side: int, where: float, *, is_free: bool, across: float
) -> tuple[Rectangle, Callable[[Rectangle], Rectangle]]:
    """Area of a group in the door's frame, and the function that moves its pieces there.

    Args:
        size: Along the wall and away from it, cells.
        shape: The room.
        side: Wall that it stands at: 0 that of the door, 1 opposite, 2 right, 3 left.
        where: Share of the free length along the wall before it.
        is_free: It stands away from the wall, by the share `across` of the room between the least gaps.
        across: See there.
    """
    is_lengthwise = side >= 2  # along x of the door's frame, which points into the room
    along, deep = (shape.depth, shape.left + shape.right)[:: 1 if is_lengthwise else -1]
    off = _GAP + int(across * max(deep - size[1] - 2 * _GAP + 1, 0)) if is_free else 0
    begin = (_GAP if is_free else 0) + int(where * max(along - size[0] - (2 * _GAP if is_free else 0) + 1, 0))

    def place(area: Rectangle) -> Rectangle:
        a0, a1, b0, b1 = area[0] + begin, area[1] + begin, area[2] + off, area[3] + off
        if side % 2:
            # From the opposite wall.
            b0, b1 = deep - b1, deep - b0
        x, y = ((a0, a1), (b0, b1)) if is_lengthwise else ((b0, b1), (a0, a1))
        return x[0], x[1], y[0] - shape.right, y[1] - shape.right

    return place((0, size[0], 0, size[1])), place


def _meets(area: Rectangle, other: Rectangle) -> bool:
    return area[0] < other[1] and other[0] < area[1] and area[2] < other[3] and other[2] < area[3]


def _grown(area: Rectangle) -> Rectangle:
    return area[0] - _GAP, area[1] + _GAP, area[2] - _GAP, area[3] + _GAP


def _fits(area: Rectangle, shape: Shape) -> bool:
    """Whether it is inside, and from each pair of opposite walls either the one or the other is a gap away."""
    before = (area[0], area[2] + shape.right)
    behind = (shape.depth - area[1], shape.left - area[3])
    return min(*before, *behind) >= 0 and all(max(ends) >= _GAP for ends in zip(before, behind, strict=True))


def glaze(draw: Draw, groups: list[list[Room]], share: float) -> list[list[Glass]]:
    """Panes of the rooms of each group of look-alikes, so that a share of all walls to corridors is glass.

    Panes are whole walls beside doors, but for posts at their ends, of groups in a drawn order; the last is shorter.
    """
    shapes = [rooms[0].shape for rooms in groups]
    walls = sum(len(rooms) * (s.left + s.right - s.door) for rooms, s in zip(groups, shapes, strict=True))
    left = share * walls
    order = sorted(range(len(groups)), key=[draw() for _ in groups].__getitem__)
    panes: list[list[Glass]] = [[] for _ in groups]
    for number in order:
        shape, count = shapes[number], len(groups[number])
        half = shape.door // 2
        for first, last in ((half + _POST, shape.left - _POST), (_POST - shape.right, -half - _POST)):
            last = min(last, first + int(left / count))
            if last - first >= _LEAST_PANE:
                panes[number].append(Glass(first, last))
                left -= count * (last - first)
    return panes


def solids_of(room: Room, pieces: list[Piece]) -> Iterator[Obstacle]:
    """The boxes and cylinders of a room's furniture, m, map frame, with names that say which room it is in."""
    for number, piece in enumerate(pieces, start=1):
        name = f"{piece.kind} {number} of room {room.number}"
        x0, x1, y0, y1 = piece.area
        if piece.kind in ("table", "chair"):
            is_table = piece.kind == "table"
            span, radius = (_TABLE_TOP, _LEG) if is_table else (_SEAT, _CHAIR_LEG)
            inset = 1.0 if is_table else 0.5
            # A map of lasers shows the legs of a chair, and a robot of 0.5 m width does not fit between them.
            yield _box(room, name, replace(piece, is_mapped=piece.is_mapped and is_table), span)
            legs = ((x, y) for x in (x0 + inset, x1 - inset) for y in (y0 + inset, y1 - inset))
            for leg, (x, y) in enumerate(legs, start=1):
                at = room.place(x, y)
                yield Cylinder(f"{name}, leg {leg}", *at, radius, (0.0, span[0]), is_mapped=piece.is_mapped)
        else:
            yield _box(room, name, piece, (0.0, 1.8 if piece.kind == "shelf" else 1.1))


def _box(room: Room, name: str, piece: Piece, z: tuple[float, float]) -> Box:
    c0, c1, r0, r1 = room.cells(piece.area[:2], piece.area[2:])
    return Box(name, (c0 * CELL, c1 * CELL), (r0 * CELL, r1 * CELL), z, is_mapped=piece.is_mapped)

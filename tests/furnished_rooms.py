"""Rooms with furniture that is not on the map: a pallet closes the planned way, and another way stays open.

`room(seed)` gives the text of a world file. The map of such a world has the walls; what is not on it appears shortly
after the start.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field

import numpy as np
from navloom_astar.grids import RasterMap
from navloom_astar.planning import Found, GridPlanner, Settings
from numpy.typing import NDArray

__all__ = ["room"]

Rect = tuple[float, float, float, float]
"""Lowest x, highest x, lowest y, highest y, m."""

THICK = 0.15
CELL = 0.05
PLANNED = 0.35
"""Radius for which the mapped way is planned, m: half the width of the robot, and some room."""
PASSABLE = 0.5
"""Radius of a disc that fits through the furnished room on another way, m: the robot can turn everywhere on it."""
LATE = 0.05


@dataclass
class _Room:
    """A room under construction: its size, m, what is on the map and what is not."""

    width: float
    depth: float
    walls: list[Rect] = field(default_factory=list)
    furniture: list[Rect] = field(default_factory=list)

    def way(
        self, start: tuple[float, float], goal: tuple[float, float], radius: float, furnished: bool
    ) -> Found | None:
        """The shortest way of a disc."""
        cells = np.zeros((round(self.depth / CELL), round(self.width / CELL)), np.int8)
        for left, right, low, high in self.walls + (self.furniture if furnished else []):
            rows, columns = (slice(round(a / CELL), round(b / CELL)) for a, b in ((low, high), (left, right)))
            cells[rows, columns] = 100
        planner = GridPlanner(Settings(source="cells", inflation="metres", radius=radius, escape=0.0), None)
        found = planner.plan(start, goal, np.empty((0, 4)), RasterMap(cells, CELL, (0.0, 0.0, 0.0)))
        return found if isinstance(found, Found) else None


def room(seed: int) -> str:
    """Text of a world of 8 × 8 to 11 × 11 m: two or three rooms in a row, two or three doors between neighbours."""
    rng = np.random.default_rng(seed)
    while True:
        made = _attempt(rng)
        if made is not None:
            return made


def _attempt(rng: np.random.Generator) -> str | None:
    width, depth = (0.5 * float(rng.integers(16, 23)) for _ in range(2))
    made = _Room(width, depth)
    made.walls += [(0.0, THICK, 0.0, depth), (width - THICK, width, 0.0, depth), (0.0, width, 0.0, THICK),
                   (0.0, width, depth - THICK, depth)]  # fmt: skip
    rows = 1 if depth < 9.5 or rng.random() < 0.5 else 2
    doors = [_divide(made, depth * (row + 1) / (rows + 1), rng) for row in range(rows)]
    start, goal = ((float(rng.uniform(0.8, width - 0.8)), y) for y in (0.8, depth - 0.8))
    planned = made.way(start, goal, PLANNED, furnished=False)
    if planned is None:
        return None
    closed = [next((d for d in row if _passes(planned.points, d)), None) for row in doors]
    closing = int(rng.integers(len(closed)))
    if closed[closing] is None:
        return None
    left, right, low, high = closed[closing]
    deep = float(rng.uniform(0.1, 0.3))
    made.furniture.append((left, right, low - deep, high + deep))
    for _ in range(int(rng.integers(2, 6))):
        _furnish(made, start, goal, rng)
    if made.way(start, goal, PASSABLE, furnished=True) is None:
        return None
    return _text(made, start, goal)


def _divide(made: _Room, y: float, rng: np.random.Generator) -> list[Rect]:
    """Add a wall across the room at y, m, and return its doors."""
    count = 2 if made.width < 9.5 or rng.random() < 0.5 else 3
    part = (made.width - 2 * THICK) / count
    doors = []
    for number in range(count):
        wide = float(rng.uniform(1.1, 1.6))
        left = THICK + number * part + float(rng.uniform(0.3, part - wide - 0.3))
        doors.append((left, left + wide, y - 0.5 * THICK, y + 0.5 * THICK))
    ends = [0.0, *itertools.chain.from_iterable(door[:2] for door in doors), made.width]
    made.walls += [(a, b, y - 0.5 * THICK, y + 0.5 * THICK) for a, b in zip(ends[::2], ends[1::2], strict=True)]
    return doors


def _passes(points: NDArray[np.float64], door: Rect) -> bool:
    left, right, low, high = door
    return bool(((left < points[:, 0]) & (points[:, 0] < right) & (low < points[:, 1]) & (points[:, 1] < high)).any())


def _furnish(made: _Room, start: tuple[float, float], goal: tuple[float, float], rng: np.random.Generator) -> None:
    """Add a box that is not on the map, unless it is near the start or the goal."""
    wide, deep = (float(rng.uniform(0.3, 1.2)) for _ in range(2))
    x, y = float(rng.uniform(0.2, made.width - wide - 0.2)), float(rng.uniform(0.2, made.depth - deep - 0.2))
    is_near = (x - 1.0 < place[0] < x + wide + 1.0 and y - 1.0 < place[1] < y + deep + 1.0 for place in (start, goal))
    if not any(is_near):
        made.furniture.append((x, x + wide, y, y + deep))


def _text(made: _Room, start: tuple[float, float], goal: tuple[float, float]) -> str:
    lines = [
        f"bounds = [0.0, 0.0, {made.width}, {made.depth}]",
        f"start = {{ x = {start[0]:.3f}, y = {start[1]:.3f}, heading_deg = 90.0 }}",
        f"goal = {{ x = {goal[0]:.3f}, y = {goal[1]:.3f} }}",
        "goal_tolerance = 0.3",
    ]
    named = [("wall", wall, "") for wall in made.walls]
    named += [("box", rect, f"appears_at = {LATE}") for rect in made.furniture]
    for number, (name, (left, right, low, high), late) in enumerate(named):
        lines += ["", "[[box]]", f'name = "{name} {number}"']
        lines += [f"x = [{left:.3f}, {right:.3f}]", f"y = [{low:.3f}, {high:.3f}]", late]
    return "\n".join(lines)

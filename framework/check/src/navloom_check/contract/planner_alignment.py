"""Whether the path and the traversable grid of a planner are aligned with the map, not shifted by part of a cell."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from navloom.geometry.cells import cells_at, has_cells
from navloom.geometry.frames import inverse, transform
from navloom.geometry.polylines import Polyline
from navloom.geometry.world import Place
from navloom.messages import OccupancyGrid, Path, PlanRequest, Pose2D
from numpy.typing import NDArray

from navloom_check.behaviour.measurements import Maker, Unfit
from navloom_check.behaviour.obstacle_scene import Scene
from navloom_check.check_bench import Bench, alike
from navloom_check.checks import check
from navloom_check.findings import Finding, NotRun

__all__ = ["CHECKS"]

Floats = NDArray[np.float64]

CELL = 0.05
"""Edge of a cell of the maps, m."""
SIDE = 4.0
"""Half the side of the maps, m."""
HALVES = (0.4, 0.5, 0.65)
"""Half the sides of the blocks that the paths lead round, m."""
ENDS = 2.0
"""Distance of start and goal from the middle of the block, m: a multiple of every usual cell."""
OFF = 0.3
"""Least shift that is a fault, in cells of the answer."""
SPREAD = 0.2
"""How far the shifts at blocks of different size may differ, in cells; those of a sampling planner differ more."""
STEP = 0.002
"""Distance of the points of a path that are looked at, m."""


@check("contract", {"planner"}, "Path and traversable grid are aligned with the map, not shifted by part of a cell.")
def centred(bench: Bench) -> Iterator[Finding]:
    """A path round a block keeps the same distance on all four sides of it."""
    bench.sound()
    make = Maker(bench.subject.thing, bench.subject.params, bench.seed)
    with alike():
        try:
            rooms = [[_room(make, half, turns) for turns in range(4)] for half in HALVES]
        except Unfit as error:
            raise NotRun(str(error)) from None
    cells = {path[2] for room in rooms for path in room}
    for number, what in ((0, "path"), (1, "traversable grid")):
        gaps = np.array([[side[number] for side in room] for room in rooms])
        if np.isnan(gaps).any() or len(cells) != 1:
            continue
        shifts = np.stack([gaps[:, 3] - gaps[:, 1], gaps[:, 0] - gaps[:, 2]], axis=1) / 2.0
        for axis, values in zip("xy", (shifts / max(cells)).T, strict=True):
            if np.ptp(values) <= SPREAD and float(np.abs(values).min()) >= OFF:
                yield Finding(
                    f"gives a {what} that is shifted by {float(np.median(values)):.2f} cells along {axis}",
                    "the middle of a cell at (column + 0.5, row + 0.5) * resolution from the grid's origin, and that "
                    "origin at the lower left corner of cell (0, 0)",
                    given=f"a block of {2.0 * HALVES[0]:g} m and its map turned by 0°, 90°, 180° and 270°",
                )  # fmt: skip
                return


def _room(make: Maker, half: float, turns: int) -> tuple[float, float, float]:
    """Gaps between a block and the path that leads past one side of it, and the nearest free cell there, m; cell, m.

    The block is in the middle of the map, and a wall leads from its opposite side to the border.

    Raises:
        Unfit: The planner finds no path.
    """
    turn = np.array([0.0, 0.0, 0.5 * math.pi * turns])
    middles = -SIDE + (np.arange(round(2.0 * SIDE / CELL)) + 0.5) * CELL
    places = np.stack(np.meshgrid(middles, middles), axis=-1)
    x, y = np.moveaxis(transform(inverse(turn), places.reshape(-1, 2)).reshape(places.shape), -1, 0)
    is_block = (np.abs(x) < half) & (np.abs(y) < half)
    is_wall = ((np.abs(x) < CELL) & (y < 0.0)) | (np.maximum(np.abs(x), np.abs(y)) > SIDE - CELL)
    grid = OccupancyGrid(np.where(is_block | is_wall, 100, 0).astype(np.int8), CELL, Pose2D(-SIDE, -SIDE, 0.0))
    start, goal = np.round(transform(turn, np.array([[-ENDS, 0.0], [ENDS, 0.0]])), 9).tolist()
    scene = Scene(Place(*start), tuple(goal))
    planner = make(scene)
    request = PlanRequest(1, Pose2D(start[0], start[1], 0.0), Pose2D(goal[0], goal[1], 0.0), True)
    answer = planner.plan(make.asked(scene, request, grid, 0))
    if not isinstance(answer, Path):
        raise Unfit(f"it finds no path round a block of {2.0 * half:g} m: {answer.detail}")
    gap = _path_gap(transform(inverse(turn), answer.points), half)
    if answer.traversable is None:
        return gap, math.nan, CELL
    return gap, _grid_gap(answer.traversable, half, turn), answer.traversable.resolution


def _path_gap(points: Floats, half: float) -> float:
    """Least distance of a path from the upper side of the block at its middle, m; nan if it does not pass there."""
    line = Polyline(points)
    along = line.at(np.arange(0.0, line.length, STEP))
    above = along[(np.abs(along[:, 0]) < 0.5 * half) & (along[:, 1] > 0.0)]
    return float(above[:, 1].min()) - half if len(above) else math.nan


def _grid_gap(grid: OccupancyGrid, half: float, turn: Floats) -> float:
    """Distance of the nearest free place above the middle of the block from it, m; nan for none."""
    up = np.arange(half, SIDE, STEP)
    places = transform(turn, np.stack([np.full_like(up, 0.1 * CELL), up], axis=1))
    cells = cells_at(grid, places)
    is_inside = has_cells(grid, cells)
    is_free = grid.cells[cells[is_inside, 0], cells[is_inside, 1]] < 50
    return float(up[is_inside][np.argmax(is_free)]) - half if is_free.any() else math.nan


CHECKS = (centred,)

"""Whether a planner uses its whole map, also a large one: all four borders, and ways with thousands of cells."""

from __future__ import annotations

import traceback
from collections.abc import Iterator
from pathlib import PurePath

import numpy as np
from navloom.geometry.frames import transform
from navloom.geometry.world import Place
from navloom.messages import OccupancyGrid, Path, PlanFailure, PlanRequest, Pose2D
from navloom.roles import InputError
from numpy.typing import NDArray

from navloom_check.behaviour.measurements import Maker, Unfit
from navloom_check.behaviour.obstacle_scene import Scene
from navloom_check.check_bench import Bench, alike
from navloom_check.checks import check
from navloom_check.findings import Finding, NotRun
from navloom_check.side_effects import GUARD

__all__ = ["CHECKS"]

CELL = 0.05
"""Edge of a cell of the maps, m."""
COUNT = 121
"""Rows and columns of the map with a wall; an odd number, which no block of cells divides."""
OFF = 0.1
"""Distance of the goal from the wall, m: the robot has no room there."""
BORDERS = ("bottom", "right", "top", "left")
LANES, LANE, LENGTH = 12, 1.5, 18.0
"""Number of the lanes of a way that leads to and fro, the width and the length of each, m."""
LIMIT = 60.0
"""Longest search of the long way, s."""


@check("contract", {"planner"}, "A wall in the last row or column of the map blocks a goal as one in the first does.")
def borders(bench: Bench) -> Iterator[Finding]:
    """A map whose only obstacle is a wall along one border, and the same turned by 90°, 180° and 270°."""
    bench.sound()
    try:
        answers = [_answer(bench, *_walled(turns)) for turns in range(4)]
    except InputError as error:
        raise NotRun(f"it refuses the map: {error}") from None
    is_path = [isinstance(answer, Path) for answer in answers]
    if len(set(is_path)) > 1:
        free, blocked = BORDERS[is_path.index(True)], BORDERS[is_path.index(False)]
        yield Finding(
            f"plans to a goal {OFF:g} m from a wall along the {free} border, and to none along the {blocked} border",
            "the same answer for each border: every row and column of the map counts", given="a robot of 0.5 m x 0.4 m",
        )  # fmt: skip


@check("contract", {"planner"}, "A way of over 200 m to and fro through a large map does not make it raise.")
def long_way(bench: Bench) -> Iterator[Finding]:
    """It may find no path. A recursion for each cell of a path fails here."""
    bench.sound()
    grid, start, goal = _lanes()
    try:
        _answer(bench, grid, start, goal)
    except NotRun:
        raise
    except InputError as error:
        raise NotRun(f"it refuses the map: {error}") from None
    except Exception as error:
        yield Finding(f"raises {type(error).__name__}: {str(error)[:80]}", "a path, or a PlanFailure; loops in place "
                      "of recursion", _line(bench, error), f"{LANES} lanes of {LENGTH:g} m x {LANE:g} m")  # fmt: skip


def _line(bench: Bench, error: BaseException) -> str:
    """The innermost line of the plugin in the traceback of an error."""
    own = [(frame, line) for frame, line in traceback.walk_tb(error.__traceback__)
           if bench.subject.is_own(str(frame.f_globals.get("__name__", "")))]  # fmt: skip
    return f"{PurePath(own[-1][0].f_code.co_filename).name}:{own[-1][1]}" if own else ""


def _answer(bench: Bench, grid: OccupancyGrid, start: Pose2D, goal: Pose2D) -> Path | PlanFailure:
    make = Maker(bench.subject.thing, bench.subject.params, bench.seed)
    scene = Scene(Place(start.x, start.y), (goal.x, goal.y))
    with alike():
        try:
            given = make.asked(scene, PlanRequest(1, start, goal), grid, 0)
        except Unfit as error:
            raise NotRun(str(error)) from None
        planner = make(scene)
        with GUARD.within("plan", LIMIT):
            answer: Path | PlanFailure = planner.plan(given)
    return answer


def _walled(turns: int) -> tuple[OccupancyGrid, Pose2D, Pose2D]:
    """A map with a wall along one border, a start in its middle and a goal at the wall; turned by 90° some times."""
    half = 0.5 * COUNT * CELL
    cells = np.zeros((COUNT, COUNT), dtype=np.int8)
    cells[0] = 100
    grid = OccupancyGrid(np.ascontiguousarray(np.rot90(cells, -turns)), CELL, Pose2D(-half, -half, 0.0))
    x, y = transform(np.array([0.0, 0.0, 0.5 * np.pi * turns]), np.array([0.03, OFF + CELL - half])).tolist()
    return grid, Pose2D(0.0, 0.0, 0.0), Pose2D(x, y, 0.0)


def _lanes() -> tuple[OccupancyGrid, Pose2D, Pose2D]:
    """Parallel lanes that are joined at alternate ends."""
    rows, columns = round(LANES * LANE / CELL) + 1, round(LENGTH / CELL)
    gap = round(LANE / CELL)
    cells: NDArray[np.int8] = np.zeros((rows, columns), dtype=np.int8)
    cells[:, [0, -1]] = 100
    for lane in range(LANES + 1):
        cells[lane * gap] = 100
        if 0 < lane < LANES:
            opening = slice(columns - 1 - gap, columns - 1) if lane % 2 else slice(1, 1 + gap)
            cells[lane * gap, opening] = 0
    end = LENGTH - 0.5 * LANE if LANES % 2 else 0.5 * LANE
    goal = Pose2D(end, (LANES - 0.5) * LANE, 0.0)
    return OccupancyGrid(cells, CELL, Pose2D(0.0, 0.0, 0.0)), Pose2D(0.5 * LANE, 0.5 * LANE, 0.0), goal


CHECKS = (borders, long_way)

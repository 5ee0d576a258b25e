"""Paths of `hybrid_astar`: contact of the true footprint, time, and length beside OMPL's best.

    python benchmarks/hybrid_astar.py [--queries 200] [--compared 0] [--seconds 10] [--bodies long,tail,car] [--json]
        [--set KEY=VALUE …]

Queries are between random free poses of storeys (`floor:SEED`), BARN worlds and a Moving AI map (from the folder that
NAVLOOM_DATA names; left out without it). Contact is looked for with a reader of its own: poses every 5 mm and 0.5°, and
the separation of two convex polygons. `--compared` queries of each body are also given to RRT* and BIT* of OMPL in its
Reeds-Shepp space, each for `--seconds` of CPU time and then OMPL's own simplification; the shorter of both counts.
Their obstacles and footprint are the same. For these, the penalties, clearance and turns in place of hybrid_astar are
switched off, so that both look for the shortest path of the same robot. Times are CPU times.
"""

from __future__ import annotations

import argparse
import gzip
import json
import math
import os
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from navloom.engine.build import grid_of
from navloom_astar.grids import RasterMap
from navloom_hybrid_astar import planning
from navloom_hybrid_astar.clearance import Body, Ground, body_of, ground_of, is_free
from navloom_hybrid_astar.planning import Driven, HybridPlanner, Settings
from navloom_maps import barn_world, floor_of
from numpy.typing import NDArray

__all__ = ["BODIES", "Query", "contact", "queries"]

Floats = NDArray[np.float64]

BODIES: dict[str, tuple[Floats, Settings]] = {
    "long": (np.array([(0.6, -0.2), (0.6, 0.2), (-0.6, 0.2), (-0.6, -0.2)]), Settings(0.5, turn=0.5)),
    "tail": (np.array([(0.25, -0.25), (0.25, 0.25), (-0.7, 0.12), (-0.7, -0.12)]), Settings(0.4, turn=0.4)),
    "car": (np.array([(0.75, -0.25), (0.75, 0.25), (-0.2, 0.25), (-0.2, -0.25)]), Settings(0.8)),
}
"""Corners, m, base frame; the long differential robot, the one with a tail, and the Ackermann car."""
DEFAULTS = {"clearance": 0.05, "reverse": 0.5, "switch": 0.3, "steer": 0.02}
"""As the plugin is configured without parameters."""
SHORTEST = {"clearance": 0.0, "reverse": 0.0, "switch": 0.0, "steer": 0.0, "turn": math.inf}
"""What is changed for the comparison of lengths."""
CELL, HEIGHT = 0.05, 0.5
LEAST = 3.0
"""Least distance between start and goal, m."""
WORLDS = 12
"""Worlds that the queries of a body take turns in."""


class Query(NamedTuple):
    """Start and goal, x, y, m, heading, rad, map frame."""

    world: str
    raster: RasterMap
    start: tuple[float, float, float]
    goal: tuple[float, float, float]


def worlds(storeys: Sequence[str] = ()) -> Iterator[tuple[str, RasterMap]]:
    """Names and maps of the worlds, storeys and others in turn; or of some storeys only."""
    if storeys:
        yield from ((name, _raster(floor_of(name.removeprefix("floor:")).world)) for name in storeys)
        return
    data = Path(os.environ.get("NAVLOOM_DATA", ""))
    for number in range(WORLDS // 2):
        yield f"floor:{number}", _raster(floor_of(str(number)).world)
        if (data / "barn" / "barn_dev.npz").is_file() and number < WORLDS // 2 - 1:
            yield f"barn#{6 * number + 1}", _raster(barn_world(f"barn/barn_dev.npz#{6 * number + 1}", data))
    if (data / "movingai" / "dao__arena2.map.gz").is_file():
        rows = gzip.decompress((data / "movingai" / "dao__arena2.map.gz").read_bytes()).decode().splitlines()[4:]
        occupied = np.array([[char not in ".G" for char in row] for row in rows])
        yield "movingai:arena2", RasterMap(np.where(occupied, 100, 0).astype(np.int8), 0.2, (0.0, 0.0, 0.0))


def _raster(world: Any) -> RasterMap:
    grid = grid_of(world, CELL, HEIGHT)
    return RasterMap(grid.cells, grid.resolution, (grid.origin.x, grid.origin.y, grid.origin.heading))


def queries(body: str, count: int, storeys: Sequence[str] = ()) -> Iterator[Query]:
    """Random pairs of poses in which the robot has 5 cm of room, and that the distance field connects."""
    stream = np.random.default_rng([list(BODIES).index(body), 7])
    maps = list(worlds(storeys))
    for number in range(count):
        name, raster = maps[number % len(maps)]
        ground, outline = ground_of(raster.cells >= 50), body_of(BODIES[body][0], 0.05, raster.resolution)
        while True:
            start, goal = (_free_pose(raster, ground, outline, stream) for _ in range(2))
            if math.dist(start[:2], goal[:2]) >= LEAST and _is_connected(ground, outline, raster, start, goal):
                break
        yield Query(name, raster, start, goal)


def _free_pose(
    raster: RasterMap, ground: Ground, outline: Body, stream: np.random.Generator
) -> tuple[float, float, float]:
    rows, columns = raster.cells.shape
    while True:
        x, y, heading = stream.uniform((0.0, 0.0, -math.pi), (columns, rows, math.pi)).tolist()
        if is_free(x, y, heading, ground, outline):
            return (*raster.corner(y, x), heading + raster.origin[2])


def _is_connected(ground: Ground, outline: Body, raster: RasterMap, *poses: tuple[float, float, float]) -> bool:
    from scipy import ndimage

    parts, _ = ndimage.label(planning._passable(ground, outline), structure=np.ones((3, 3)))
    first, last = (raster.place(pose[:2]) for pose in poses)
    return bool(parts[int(first[1]), int(first[0])] == parts[int(last[1]), int(last[0])])


def contact(points: Floats, headings: Floats, outline: Floats, raster: RasterMap) -> float:
    """Deepest contact of the footprint along a path with an occupied cell, m; negative: the least gap, at most 0.5 m.

    The depth is the least over all edge normals of footprint and cell, so 0 is touching.
    """
    centres = np.argwhere(raster.cells >= 50)[:, ::-1] + 0.5
    from scipy.spatial import KDTree

    tree, cell = KDTree(centres), raster.resolution
    origin = raster.origin[2]
    reach = float(np.hypot(*outline.T).max())
    places, deepest = raster.places(points) * cell, -0.5
    for n in range(len(points) - 1):
        turn = (headings[n + 1] - headings[n] + math.pi) % (2.0 * math.pi) - math.pi
        count = 1 + math.ceil(max(math.dist(points[n], points[n + 1]) / 0.005, abs(turn) / math.radians(0.5)))
        for share in np.arange(count + (n == len(points) - 2)) / count:
            x, y = places[n] + share * (places[n + 1] - places[n])
            heading = headings[n] + share * turn - origin
            near = tree.query_ball_point((x / cell, y / cell), (reach + 0.05) / cell + 1.0)
            if near:
                deepest = max(deepest, _depth(outline, (x, y, heading), centres[near] * cell, 0.5 * cell))
    return deepest


def _depth(outline: Floats, pose: tuple[float, float, float], middles: Floats, half: float) -> float:
    """Depth of an outline in squares around middles (n, 2), m, by the separating axes; the greatest of all squares."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    corners = outline @ np.array([(c, s), (-s, c)]) + pose[:2]
    edges = np.roll(corners, -1, axis=0) - corners
    normals = np.stack([edges[:, 1], -edges[:, 0]], axis=1) / np.hypot(*edges.T)[:, None]
    beyond = (middles @ normals.T) - half * np.abs(normals).sum(axis=1) - (corners * normals).sum(axis=1)
    low, high = corners.min(axis=0) - half, corners.max(axis=0) + half
    apart = np.maximum(beyond.max(axis=1), np.maximum(low - middles, middles - high).max(axis=1))
    return float(-apart.min())


def shortest_of_ompl(query: Query, outline: Floats, radius: float, seconds: float) -> float | None:
    """Length of the shortest path that OMPL finds, m; None for none."""
    lengths = [_length_of_ompl(query, outline, radius, seconds, planner) for planner in ("RRTstar", "BITstar")]
    return min((length for length in lengths if length is not None), default=None)


def _length_of_ompl(query: Query, outline: Floats, radius: float, seconds: float, planner: str) -> float | None:
    import ompl.base as ob
    import ompl.geometric as og
    import ompl.util as ou

    ou.setLogLevel(ou.LogLevel.LOG_ERROR)
    raster = query.raster
    ground, body = ground_of(raster.cells >= 50), exact_body(outline, raster.resolution)
    space = ob.ReedsSheppStateSpace(radius / raster.resolution)
    bounds = ob.RealVectorBounds(2)
    for axis, size in enumerate(raster.cells.shape[::-1]):
        bounds.setLow(axis, 0.0)
        bounds.setHigh(axis, float(size))
    space.setBounds(bounds)
    about = ob.SpaceInformation(space)
    about.setStateValidityChecker(lambda state: is_free(state.getX(), state.getY(), state.getYaw(), ground, body))
    about.setStateValidityCheckingResolution(0.5 / space.getMaximumExtent())
    about.setup()
    problem = ob.ProblemDefinition(about)
    ends = []
    for pose in (query.start, query.goal):
        state = space.allocState()
        x, y = raster.place(pose[:2])
        state.setX(x)
        state.setY(y)
        state.setYaw((pose[2] - raster.origin[2] + math.pi) % (2.0 * math.pi) - math.pi)
        ends.append(state)
    problem.setStartAndGoalStates(*ends)
    problem.setOptimizationObjective(ob.PathLengthOptimizationObjective(about))
    search = getattr(og, planner)(about)
    search.setProblemDefinition(problem)
    search.setup()
    end = time.process_time() + seconds
    search.solve(ob.PlannerTerminationCondition(lambda: time.process_time() > end))
    if not problem.hasExactSolution():
        return None
    path = problem.getSolutionPath()
    length = path.length()
    og.PathSimplifier(about).simplify(path, 2.0)
    if path.check():
        length = min(length, path.length())
    return length * raster.resolution


def exact_body(outline: Floats, resolution: float) -> Body:
    """The outline without growth."""
    around = float(np.hypot(*outline.T).max()) / resolution
    inside = body_of(outline, 0.0, resolution)[2]
    return outline / resolution, np.empty((2, 2 * math.ceil(around) + 4)), inside, around, 1.0


def measured(body: str, query: Query, settings: Settings, compared: float) -> dict[str, Any]:
    """One query: length, m, time, s, expansions, contact, m, and the length of OMPL, m, if it is to be compared."""
    outline = BODIES[body][0]
    row: dict[str, Any] = {"body": body, "world": query.world, "away": math.dist(query.start[:2], query.goal[:2])}
    began = time.process_time()
    answer = _planned(query, settings, outline)
    row["seconds"] = time.process_time() - began
    if isinstance(answer, Driven):
        row |= {"length": answer.length, "expanded": answer.expanded}
        row["contact"] = contact(answer.points, answer.headings, outline, query.raster)
    else:
        row |= {"failure": answer.kind, "detail": answer.detail}
    if compared:
        ours = _planned(query, replace(settings, **SHORTEST), outline)
        row["ours"] = ours.length if isinstance(ours, Driven) else None
        row["ompl"] = shortest_of_ompl(query, outline, settings.radius, compared)
    return row


def _planned(query: Query, settings: Settings, outline: Floats) -> Any:
    planner = HybridPlanner(settings, outline)
    return planner.plan(query.start, query.goal[:2], query.goal[2], np.empty((0, 4)), query.raster)


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Counts, and percentiles of time and of the excess over OMPL's length."""
    found = [row for row in rows if "length" in row]
    told: dict[str, Any] = {
        "queries": len(rows),
        "found": len(found),
        "contacts": sum(row["contact"] > 0.0 for row in found),
        "deepest": max((row["contact"] for row in found), default=None),
        "seconds p50, p95, most": np.percentile([row["seconds"] for row in rows], (50, 95, 100)).round(3).tolist(),
    }
    pairs = [(row["ours"], row["ompl"]) for row in rows if row.get("ompl") and row.get("ours")]
    if pairs:
        excess = [100.0 * (ours / theirs - 1.0) for ours, theirs in pairs]
        told["compared"] = len(pairs)
        told["only ours found, only OMPL found"] = [
            sum("ompl" in row and row["ompl"] is None and row["ours"] is not None for row in rows),
            sum("ompl" in row and row["ompl"] is not None and row["ours"] is None for row in rows),
        ]
        told["longer than OMPL, percent: p5, p50, p95"] = np.percentile(excess, (5, 50, 95)).round(2).tolist()
    return told


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--queries", type=int, default=200)
    parser.add_argument("--compared", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--bodies", default=",".join(BODIES))
    parser.add_argument("--set", nargs="*", default=[])
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    planning.warm_up()
    names, rows = given.bodies.split(","), []
    changes = DEFAULTS | {key: json.loads(value) for key, value in (one.split("=") for one in given.set)}
    for position, body in enumerate(names):
        count = len(range(position, given.queries, len(names)))
        settings = replace(BODIES[body][1], **changes)
        for number, query in enumerate(queries(body, count)):
            rows.append(measured(body, query, settings, given.seconds if number < given.compared else 0.0))
            print(
                json.dumps(rows[-1]) if given.json else rows[-1],
                file=sys.stdout if given.json else sys.stderr,
                flush=True,
            )
    print(json.dumps(summary(rows), indent=None if given.json else 2))


if __name__ == "__main__":
    main()

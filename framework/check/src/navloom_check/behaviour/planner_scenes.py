"""Scenes and measures of planners: generated maps, and comparisons with the shortest path."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
from navloom.geometry.cells import places_of
from navloom.geometry.footprints import circumscribed_radius, inscribed_radius
from navloom.geometry.frames import transform
from navloom.geometry.polylines import Polyline
from navloom.geometry.world import Place, Raster, World
from navloom.messages import OccupancyGrid, Path, PlanFailure, PlanRequest, Pose2D
from navloom.roles.claims import Claim

from navloom_check.behaviour.measurements import Behaviour, Line, Maker, Measured, Unfit
from navloom_check.behaviour.obstacle_scene import CELL, Scene, grid_of, post, wall

__all__ = ["PLANNERS"]

DIAGONAL = math.sqrt(2.0) * CELL
ON_GRID = 1.0 / math.cos(math.pi / 8.0)
"""Greatest ratio of the shortest path on an eight-connected grid to the shortest any-angle path."""
ANY_ANGLE = 1.02
"""Greatest ratio of the path of an any-angle search to the shortest; Theta* does not find the optimum exactly."""
SAME = 0.005
"""Greatest difference of two path lengths that should be equal, as a share."""


def ask(make: Maker, scene: Scene, grid: OccupancyGrid) -> Path | PlanFailure:
    """Answer of a new planner to a request from the start of a scene to its target."""
    start = Pose2D(scene.start.x, scene.start.y, scene.start.heading)
    planner = make(scene)
    if scene.has_earlier_map:
        other, flipped = scene.mirrored(), _flipped(grid)
        before = PlanRequest(1, Pose2D(other.start.x, other.start.y, 0.0), Pose2D(*other.target, 0.0), True)
        planner.plan(make.asked(scene, before, flipped, 0))
    request = PlanRequest(2, start, Pose2D(*scene.target, 0.0), True)
    answer: Path | PlanFailure = planner.plan(make.asked(scene, request, grid, 1))
    return answer


def _asked(make: Maker, scene: Scene) -> Path | PlanFailure:
    """As `ask`, with the whole scene turned by the heading of its map, so that the raster is not along the axes."""
    turned = Place(0.0, 0.0, scene.map_heading)
    return ask(make, scene.moved(turned), grid_of(scene, turned))


def _flipped(grid: OccupancyGrid) -> OccupancyGrid:
    """The map of the mirrored scene; the raster must lie along the axes."""
    low = -(grid.origin.y + grid.cells.shape[0] * CELL)
    return OccupancyGrid(np.ascontiguousarray(grid.cells[::-1]), CELL, Pose2D(grid.origin.x, low, 0.0))


# --- scenes -----------------------------------------------------------------------------------------------------------


def room(seed: int) -> Scene:
    """A room of 8 m x 6 m in which a wall and a post block the straight way.

    Of three scenes, one has a map whose raster is turned, and one comes after a request on another map.
    """
    stream = np.random.default_rng([seed, 5])
    box = (
        wall(-4.0, -3.0, 4.0, -3.0),
        wall(4.0, -3.0, 4.0, 3.0),
        wall(4.0, 3.0, -4.0, 3.0),
        wall(-4.0, 3.0, -4.0, -3.0),
    )
    side = float(stream.choice([-1.0, 1.0]))
    jut = wall(float(stream.uniform(-0.8, 0.8)), side * 3.0, float(stream.uniform(-0.8, 0.8)), side * -0.8)
    posts = tuple(
        post(x, side * y, r) for x, y, r in stream.uniform((-2.2, 0.2, 0.15), (-1.4, 1.8, 0.4), (1, 3)).tolist()
    )
    start, target = (-3.2, side * float(stream.uniform(0.5, 2.0))), (3.2, side * float(stream.uniform(0.5, 2.2)))
    scene = Scene(Place(*start, float(stream.uniform(-3.0, 3.0))), target, (*posts, *box, jut))
    return replace(scene, map_heading=0.7 if seed % 3 == 1 else 0.0, has_earlier_map=seed % 3 == 2)


def room_or_cell(seed: int) -> Scene:
    """A room; in every third one, the goal is walled in."""
    scene = room(seed)
    if seed % 3 != 2:
        return scene
    x, y = scene.target
    cell = (wall(x - 0.7, y - 0.7, x + 0.7, y - 0.7), wall(x + 0.7, y - 0.7, x + 0.7, y + 0.7),
            wall(x + 0.7, y + 0.7, x - 0.7, y + 0.7), wall(x - 0.7, y + 0.7, x - 0.7, y - 0.7))  # fmt: skip
    return replace(scene, obstacles=(*scene.obstacles, *cell))


def tight(seed: int) -> Scene:
    """A room divided by a wall that has a wide door, and a narrow one on the shorter way."""
    stream = np.random.default_rng([seed, 6])
    box, x = room(seed).walls[:4], float(stream.uniform(-0.5, 0.5))
    length, width = ((0.5, 0.4), (1.0, 0.8), (0.8, 0.8))[seed % 3]
    narrow, side = width - 0.15, float(stream.choice([-1.0, 1.0]))
    walls = (wall(x, -3.0, x, -2.4), wall(x, -0.6, x, -0.5 * narrow), wall(x, 0.5 * narrow, x, 3.0))
    ends = float(stream.uniform(0.0, 0.8)), float(stream.uniform(-0.3, 0.8))
    scene = Scene(Place(-3.0, ends[0]), (3.0, ends[1]), (*box, *walls), length, width)
    return scene if side > 0.0 else scene.mirrored()


# --- measures ---------------------------------------------------------------------------------------------------------


def _length(points: np.ndarray) -> float:
    return float(np.hypot(*np.diff(points, axis=0).T).sum())


@lru_cache(maxsize=256)
def shortest(scene: Scene, radius: float) -> float | None:
    """Exact length of the shortest path of a disc through the scene's cells, m; None if there is none."""
    # Here, as in `navloom_check.builders`.
    from navloom_optimal.shortest_path import optimal_length

    grid = grid_of(scene)
    world = World("scene", raster=Raster("cells", grid.cells > 0, CELL, Place(grid.origin.x, grid.origin.y)))
    return optimal_length(world, scene.start, Place(*scene.target), radius, 1.0)


def _roomy(scene: Scene) -> float | None:
    """Length of the shortest path with room for the robot, m: for its circumscribed disc plus a cell's diagonal."""
    return shortest(scene, circumscribed_radius(scene.outline) + DIAGONAL)


def _told(answer: Path | PlanFailure) -> str:
    if isinstance(answer, Path):
        return f"gave a path of {_length(answer.points):.2f} m"
    return f"said {answer.kind}: {answer.detail}"


def _lines(answer: Path | PlanFailure) -> tuple[Line, ...]:
    return (Line("path", answer.points),) if isinstance(answer, Path) else ()


def reaches(make: Maker, scene: Scene) -> Measured:
    answer = _asked(make, scene)
    if _roomy(scene) is not None:
        said = f"{_told(answer)} where the robot has room to pass"
        return Measured(isinstance(answer, Path), said, 0.0, _lines(answer))
    if shortest(scene, 0.5 * CELL) is None:
        return Measured(
            isinstance(answer, PlanFailure), f"{_told(answer)} to a goal that is walled in", 0.0, _lines(answer)
        )
    return Measured(True, _told(answer), 0.0, _lines(answer))


def _least(make: Maker, scene: Scene, radius: float, what: str) -> Measured:
    """Measure the least distance of a path from the middle of an occupied cell, which must be at least `radius`, m."""
    answer = _asked(make, scene)
    if isinstance(answer, PlanFailure):
        return Measured(True, _told(answer), 0.0)
    points = transform(np.array([0.0, 0.0, -scene.map_heading]), answer.points)
    grid = grid_of(scene)
    centres = places_of(grid, np.argwhere(grid.cells > 0))
    least = math.inf
    if len(centres):
        from scipy.spatial import KDTree

        line = Polyline(points)
        dense = line.at(np.linspace(0.0, line.length, 2 + int(line.length / (0.2 * CELL))))
        least = float(KDTree(centres).query(dense)[0].min())
    said = f"{_told(answer)} that comes within {least:.3f} m of the middle of an occupied cell, {what}"
    return Measured(least >= radius, said, least, (Line("path", points),))


def no_contact(make: Maker, scene: Scene) -> Measured:
    return _least(make, scene, 0.45 * CELL, "so that it leads through it")


def footprint(make: Maker, scene: Scene) -> Measured:
    radius = inscribed_radius(scene.outline)
    return _least(make, scene, radius - DIAGONAL, f"while the inscribed radius is {radius:.2f} m")


def _within(make: Maker, scene: Scene, factor: float) -> Measured:
    answer, best = ask(make, scene, grid_of(scene)), _roomy(scene)
    if best is None:
        raise Unfit("no room for the robot: nothing to compare with")
    if isinstance(answer, PlanFailure):
        return Measured(False, f"{_told(answer)} where a path of {best:.2f} m exists", math.inf)
    length, most = _length(answer.points), factor * best + 2.0 * DIAGONAL
    said = f"{_told(answer)}; the shortest any-angle path has {best:.2f} m, the bound is {most:.2f} m"
    return Measured(length <= most, said, length / best, _lines(answer))


def optimal(make: Maker, scene: Scene) -> Measured:
    return _within(make, scene, ON_GRID)


def optimal_any_angle(make: Maker, scene: Scene) -> Measured:
    return _within(make, scene, ANY_ANGLE)


def _alike(make: Maker, scene: Scene, other: Scene, grid: OccupancyGrid) -> Measured:
    scene, other = (replace(one, has_earlier_map=False) for one in (scene, other))
    here, there = ask(make, scene, grid_of(scene)), ask(make, other, grid)
    if isinstance(here, PlanFailure) or isinstance(there, PlanFailure):
        alike = type(here) is type(there)
        said = f"{_told(here)}, and {_told(there)} in the other scene"
        return Measured(alike, said, 0.0, (*_lines(here), *_lines(there)))
    a, b = _length(here.points), _length(there.points)
    off = abs(a - b) / max(a, b)
    said = f"gave a path of {a:.3f} m, and one of {b:.3f} m in the other scene"
    return Measured(off <= SAME, said, off, (*_lines(here), *_lines(there)), (scene, other))


def translation(make: Maker, scene: Scene) -> Measured:
    place = Place(3.37, -1.81)
    return _alike(make, scene, scene.moved(place), grid_of(scene, place))


def rotation(make: Maker, scene: Scene) -> Measured:
    place = Place(0.0, 0.0, 0.7)
    return _alike(make, scene, scene.moved(place), grid_of(scene, place))


def mirror(make: Maker, scene: Scene) -> Measured:
    return _alike(make, scene, scene.mirrored(), _flipped(grid_of(scene)))


PLANNERS = (
    Behaviour("planner", Claim.REACHES, "a path where there is room, and a failure where there is none",
              room_or_cell, reaches, 9),
    Behaviour("planner", Claim.NO_CONTACT, "a path through free cells only", room, no_contact, 9),
    Behaviour("planner", Claim.FOOTPRINT, "the inscribed disc free along the path, within a cell's diagonal",
              tight, footprint, 9),
    Behaviour("planner", Claim.OPTIMAL, "a path at most 8.24 % longer than the shortest any-angle path",
              room, optimal, 9),
    Behaviour("planner", Claim.OPTIMAL_ANY_ANGLE, "a path at most 2 % longer than the shortest any-angle path",
              room, optimal_any_angle, 9),
    Behaviour("planner", Claim.TRANSLATION, f"the same length within {SAME:.1%}", room, translation, 6),
    Behaviour("planner", Claim.ROTATION, f"the same length within {SAME:.1%}", room, rotation, 6),
    Behaviour("planner", Claim.MIRROR, f"the same length within {SAME:.1%}", room, mirror, 6),
)  # fmt: skip

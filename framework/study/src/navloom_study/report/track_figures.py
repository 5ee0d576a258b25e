"""Draws driven tracks in their world: all methods in one figure, each method in its own, and single failures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from navloom.geometry.frames import transform
from navloom.geometry.solids import box_corners, overlaps
from navloom.geometry.world import Box, Obstacle, World
from numpy.typing import NDArray

from navloom_study.episode_rows import Row
from navloom_study.report.extent import extent_of
from navloom_study.report.figures import PAIR, PANEL, line_of, nested_width, shortened
from navloom_study.report.plotting import new_figure, styled
from navloom_study.report.study_files import StudyFiles
from navloom_study.tracks import StoredWay

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["WorldWays", "draw_world", "failure_figure", "ways_figures", "ways_in", "worlds_shown"]

Floats = NDArray[np.float64]
Bounds = tuple[float, float, float, float]
SEEDS = 10
"""Most tracks of one method in one panel."""
AROUND = 1.5
"""Margin around the tracks, m."""
DRIVEN = 0.1
"""Shortest extent of a track that counts as driving, m."""
TALLEST = 222.0
"""Largest height of a figure, mm: with its caption it fits on one page."""
WALL, GHOST = "#6E6E6E", "#C2C2C2"


@dataclass(frozen=True, eq=False)
class WorldWays:
    """Tracks in one world.

    Attributes:
        world: The world's reference.
        tracks: By method, the track and outcome of each seed.
        seeds: Number of seeds drawn for each method.
    """

    world: str
    tracks: dict[str, list[tuple[StoredWay, str]]]
    seeds: int

    @property
    def is_driven(self) -> bool:
        """Whether any robot moved."""
        return any(np.ptp(track.points, axis=0).max() > DRIVEN for told in self.tracks.values() for track, _ in told)


def ways_in(study: StudyFiles, world: str) -> WorldWays:
    """The stored tracks of the first seeds in one world."""
    seeds = study.seeds[:SEEDS]
    tracks: dict[str, list[tuple[StoredWay, str]]] = {}
    ends = {(row.key.method, row.key.seed): row.outcome for row in study.rows if row.key.world == world}
    for method in study.methods:
        found = [(study.track(method, world, seed), ends[method, seed]) for seed in seeds]
        tracks[method] = [(track, end) for track, end in found if track is not None]
    return WorldWays(world, tracks, len(seeds))


def worlds_shown(study: StudyFiles) -> list[tuple[str, WorldWays]]:
    """The world with the lowest success over all methods and the median world, of those in which a robot moved.

    Worlds are ranked by success, then by SPL, then in the order of the request.
    """
    tested = {row.key.world for row in study.tested}
    order = sorted((world for world in study.worlds if world in tested), key=lambda world: _rank(study, world))
    driven = [ways for world in order if (ways := ways_in(study, world)).is_driven]
    if not driven:
        return []
    middle = driven[len(driven) // 2]
    worst = [("the worst world", driven[0])]
    return worst if middle is driven[0] else [*worst, ("the median world", middle)]


def _rank(study: StudyFiles, world: str) -> tuple[float, float]:
    rows = [row for row in study.rows if row.key.world == world]
    wins = sum(row.outcome == "succeeded" for row in rows)
    return wins / len(rows), sum(row.metrics.get("spl") or 0.0 for row in rows) / len(rows)


def ways_figures(study: StudyFiles, ways: WorldWays) -> list[Figure]:
    """All methods overlaid, larger, then each by itself if there are several."""
    methods, world = study.methods, study.world(ways.world)
    bounds = _bounds(ways, world)
    robot_height = study.value("robot.height") or 2.0
    figures = []
    for shown in [methods, *([[method] for method in methods] if len(methods) > 1 else [])]:
        figure, axes = _map_figure(PAIR if shown is methods else PANEL, bounds)
        with styled():
            _draw_ways(axes, ways, shown, methods, world, bounds, robot_height)
            name = "all methods" if shown is methods else _won(study, shown[0], ways.world)
            axes.set_title(name, loc="left")
        figures.append(figure)
    return figures


def _won(study: StudyFiles, method: str, world: str) -> str:
    wins = sum(end == "succeeded" for end in study.outcomes[method, world])
    return f"{shortened(method)} {wins}/{len(study.seeds)}"


def failure_figure(study: StudyFiles, row: Row) -> Figure | None:
    """The track of one episode in its world; None if no track was stored or the robot did not drive."""
    key = row.key
    track = study.track(key.method, key.world, key.seed)
    if track is None or not len(track.points):
        return None
    ways = WorldWays(key.world, {key.method: [(track, row.outcome)]}, 1)
    if not ways.is_driven:
        return None
    world = study.world(key.world)
    bounds = _bounds(ways, world)
    figure, axes = _map_figure(PANEL, bounds)
    with styled():
        _draw_ways(axes, ways, [key.method], study.methods, world, bounds, study.value("robot.height") or 2.0)
    return figure


def _map_figure(width: float, bounds: Bounds) -> tuple[Figure, Any]:
    """A figure for these bounds at equal scales, mm wide."""
    high = (bounds[3] - bounds[1]) / (bounds[2] - bounds[0])
    figure, axes = new_figure(width, min((width - 15.0) * high + 16.0, TALLEST))
    with styled():
        axes.set_xlabel("x, m")
        axes.set_ylabel("y, m")
    return figure, axes


def _draw_ways(
    axes: Any,
    ways: WorldWays,
    shown: Sequence[str],
    methods: Sequence[str],
    world: World | None,
    bounds: Bounds,
    high: float,
) -> None:
    if world is not None:
        draw_world(axes, world, high)
    alpha = max(0.35, min(0.95, 2.0 / math.sqrt(max(1, ways.seeds))))
    for number, method in enumerate(shown):
        style = line_of(methods.index(method))
        for track, end in ways.tracks[method]:
            # White below each line, and later lines narrower: where tracks lie on each other, each stays visible.
            width = nested_width(number, len(shown))
            axes.plot(*track.points.T, alpha=0.6, linewidth=width + 0.7, color="white", zorder=3 + 0.1 * number)
            axes.plot(*track.points.T, alpha=alpha, linewidth=width, zorder=3.05 + 0.1 * number, **style)
            if end != "succeeded":
                axes.plot(*track.points[-1], "X", color=style["color"], markersize=7.0, markeredgecolor="white",
                          markeredgewidth=0.5, zorder=6)  # fmt: skip
    some = next((track for told in ways.tracks.values() for track, _ in told), None)
    if some is not None:
        axes.plot(*some.points[0], "o", color="black", markersize=5, zorder=7)
        if some.goal is not None:
            axes.plot(*some.goal, "*", color="black", markersize=10, markeredgecolor="white", zorder=7)
    axes.set_aspect("equal")
    axes.set_xlim(bounds[0], bounds[2])
    axes.set_ylim(bounds[1], bounds[3])
    axes.locator_params(nbins=6)


def draw_world(axes: Any, world: World, robot_height: float) -> None:
    """Draw obstacles: dark at the robot's height, pale above or below it, moving ones with their path.

    Args:
        axes: Matplotlib axes, m, map frame.
        world: The true world.
        robot_height: Height of the robot, m.
    """
    from matplotlib.collections import PatchCollection

    shapes: dict[tuple[str, bool, bool], list[Any]] = {}
    for obstacle in world.obstacles:
        meets = overlaps(obstacle.z, (0.0, robot_height))
        late = obstacle.appears_after_sweep or obstacle.appears_at > 0.0
        colour, filled = WALL if meets else GHOST, meets and not obstacle.waypoints
        shapes.setdefault((colour, filled, late), []).append(_shape(obstacle))
        if obstacle.waypoints:
            way = np.array(obstacle.waypoints)[:, 1:]
            axes.plot(*way.T, color=colour, linewidth=0.9, linestyle=":", zorder=2)
    for (colour, filled, late), alike in shapes.items():  # drawn one by one, hundreds of them take seconds
        face = "#E8E8E8" if late else colour if filled else "none"
        hatch = "//////" if late else None
        axes.add_collection(
            PatchCollection(alike, edgecolor=colour, facecolor=face, linewidth=0.7, zorder=2, hatch=hatch)
        )
    if world.raster is not None and overlaps(world.raster.z, (0.0, robot_height)):
        _draw_raster(axes, world)


def _shape(obstacle: Obstacle) -> Any:
    from matplotlib.patches import Circle, Polygon

    if isinstance(obstacle, Box):
        return Polygon(box_corners(obstacle), closed=True)
    return Circle(obstacle.waypoints[0][1:] if obstacle.waypoints else obstacle.centre, obstacle.radius)


def _draw_raster(axes: Any, world: World) -> None:
    raster = world.raster
    assert raster is not None
    rows, columns = raster.occupied.shape
    corners = np.array([(0, 0), (columns, 0), (columns, rows), (0, rows)], dtype=np.float64) * raster.resolution
    motion = np.array([raster.origin.x, raster.origin.y, raster.origin.heading])
    if raster.origin.heading == 0.0:
        (x0, y0), (x1, y1) = transform(motion, corners)[[0, 2]]
        shown = np.where(raster.occupied, 1.0, np.nan)
        axes.imshow(shown, origin="lower", extent=(x0, x1, y0, y1), cmap="Greys", vmin=0.0, vmax=1.7,
                    interpolation="nearest", zorder=1)  # fmt: skip
        return
    at = np.argwhere(raster.occupied)[:, ::-1] + 0.5
    axes.plot(*transform(motion, at * raster.resolution).T, ",", color=WALL, zorder=1)


def _bounds(ways: WorldWays, world: World | None) -> Bounds:
    """Bounds of a figure, m: all tracks and the goal with a margin, and all that stands near them."""
    told = [track for tracks in ways.tracks.values() for track, _ in tracks]
    points = np.concatenate(
        [track.points for track in told] + [track.goal[None] for track in told if track.goal is not None]
    )
    bounds = np.array(extent_of(points, world, AROUND))
    low, high = bounds[:2], bounds[2:]
    # A straight track must not become a line: the shorter side is at least 1 / 2.5 of the longer one.
    size = high - low
    least = float(size.max()) / 2.5
    for axis in (0, 1):
        if size[axis] < least:
            middle = 0.5 * (low[axis] + high[axis])
            low[axis], high[axis] = middle - 0.5 * least, middle + 0.5 * least
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])

"""Draws driven tracks in their world: all methods in one panel, and each method in its own."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from navloom.geometry.frames import transform
from navloom.geometry.solids import box_corners, overlaps
from navloom.geometry.world import Box, Obstacle, World
from navloom.palette import GREY
from numpy.typing import NDArray

from navloom_study.report.figures import WIDTH, line_of, shortened
from navloom_study.report.plotting import new_figure, styled
from navloom_study.report.study_files import StudyFiles
from navloom_study.tracks import StoredWay

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["WorldWays", "draw_world", "ways_figure", "ways_in", "worlds_shown"]

Floats = NDArray[np.float64]
Bounds = tuple[float, float, float, float]
SEEDS = 10
"""Most tracks of one method in one panel."""
AROUND = 1.5
"""Margin around the tracks, m."""
DRIVEN = 0.1
"""Shortest extent of a track that counts as driving, m."""
OVERLAY = 1.8
"""Width of the panel of all methods relative to the others, if it is beside them."""
TALLEST = 222.0
"""Largest height of a figure, mm: with heading and caption it fits on one page."""
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
    order = sorted(study.worlds, key=lambda world: _rank(study, world))
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


def ways_figure(study: StudyFiles, ways: WorldWays) -> Figure:
    """All methods overlaid, and each by itself: below the overlay for a wide world, beside it for a tall one."""
    methods, world = study.methods, study.world(ways.world)
    bounds = _bounds(ways, world)
    high = (bounds[3] - bounds[1]) / (bounds[2] - bounds[0])
    columns = 1 if len(methods) < 2 else 2 if len(methods) == 2 else 3 if len(methods) <= 9 else 4
    rows = math.ceil(len(methods) / columns) if len(methods) > 1 else 0
    beside = high > 1.2 and rows > 0
    small = (WIDTH - 12.0) / (columns + (OVERLAY if beside else 0.0))
    each = min(small * high, 85.0) + 8.0
    large = 0.0 if beside else min(105.0, (WIDTH - 20.0) * high)
    figure, _ = new_figure(
        WIDTH, min(max(large + rows * each, OVERLAY * small * high if beside else 0.0) + 18.0, TALLEST)
    )
    with styled():
        figure.clear()
        if beside:
            grid = figure.add_gridspec(rows, columns + 1, width_ratios=[OVERLAY, *[1.0] * columns])
            places = [grid[k // columns, 1 + k % columns] for k in range(len(methods))]
            top = figure.add_subplot(grid[:, 0])
        else:
            grid = figure.add_gridspec(rows + 1, columns, height_ratios=[large, *[each] * rows])
            places = [grid[1 + k // columns, k % columns] for k in range(len(methods) if rows else 0)]
            top = figure.add_subplot(grid[0, :])
        robot_height = study.value("robot.height") or 2.0
        _draw_ways(top, ways, methods, methods, world, bounds, robot_height)
        top.set_title("all", loc="left")
        top.set_xlabel("x, m")
        top.set_ylabel("y, m")
        for method, place in zip(methods, places, strict=False):
            axes = figure.add_subplot(place)
            _draw_ways(axes, ways, [method], methods, world, bounds, robot_height)
            wins = sum(end == "succeeded" for end in study.outcomes[method, ways.world])
            axes.set_title(
                f"{shortened(method, 13 if columns < 4 else 11)} {wins}/{len(study.seeds)}", loc="left", fontsize=7.5
            )
            axes.tick_params(labelleft=False, labelbottom=False)
        _legend(figure, methods)
    return figure


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
    alpha = max(0.25, min(0.9, 1.6 / math.sqrt(max(1, ways.seeds) * len(shown))))
    for method in shown:
        style = line_of(methods.index(method))
        for track, end in ways.tracks[method]:
            axes.plot(*track.points.T, alpha=alpha, linewidth=0.9, **style)
            if end != "succeeded":
                axes.plot(*track.points[-1], "X", color=style["color"], markersize=6.0, markeredgecolor="white",
                          markeredgewidth=0.4, zorder=6)  # fmt: skip
    some = next((track for told in ways.tracks.values() for track, _ in told), None)
    if some is not None:
        axes.plot(*some.points[0], "o", color="black", markersize=4, zorder=7)
        if some.goal is not None:
            axes.plot(*some.goal, "*", color="black", markersize=8, zorder=7)
    axes.set_aspect("equal")
    axes.set_xlim(bounds[0], bounds[2])
    axes.set_ylim(bounds[1], bounds[3])


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
    """Bounds of the panels, m: all tracks and the goal with a margin, cut to the world."""
    told = [track for tracks in ways.tracks.values() for track, _ in tracks]
    points = np.concatenate(
        [track.points for track in told] + [track.goal[None] for track in told if track.goal is not None]
    )
    low, high = points.min(axis=0) - AROUND, points.max(axis=0) + AROUND
    if world is not None:
        low, high = np.maximum(low, world.bounds[:2]), np.minimum(high, world.bounds[2:])
    # A straight track must not become a line: the shorter side is at least 1 / 2.5 of the longer one.
    size = high - low
    least = float(size.max()) / 2.5
    for axis in (0, 1):
        if size[axis] < least:
            middle = 0.5 * (low[axis] + high[axis])
            low[axis], high[axis] = middle - 0.5 * least, middle + 0.5 * least
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def _legend(figure: Figure, methods: Sequence[str]) -> None:
    from matplotlib.lines import Line2D

    entries = [Line2D([], [], label=shortened(name), **line_of(k)) for k, name in enumerate(methods)]
    entries.append(Line2D([], [], color=GREY, marker="X", linestyle="", label="ended without success"))
    entries.append(Line2D([], [], color="black", marker="o", markersize=4, linestyle="", label="start"))
    entries.append(Line2D([], [], color="black", marker="*", markersize=7, linestyle="", label="goal"))
    figure.legend(handles=entries, loc="outside lower center", ncols=min(6, len(entries)))

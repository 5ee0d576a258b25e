"""Draws a run: the robot's map, the plan, the trajectory and the driven track."""

from __future__ import annotations

import math
from collections.abc import Collection

import numpy as np
from navloom.geometry.cells import places_of
from navloom.geometry.frames import transform
from navloom.geometry.solids import box_corners, centre_at, overlaps
from navloom.geometry.world import Box
from navloom.messages import MapUpdate, OccupancyGrid
from navloom.runs.episode import Episode
from numpy.typing import NDArray
from PIL import Image
from scipy.ndimage import binary_dilation

from navloom_study.report.canvas import (
    BLACK,
    BLUE,
    GREEN,
    ORANGE,
    SKY,
    UNKNOWN,
    VERMILION,
    Canvas,
    Key,
    Rectangle,
    overlap,
    png_of,
)
from navloom_study.report.extent import extent_of

__all__ = ["draw_map_update", "draw_poses", "draw_run", "png_of"]

Floats = NDArray[np.float64]
Colour = tuple[int, int, int]
CELLS, FOOTPRINT = (190, 190, 190), (235, 175, 145)
MOST_TIMES = 9
"""Most times written along a track."""
START = 0.08
"""Radius of the disc that marks a start, m."""
OUTLINE_EVERY = 2.0
"""Interval of the robot's outlines, s."""
DRIVEN = Key("driven", VERMILION, "line")
DRIVERS = {
    "controller": Key("driven by the controller", VERMILION, "line"),
    "avoider": Key("by the avoider", (170, 68, 153), "line"),
    "recovery": Key("by the recovery", (102, 68, 0), "line"),
    "operator": Key("by the operator", GREEN, "line"),
}
TRUE, ABOVE = Key("true obstacles", SKY, "outline"), Key("above the robot", SKY, "dashed")


def draw_map_update(update: MapUpdate, way: Floats | None = None) -> Image.Image:
    """Draw a map: its cells grey or black, its segments black, the origin of the map frame marked.

    Args:
        update: The map.
        way: (n, 2) track of the robot, m, map frame; None if it did not move.
    """
    grid = update.grid
    rows, cols = grid.cells.shape
    corners = np.array([(0, 0), (cols, 0), (cols, rows), (0, rows)], dtype=np.float64) * grid.resolution
    outline = transform(np.array([grid.origin.x, grid.origin.y, grid.origin.heading]), corners)
    (x0, y0), (x1, y1) = outline.min(axis=0), outline.max(axis=0)
    ends = [Key("sensor", GREEN, "disc")] if way is None else [Key("start", GREEN, "disc"), DRIVEN]
    canvas = Canvas((float(x0), float(y0), float(x1), float(y1)), [*_map_keys(update), *ends])
    _draw_map(canvas, update)
    if way is not None:
        canvas.line(way, VERMILION, 2.5)
    canvas.disc(0.0, 0.0, 0.01 * (x1 - x0), GREEN, BLACK)
    canvas.frame()
    return canvas.finished()


def draw_poses(poses: Floats, known: OccupancyGrid | None, is_tracking: NDArray[np.bool_]) -> Image.Image:
    """Draw the tracks of odometry and of a localizer on the map that it was given; odometry is cut off beyond the map.

    Of the map it draws the edges of occupied space only, because large maps are mostly occupied or unknown.

    Args:
        poses: (n, 7) time, s, then x, y, m, heading, rad, by odometry and by the localizer, map frame.
        known: The map; None for none.
        is_tracking: (n,) whether the localizer was tracking.
    """
    odometry, localizer = poses[:, 1:3], poses[:, 4:6]
    keys, shown = [Key("odometry", BLUE, "line"), Key("localizer", VERMILION, "line")], odometry
    places = np.flatnonzero(~is_tracking)
    stretches = [part for part in np.split(places, np.flatnonzero(np.diff(places) > 1) + 1) if len(part) > 1]
    if stretches:
        keys.append(Key("localizer while not tracking", ORANGE, "line"))
    if known is not None:
        occupied = known.cells >= 50
        edges = occupied & binary_dilation(~occupied)
        corner = np.array([known.origin.x, known.origin.y, known.origin.heading])
        shown = places_of(known, np.argwhere(edges))
        keys.insert(0, Key("edges of the map's occupied space", BLACK))
    seen = np.vstack([shown, localizer])
    (x0, y0), (x1, y1) = seen.min(axis=0) - 1.0, seen.max(axis=0) + 1.0
    canvas = Canvas((float(x0), float(y0), float(x1), float(y1)), keys)
    if known is not None:
        canvas.cells(edges, corner, known.resolution, BLACK)
    canvas.line(odometry, BLUE, 1.5)
    canvas.line(localizer, VERMILION, 2.5)
    for stretch in stretches:
        canvas.line(localizer[stretch], ORANGE, 5.0)
    canvas.frame()
    return canvas.finished()


def draw_run(episode: Episode) -> Image.Image:
    """Draw map, plan, trajectory and true track of a finished run, with start, goal and the true obstacles."""
    recorder, system = episode.recorder, episode.system
    extent = _extent(episode)
    obstacles = _obstacles_in(extent, episode)
    canvas = Canvas(extent, _run_keys(episode, {key for _, key in obstacles}))
    if recorder.map is not None:
        _draw_map(canvas, recorder.map)
    for outline, key in obstacles:
        if key is TRUE:
            canvas.polygon(outline, None, key.colour)
        else:
            canvas.dashed(outline, key.colour)
    for path in recorder.plans:
        canvas.line(path.points, ORANGE, 2.5)
    for trajectory in recorder.trajectories:
        canvas.line(trajectory.samples[:, 1:3], BLUE, 2.5)
    _draw_outlines(canvas, episode)
    _draw_track(canvas, episode)
    canvas.disc(system.start.x, system.start.y, START, GREEN, BLACK)
    canvas.text(system.start.x, system.start.y, "start", START)
    if system.goal is not None:
        canvas.disc(system.goal.x, system.goal.y, system.goal_tolerance, None, GREEN)
        canvas.text(system.goal.x, system.goal.y, "goal", system.goal_tolerance)
    _draw_times(canvas, episode)
    canvas.frame()
    return canvas.finished()


def _run_keys(episode: Episode, obstacles: Collection[Key]) -> list[Key]:
    """The legend of a run, with entries only for what is drawn."""
    recorder = episode.recorder
    keys = [] if recorder.map is None else _map_keys(recorder.map)
    keys += [key for key in (TRUE, ABOVE) if key in obstacles]
    keys += [Key("plan", ORANGE, "line")] * bool(recorder.plans)
    keys += [Key("trajectory", BLUE, "line")] * bool(recorder.trajectories)
    drove = {driver for _, driver in recorder.drivers} or {"controller"}
    keys += [key for driver, key in DRIVERS.items() if driver in drove]
    return [*keys, Key(f"robot every {OUTLINE_EVERY:g} s", FOOTPRINT, "outline")]


def _map_keys(update: MapUpdate) -> list[Key]:
    """Legend of a map: segments black and cells grey; without segments, cells black."""
    unknown = Key("unknown", UNKNOWN)
    if not len(update.segments):
        return [Key("occupied cells of the map", BLACK), unknown]
    return [Key("outlines in the map", BLACK, "line"), Key("occupied cells of the map", CELLS), unknown]


def _extent(episode: Episode) -> Rectangle:
    """Bounds of the picture, m: start, plans and track with a margin, and what stands near them."""
    points = [episode.recorder.driven, *(path.points for path in episode.recorder.plans)]
    start = episode.system.start
    return extent_of(np.concatenate([np.array([(start.x, start.y)]), *points]), episode.system.world, around=1.5)


def _draw_map(canvas: Canvas, update: MapUpdate) -> None:
    canvas.grid(update.grid, CELLS if len(update.segments) else BLACK)
    for ends in update.segments.reshape(-1, 2, 2):
        canvas.line(ends, BLACK, 3.0)


def _obstacles_in(extent: Rectangle, episode: Episode) -> list[tuple[Floats, Key]]:
    """Outline, m, of each true obstacle within the extent at the end of the run, and its legend entry."""
    world, height, truth = episode.system.world, episode.system.robot.height, episode.recorder.truth
    time = truth[-1][0] if truth else 0.0
    turns = np.linspace(0.0, math.tau, 24, endpoint=False)
    circle = np.column_stack([np.cos(turns), np.sin(turns)])
    found = []
    for obstacle in () if world is None else world.obstacles:
        if isinstance(obstacle, Box):
            outline = box_corners(obstacle, time)
        else:
            outline = circle * obstacle.radius + centre_at(obstacle, time)
        if overlap((*outline.min(axis=0), *outline.max(axis=0)), extent):
            found.append((outline, TRUE if overlaps(obstacle.z, (0.0, height)) else ABOVE))
    return found


def _draw_outlines(canvas: Canvas, episode: Episode) -> None:
    """Draw the robot's footprint at intervals along the track."""
    outline = episode.system.robot.footprint
    every = max(1, round(OUTLINE_EVERY / episode.system.config.run.period))
    for _, x, y, heading, _, _ in episode.recorder.truth[::every]:
        canvas.polygon(transform(np.array([x, y, heading]), outline), None, FOOTPRINT)


def _draw_track(canvas: Canvas, episode: Episode) -> None:
    """Draw the true track, each part in the colour of the role that drove it."""
    recorder, driven = episode.recorder, episode.recorder.driven
    times = np.array([row[0] for row in recorder.truth])
    changes = recorder.drivers or [(0.0, "controller")]
    ends = [*(time for time, _ in changes[1:]), math.inf]
    canvas.line(driven[times <= changes[0][0]], DRIVERS[changes[0][1]].colour, 3.0)
    for (since, driver), until in zip(changes, ends, strict=True):
        first, last = np.searchsorted(times, (since, until))
        canvas.line(driven[first : last + 1], DRIVERS[driver].colour, 3.0)


def _draw_times(canvas: Canvas, episode: Episode) -> None:
    """Write the time at round intervals along the true track, s, and at its end."""
    truth = episode.recorder.truth
    if len(truth) < 2:
        return
    steps = (step * 10.0**power for power in range(5) for step in (1, 2, 5))
    step = next(step for step in steps if truth[-1][0] / step <= MOST_TIMES)
    times = np.array([row[0] for row in truth])
    for time in [*np.arange(step, times[-1] - 0.3 * step, step).tolist(), float(times[-1])]:
        _, x, y, *_ = truth[min(int(np.searchsorted(times, time)), len(truth) - 1)]
        canvas.disc(x, y, 0.6 * START, None, BLACK)
        canvas.text(x, y, f"{time:.3g} s", 0.6 * START)

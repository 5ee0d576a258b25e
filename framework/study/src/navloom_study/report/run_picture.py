"""Draws a run: the robot's map, the plan, the trajectory and the driven track."""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.transforms import Bbox
from navloom.geometry.cells import places_of
from navloom.geometry.frames import transform
from navloom.geometry.moving_world import standing
from navloom.geometry.solids import overlaps
from navloom.geometry.world import Obstacle
from navloom.messages import MapUpdate, OccupancyGrid
from navloom.palette import OKABE_ITO
from navloom.runs.episode import Episode
from navloom.runs.fleet import Fleet
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from navloom_study.report.extent import extent_of
from navloom_study.report.plan_view import (
    add_legend,
    draw_cells,
    draw_footprints,
    draw_lines,
    draw_outlines,
    outline_of,
    outline_of_part,
    plan_figure,
    write_beside,
)
from navloom_study.report.plotting import styled

__all__ = ["draw_fleet", "draw_map_update", "draw_poses", "draw_run"]

Floats = NDArray[np.float64]
BLUE, VERMILION, GREEN, PINK, ORANGE, SKY = OKABE_ITO[:6]
BLACK, CELLS, FREE, UNKNOWN, FOOTPRINT = "#1E1E1E", "#BEBEBE", "#FFFFFF", "#E2E7EE", "#EBAF91"
WIDTH = 180.0
"""Width of a picture, mm."""
AROUND = 1.5
"""Margin around a run, m."""
MOVING = "#666699"
JUMP = 1.0
"""A body that is farther than this from where it was a tick before has begun its course again, m."""
MOST_TIMES = 9
"""Most times written along a track."""
OUTLINE_EVERY = 2.0
"""Interval of the robot's outlines, s."""
DRIVERS = {
    "controller": ("driven by the controller", VERMILION),
    "avoider": ("by the avoider", "#AA4499"),
    "recovery": ("by the recovery", "#664400"),
    "operator": ("by the operator", GREEN),
}
"""Name and colour of the parts of the track that each role drove."""
OBSTACLES: dict[str, tuple[str, dict[str, Any]]] = {
    "true obstacles": (SKY, {}),
    "not on the map": (PINK, {"facecolors": PINK, "alpha": 0.6}),
    "glass": (SKY, {"facecolors": SKY, "linewidths": 1.6}),
    "above the robot": (SKY, {"linestyles": (0, (5, 3))}),
}
"""Colour and style of the true obstacles, by their name in the legend."""


@styled()
def draw_map_update(update: MapUpdate, way: Floats | None = None) -> Figure:
    """Draw a map: its cells grey or black, its segments black, the origin of the map frame marked.

    Args:
        update: The map.
        way: (n, 2) track of the robot, m, map frame; None if it did not move.
    """
    grid = update.grid
    rows, cols = grid.cells.shape
    corners = np.array([(0, 0), (cols, 0), (cols, rows), (0, rows)], dtype=np.float64) * grid.resolution
    outline = transform(np.array([grid.origin.x, grid.origin.y, grid.origin.heading]), corners)
    figure, axes = plan_figure(WIDTH, (*outline.min(axis=0), *outline.max(axis=0)))
    _draw_map(axes, update)
    draw_lines(axes, [] if way is None else [way], VERMILION, "driven", 1.5)
    _mark(axes, 0.0, 0.0, name="sensor" if way is None else "start")
    add_legend(figure, axes)
    return figure


@styled()
def draw_poses(poses: Floats, known: OccupancyGrid | None, is_tracking: NDArray[np.bool_]) -> Figure:
    """Draw the tracks of odometry and of a localizer on the map that it was given; odometry is cut off beyond the map.

    Of the map it draws the edges of occupied space only, because large maps are mostly occupied or unknown.

    Args:
        poses: (n, 7) time, s, then x, y, m, heading, rad, by odometry and by the localizer, map frame.
        known: The map; None for none.
        is_tracking: (n,) whether the localizer was tracking.
    """
    odometry, localizer = poses[:, 1:3], poses[:, 4:6]
    shown = odometry
    if known is not None:
        edges = known.cells >= 50
        edges &= binary_dilation(~edges)
        shown = places_of(known, np.argwhere(edges))
    seen = np.vstack([shown, localizer])
    figure, axes = plan_figure(WIDTH, (*seen.min(axis=0) - 1.0, *seen.max(axis=0) + 1.0))
    if known is not None:
        _draw_raster(axes, known, edges.view(np.uint8), {"": "none", "edges of the map's occupied space": BLACK})
    draw_lines(axes, [odometry], BLUE, "odometry", 0.8)
    draw_lines(axes, [localizer], VERMILION, "localizer", 1.5)
    places = np.flatnonzero(~is_tracking)
    stretches = [part for part in np.split(places, np.flatnonzero(np.diff(places) > 1) + 1) if len(part) > 1]
    draw_lines(axes, (localizer[stretch] for stretch in stretches), ORANGE, "localizer while not tracking", 3.0)
    add_legend(figure, axes)
    return figure


@styled()
def draw_run(episode: Episode) -> Figure:
    """Draw map, plan, trajectory and true track of a finished run, with start, goal and the true obstacles."""
    recorder, system = episode.recorder, episode.system
    start, goal = system.drawn_start, system.goal
    points = [np.array([(start.x, start.y)]), recorder.driven, *(path.points for path in recorder.plans)]
    figure, axes = plan_figure(WIDTH, extent_of(np.concatenate(points), system.world, AROUND))
    if recorder.map is not None:
        _draw_map(axes, recorder.map)
    _draw_obstacles(axes, episode)
    _draw_bodies(axes, episode)
    draw_lines(axes, (path.points for path in recorder.plans), ORANGE, "plan")
    draw_lines(axes, (trajectory.samples[:, 1:3] for trajectory in recorder.trajectories), BLUE, "trajectory")
    every = max(1, round(OUTLINE_EVERY / system.config.run.period))
    poses = [row[1:4] for row in recorder.truth[::every]]
    _draw_track(axes, episode)
    _draw_contacts(axes, [episode])
    draw_footprints(axes, poses, system.robot.footprint, FOOTPRINT, f"robot every {OUTLINE_EVERY:g} s")
    _mark(axes, start.x, start.y)
    texts = [(start.x, start.y, "start", 0.0)]
    if goal is not None:
        axes.add_patch(Circle((goal.x, goal.y), system.goal_tolerance, fill=False, edgecolor=GREEN, zorder=3))
        texts.append((goal.x, goal.y, "goal", system.goal_tolerance))
    for time, x, y in _times(episode):
        axes.plot(x, y, "o", color=BLACK, markersize=3.5, markerfacecolor="none", markeredgewidth=0.6, zorder=4)
        texts.append((x, y, f"{time:.3g} s", 0.0))
    add_legend(figure, axes)
    write_beside(axes, texts)
    return figure


@styled()
def draw_fleet(fleet: Fleet) -> Figure:
    """Draw the true track of each member of a finished fleet, with starts, goals, contacts and the true obstacles."""
    episodes = fleet.episodes
    systems = [episode.system for episode in episodes.values()]
    starts = np.array([(system.true_start.x, system.true_start.y) for system in systems])
    points = [starts, *(episode.recorder.driven for episode in episodes.values())]
    figure, axes = plan_figure(WIDTH, extent_of(np.concatenate(points), systems[0].world, AROUND))
    longest = max(episodes.values(), key=lambda episode: episode.log.ticks)
    _draw_obstacles(axes, longest)
    _draw_bodies(axes, longest)
    texts = []
    for number, (name, episode) in enumerate(episodes.items()):
        recorder, system, colour = episode.recorder, episode.system, OKABE_ITO[number % len(OKABE_ITO)]
        draw_lines(axes, [recorder.driven], colour, name if len(episodes) <= len(OKABE_ITO) else "", 1.6, zorder=3)
        every = max(1, round(OUTLINE_EVERY / system.config.run.period))
        draw_footprints(axes, (row[1:4] for row in recorder.truth[::every]), system.robot.footprint, colour, "")
        _mark(axes, *starts[number])
        texts.append((*starts[number], name, 0.0))
        if system.goal is not None:
            place = (system.goal.x, system.goal.y)
            axes.add_patch(Circle(place, system.goal_tolerance, fill=False, edgecolor=colour, zorder=3))
    _draw_contacts(axes, episodes.values())
    add_legend(figure, axes)
    write_beside(axes, texts)
    return figure


def _draw_map(axes: Any, update: MapUpdate) -> None:
    """Draw cells and segments; the cells are grey if there are segments, else black."""
    values = update.grid.cells
    kinds = (values >= 0).view(np.uint8) + (values >= 50)  # both of one byte: maps have millions of cells
    occupied = CELLS if len(update.segments) else BLACK
    axes.set_facecolor(UNKNOWN)
    draw_lines(axes, update.segments.reshape(-1, 2, 2), BLACK, "outlines in the map", 1.6)
    _draw_raster(axes, update.grid, kinds, {"unknown": UNKNOWN, "": FREE, "occupied cells of the map": occupied})


def _draw_raster(axes: Any, grid: OccupancyGrid, kinds: NDArray[np.uint8], colours: dict[str, str]) -> None:
    """Draw the kinds of a grid's cells, and an entry of the legend for each kind with a name."""
    axes.grid(False)
    draw_cells(axes, kinds, grid.origin, grid.resolution, tuple(colours.values()))
    for name in filter(None, colours):
        axes.plot([], [], "s", color=colours[name], markersize=7, label=name)


def _mark(axes: Any, x: float, y: float, name: str | None = None) -> None:
    axes.plot(x, y, "o", color=GREEN, markersize=7, markeredgecolor=BLACK, markeredgewidth=0.7, label=name, zorder=4)


def _draw_obstacles(axes: Any, episode: Episode) -> None:
    """Draw the true obstacles in the picture, at the end of the run; those above the robot dashed."""
    world, height, truth = episode.system.world, episode.system.robot.height, episode.recorder.truth
    outlines: dict[str, list[Floats]] = {name: [] for name in OBSTACLES}
    moves = episode.recorder.bodies
    for obstacle in () if world is None else standing(world).obstacles if moves else world.obstacles:
        outline = outline_of(obstacle, truth[-1][0] if truth else 0.0)
        if Bbox([outline.min(axis=0), outline.max(axis=0)]).overlaps(axes.viewLim):
            outlines[_called(obstacle, height)].append(outline)
    for name, (colour, style) in OBSTACLES.items():
        draw_outlines(axes, outlines[name], colour, name, **style)


def _draw_bodies(axes: Any, episode: Episode) -> None:
    """Draw where each body went that is not the robot, and its outline at the times of the robot's."""
    seen, height = episode.recorder.bodies, episode.system.robot.height
    ways: dict[str, list[list[tuple[float, float]]]] = {}
    before: tuple[str, ...] = ()
    for bodies in seen:
        names = bodies.names[: len(bodies.names) - bodies.robots]
        for name, (x, y, _) in zip(names, bodies.poses.tolist(), strict=False):
            pieces = ways.setdefault(name, [])
            # A body that was not there before, or that begins its course again elsewhere, begins another line.
            if name not in before or math.dist(pieces[-1][-1], (x, y)) > JUMP:
                pieces.append([])
            pieces[-1].append((x, y))
        before = names
    lines = [np.array(piece) for pieces in ways.values() for piece in pieces]
    draw_lines(axes, lines, MOVING, f"moving bodies, every {OUTLINE_EVERY:g} s", 0.8, linestyles=":", zorder=2.5)
    every = max(1, round(OUTLINE_EVERY / episode.system.config.run.period))
    outlines = [
        outline_of_part(part)
        for bodies in seen[::every]
        for part in bodies.parts.tolist()
        if part[0] < len(bodies.names) - bodies.robots and overlaps((part[6], part[7]), (0.0, height))
    ]
    draw_outlines(axes, outlines, MOVING, alpha=0.6, zorder=2.5)


def _draw_contacts(axes: Any, episodes: Iterable[Episode]) -> None:
    """Mark each contact that began, by whose it is; without anything that moves, all are the robot's."""
    touches = [touch for episode in episodes for touch in episode.trail.contacts]
    for is_own, name, face in ((True, "contact of its own", VERMILION), (False, "the other's contact", "white")):
        places = [(touch.x, touch.y) for touch in touches if touch.is_own == is_own]
        if places:
            axes.plot(*np.array(places).T, "X", color=face, markersize=8, markeredgecolor=BLACK, markeredgewidth=0.8,
                      label=name, zorder=7)  # fmt: skip


def _called(obstacle: Obstacle, height: float) -> str:
    """The entry of `OBSTACLES` for an obstacle in the world of a robot of this height, m."""
    if not overlaps(obstacle.z, (0.0, height)):
        return "above the robot"
    if obstacle.material == "glass":
        return "glass"
    return "true obstacles" if obstacle.is_mapped else "not on the map"


def _draw_track(axes: Any, episode: Episode) -> None:
    """Draw the true track, each part in the colour of the role that drove it, and where the robot was displaced."""
    recorder, driven = episode.recorder, episode.recorder.driven
    carried = np.flatnonzero(episode.trail.carried)
    draw_lines(axes, (driven[tick - 1 : tick + 1] for tick in carried if tick), BLACK, "displaced", linestyles=":")
    times = np.array([row[0] for row in recorder.truth])
    changes = recorder.drivers or [(0.0, "controller")]
    parts: dict[str, list[Floats]] = {driver: [] for driver in DRIVERS}
    firsts = [0, *(int(np.searchsorted(times, time)) for time, _ in changes[1:]), len(times)]
    for (_, driver), (first, last) in zip(changes, pairwise(firsts), strict=True):
        cuts = carried[(carried > first) & (carried <= last)] - first
        parts[driver] += np.split(driven[first : last + 1], cuts)
    for driver, (name, colour) in DRIVERS.items():
        draw_lines(axes, parts[driver], colour, name, 1.6, zorder=3)


def _times(episode: Episode) -> list[tuple[float, float, float]]:
    """Round times along the true track and that of its end, s, each with x, y, m."""
    truth = episode.recorder.truth
    if len(truth) < 2:
        return []
    steps = (step * 10.0**power for power in range(5) for step in (1, 2, 5))
    step = next(step for step in steps if truth[-1][0] / step <= MOST_TIMES)
    times = np.array([row[0] for row in truth])
    shown = [*np.arange(step, times[-1] - 0.3 * step, step).tolist(), float(times[-1])]
    return [(time, *truth[min(int(np.searchsorted(times, time)), len(truth) - 1)][1:3]) for time in shown]

"""Draws driven tracks in their world: all methods in one figure, each method in its own, and single failures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from navloom.geometry.actors import Walk, parts_of
from navloom.geometry.solids import overlaps
from navloom.geometry.world import World

from navloom_study.episode_rows import Row
from navloom_study.report.extent import extent_of
from navloom_study.report.figures import PAIR, PANEL, line_of, nested_width, shortened
from navloom_study.report.plan_view import (
    draw_cells,
    draw_lines,
    draw_outlines,
    outline_of,
    outline_of_part,
    plan_figure,
)
from navloom_study.report.plotting import styled
from navloom_study.report.study_files import StudyFiles
from navloom_study.tracks import StoredWay

__all__ = ["WorldWays", "draw_world", "failure_figure", "ways_figures", "ways_in", "worlds_shown"]

SEEDS = 10
"""Most tracks of one method in one panel."""
AROUND = 1.5
"""Margin around the tracks, m."""
DRIVEN = 0.1
"""Shortest extent of a track that counts as driving, m."""
WALL, GHOST, LATE, GLASS = "#6E6E6E", "#C2C2C2", "#E8E8E8", "#56B4E9"


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
        found = (way for told in self.tracks.values() for track, _ in told for way in (track, *track.others))
        return any(np.ptp(way.points, axis=0).max() > DRIVEN for way in found)


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


@styled()
def ways_figures(study: StudyFiles, ways: WorldWays) -> list[Figure]:
    """All methods overlaid, larger, then each by itself if there are several."""
    methods = study.methods
    figures = []
    for shown in [methods, *([[method] for method in methods] if len(methods) > 1 else [])]:
        figure, axes = _ways_figure(study, PAIR if shown is methods else PANEL, ways, shown)
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
    figure, _ = _ways_figure(study, PANEL, ways, [key.method])
    return figure


@styled()
def _ways_figure(study: StudyFiles, width: float, ways: WorldWays, shown: Sequence[str]) -> tuple[Figure, Any]:
    """The tracks of the methods shown in their world, in a figure `width` mm wide."""
    world = study.world(ways.world)
    told = [way for tracks in ways.tracks.values() for track, _ in tracks for way in (track, *track.others)]
    points = [track.points for track in told] + [track.goal[None] for track in told if track.goal is not None]
    figure, axes = plan_figure(width, extent_of(np.concatenate(points), world, AROUND))
    if world is not None:
        draw_world(axes, world, study.value("robot.height") or 2.0)
    alpha = max(0.35, min(0.95, 2.0 / math.sqrt(max(1, ways.seeds))))
    for number, method in enumerate(shown):
        style = line_of(study.methods.index(method))
        found = ((way, end, track) for track, end in ways.tracks[method] for way in (track, *track.others))
        for way, end, first in found:
            # White below each line, and later lines narrower: where tracks lie on each other, each stays visible.
            thick = nested_width(number, len(shown))
            axes.plot(*way.points.T, alpha=0.6, linewidth=thick + 0.7, color="white", zorder=3 + 0.1 * number)
            axes.plot(*way.points.T, alpha=alpha, linewidth=thick, zorder=3.05 + 0.1 * number, **style)
            # Of a fleet that failed, members that arrived have no cross.
            if end != "succeeded" and not (first.others and way.is_there):
                axes.plot(*way.points[-1], "X", color=style["color"], markersize=7.0, markeredgecolor="white",
                          markeredgewidth=0.5, zorder=6)  # fmt: skip
    for way in (told[0], *told[0].others) if told else ():
        axes.plot(*way.points[0], "o", color="black", markersize=5, zorder=7)
        if way.goal is not None:
            axes.plot(*way.goal, "*", color="black", markersize=10, markeredgecolor="white", zorder=7)
    return figure, axes


def draw_world(axes: Any, world: World, robot_height: float) -> None:
    """Draw obstacles: dark at the robot's height, pale above or below it, glass blue, moving ones with their path.

    What is not on the map is hatched.

    Args:
        axes: Matplotlib axes, m, map frame.
        world: The true world.
        robot_height: Height of the robot, m.
    """
    shapes: dict[tuple[str, str, str | None], list[Any]] = {}
    ways: dict[str, list[Any]] = {WALL: [], GHOST: []}
    for obstacle in world.obstacles:
        meets = overlaps(obstacle.z, (0.0, robot_height))
        late = obstacle.appears_after_sweep or obstacle.appears_at > 0.0
        colour = GHOST if not meets else GLASS if obstacle.material == "glass" else WALL
        is_unmapped = late or (meets and not obstacle.is_mapped)
        face = LATE if is_unmapped else colour if meets and not obstacle.waypoints else "none"
        shapes.setdefault((colour, face, "//////" if is_unmapped else None), []).append(outline_of(obstacle))
        if obstacle.waypoints:
            ways[colour].append(np.array(obstacle.waypoints)[:, 1:])
    for actor in world.actors:
        # Of one that gives way, where it sets out for: where it comes depends on the others.
        ways[WALL].append(np.array(actor.places[: 2 if isinstance(actor.course, Walk) else None]))
        (x, y), still = actor.places[0], (0.0, 0.0, 0.0, 0.0)
        (found,) = parts_of(actor.body, np.array([(x, y, *still)])).tolist()
        parts = [part for part in found if overlaps((part[5], part[6]), (0.0, robot_height))]
        shapes.setdefault((WALL, "none", None), []).extend(outline_of_part((0.0, *part)) for part in parts)
    for (colour, face, hatch), alike in shapes.items():
        draw_outlines(axes, alike, colour, facecolors=face, hatch=hatch)
    for colour, alike in ways.items():
        draw_lines(axes, alike, colour, "", 0.9, linestyles=":")
    raster = world.raster
    if raster is not None and overlaps(raster.z, (0.0, robot_height)):
        draw_cells(axes, raster.occupied.view(np.uint8), raster.origin, raster.resolution, ("none", WALL))

"""A run as a picture: the robot's map, the plan, the trajectory and the way it drove."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from navloom.geometry.frames import transform
from navloom.geometry.solids import box_corners, centre_at, overlaps
from navloom.geometry.world import Box, World
from navloom.messages import MapUpdate
from navloom.study.episode import Episode

__all__ = ["Canvas", "draw_map_update", "draw_run"]

Floats = NDArray[np.float64]
WIDTH, OVERSAMPLING, MARGIN = 1100, 2, 60
# Okabe & Ito's palette: told apart with any colour vision.
BLACK, ORANGE, SKY, GREEN, BLUE, VERMILION, GREY = (
    (30, 30, 30), (230, 159, 0), (86, 180, 233), (0, 158, 115), (0, 114, 178), (213, 94, 0), (150, 150, 150)
)  # fmt: skip


CELLS = (205, 205, 205)
START = 0.08
"""Radius of the disc that marks a start, m."""


class Canvas:
    """Draws in metres, map frame, y up; made larger and scaled down for smooth lines.

    Args:
        bounds: Lowest x, lowest y, highest x, highest y, m.
    """

    def __init__(self, bounds: tuple[float, float, float, float]) -> None:
        x0, y0, x1, y1 = bounds
        self.x0, self.y1 = x0, y1
        self.scale = OVERSAMPLING * (WIDTH - 2 * MARGIN) / max(x1 - x0, (y1 - y0) * 0.75)
        size = (
            round((x1 - x0) * self.scale) + 2 * OVERSAMPLING * MARGIN,
            round((y1 - y0) * self.scale) + 2 * OVERSAMPLING * MARGIN,
        )
        self.image = Image.new("RGB", size, "white")
        self.pen = ImageDraw.Draw(self.image)
        self.font = ImageFont.load_default(13 * OVERSAMPLING)
        self.bounds = bounds

    def pixels(self, points: Floats) -> list[tuple[float, float]]:
        """Pixel positions of (n, 2) points, m."""
        edge = OVERSAMPLING * MARGIN
        return [((x - self.x0) * self.scale + edge, (self.y1 - y) * self.scale + edge) for x, y in points]

    def line(self, points: Floats, colour: tuple[int, int, int], width: float) -> None:
        """A polyline; width in pixels of the finished picture."""
        if len(points) > 1:
            self.pen.line(self.pixels(points), fill=colour, width=round(width * OVERSAMPLING), joint="curve")

    def polygon(self, points: Floats, fill: tuple[int, int, int] | None, outline: tuple[int, int, int]) -> None:
        """A filled or empty polygon."""
        self.pen.polygon(self.pixels(points), fill=fill, outline=outline, width=OVERSAMPLING)

    def disc(
        self, x: float, y: float, radius: float, fill: tuple[int, int, int] | None, outline: tuple[int, int, int]
    ) -> None:
        """A disc of a radius in m."""
        ((u, v),) = self.pixels(np.array([(x, y)]))
        r = radius * self.scale
        self.pen.ellipse((u - r, v - r, u + r, v + r), fill=fill, outline=outline, width=OVERSAMPLING)

    def text(self, x: float, y: float, text: str, colour: tuple[int, int, int] = BLACK) -> None:
        """Text to the right of a point."""
        ((u, v),) = self.pixels(np.array([(x, y)]))
        self.pen.text((u + 5 * OVERSAMPLING, v - 7 * OVERSAMPLING), text, fill=colour, font=self.font)

    def cells(
        self, occupied: NDArray[np.bool_], corner: Floats, resolution: float, colour: tuple[int, int, int]
    ) -> None:
        """Every true cell of a raster; `corner` is the pose (x, y, heading) of its lower left corner."""
        square = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], dtype=np.float64)
        for row, col in np.argwhere(occupied):
            self.pen.polygon(self.pixels(transform(corner, (square + (col, row)) * resolution)), fill=colour)

    def frame(self) -> None:
        """Wipes what lies outside the bounds, and draws a frame in m with a tick at every 1, 2, 5, …"""
        x0, y0, x1, y1 = self.bounds
        (left, low), (right, high) = self.pixels(np.array([(x0, y0), (x1, y1)]))
        width, height = self.image.size
        for outside in ((0, 0, left, height), (right, 0, width, height), (0, 0, width, high), (0, low, width, height)):
            self.pen.rectangle(outside, fill="white")
        step = next(s * 10.0**e for e in range(-1, 5) for s in (1, 2, 5) if max(x1 - x0, y1 - y0) / (s * 10.0**e) < 14)
        self.polygon(np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)]), None, GREY)
        for x in np.arange(math.ceil(x0 / step) * step, x1 + 1e-9, step):
            ((u, v),) = self.pixels(np.array([(x, y0)]))
            self.pen.line((u, v, u, v + 6 * OVERSAMPLING), fill=GREY, width=OVERSAMPLING)
            self.pen.text((u, v + 8 * OVERSAMPLING), f"{x:g}", fill=GREY, font=self.font, anchor="ma")
        for y in np.arange(math.ceil(y0 / step) * step, y1 + 1e-9, step):
            ((u, v),) = self.pixels(np.array([(x0, y)]))
            self.pen.line((u - 6 * OVERSAMPLING, v, u, v), fill=GREY, width=OVERSAMPLING)
            self.pen.text((u - 9 * OVERSAMPLING, v), f"{y:g}", fill=GREY, font=self.font, anchor="rm")
        self.pen.text((right, low + 26 * OVERSAMPLING), "x, m", fill=GREY, font=self.font, anchor="ra")
        self.pen.text((left - 9 * OVERSAMPLING, high - 4 * OVERSAMPLING), "y, m", GREY, self.font, anchor="rb")

    def legend(self, entries: Sequence[tuple[str, tuple[int, int, int]]]) -> None:
        """Names of colours, in one line above the frame."""
        u, v = float(OVERSAMPLING * MARGIN), OVERSAMPLING * MARGIN * 0.35
        for name, colour in entries:
            box = (u, v, u + 14 * OVERSAMPLING, v + 14 * OVERSAMPLING)
            self.pen.rectangle(box, fill=colour)
            self.pen.text((u + 19 * OVERSAMPLING, v - OVERSAMPLING), name, fill=BLACK, font=self.font)
            u += (30 * OVERSAMPLING) + self.pen.textlength(name, font=self.font)

    def finished(self) -> Image.Image:
        """The picture at its final size."""
        size = (self.image.width // OVERSAMPLING, self.image.height // OVERSAMPLING)
        return self.image.resize(size, Image.Resampling.LANCZOS)


def draw_map_update(update: MapUpdate, way: Floats | None = None) -> Image.Image:
    """A map alone: its cells grey or black, its segments black, the origin of the map frame marked.

    Args:
        update: The map.
        way: (n, 2) where the robot went meanwhile, m, map frame; None where it stood.
    """
    grid = update.grid
    rows, cols = grid.cells.shape
    corners = np.array([(0, 0), (cols, 0), (cols, rows), (0, rows)], dtype=np.float64) * grid.resolution
    outline = transform(np.array([grid.origin.x, grid.origin.y, grid.origin.heading]), corners)
    (x0, y0), (x1, y1) = outline.min(axis=0), outline.max(axis=0)
    canvas = Canvas((float(x0), float(y0), float(x1), float(y1)))
    _draw_map(canvas, update)
    if way is not None:
        canvas.line(way, VERMILION, 2.5)
    canvas.disc(0.0, 0.0, 0.01 * (x1 - x0), GREEN, BLACK)
    canvas.frame()
    cells = [("segments", BLACK), ("occupied cells", CELLS)] if len(update.segments) else [("occupied cells", BLACK)]
    canvas.legend([*cells, ("sensor", GREEN)] if way is None else [*cells, ("start", GREEN), ("driven", VERMILION)])
    return canvas.finished()


def draw_run(episode: Episode) -> Image.Image:
    """Map, plan, trajectory and true way of a finished run, with start, goal and the world's own obstacles."""
    recorder, system = episode.recorder, episode.system
    canvas = Canvas(_extent(episode))
    if recorder.map is not None:
        _draw_map(canvas, recorder.map)
    if system.world is not None:
        _draw_world(canvas, system.world, system.robot.height, recorder.truth[-1][0] if recorder.truth else 0.0)
    for path in recorder.plans:
        canvas.line(path.points, ORANGE, 2.5)
    for trajectory in recorder.trajectories:
        canvas.line(trajectory.samples[:, 1:3], BLUE, 2.5)
    _draw_outlines(canvas, episode)
    canvas.line(recorder.driven, VERMILION, 2.5)
    canvas.disc(system.start.x, system.start.y, START, GREEN, BLACK)
    canvas.text(system.start.x + START, system.start.y, "S")
    if system.goal is not None:
        canvas.disc(system.goal.x, system.goal.y, system.goal_tolerance, None, GREEN)
        canvas.text(system.goal.x + system.goal_tolerance, system.goal.y, "D")
    canvas.frame()
    canvas.legend(
        [("map", BLACK), ("true obstacles", SKY), ("plan", ORANGE), ("trajectory", BLUE), ("driven", VERMILION)]
    )
    return canvas.finished()


def _extent(episode: Episode) -> tuple[float, float, float, float]:
    """What there is to see: the world's bounds, cut to the surroundings of plan and way where those are small."""
    points = [episode.recorder.driven, *(path.points for path in episode.recorder.plans)]
    start = episode.system.start
    seen = np.concatenate([np.array([(start.x, start.y)]), *points])
    low, high = seen.min(axis=0) - 3.0, seen.max(axis=0) + 3.0
    world = episode.system.world
    if world is not None:
        low, high = np.maximum(low, world.bounds[:2]), np.minimum(high, world.bounds[2:])
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def _draw_map(canvas: Canvas, update: MapUpdate) -> None:
    grid = update.grid
    corner = np.array([grid.origin.x, grid.origin.y, grid.origin.heading])
    rows, cols = np.nonzero(grid.cells >= 50)
    centres = transform(corner, np.column_stack((cols + 0.5, rows + 0.5)) * grid.resolution)
    x0, y0, x1, y1 = canvas.bounds
    inside = (centres[:, 0] > x0) & (centres[:, 0] < x1) & (centres[:, 1] > y0) & (centres[:, 1] < y1)
    shown = np.zeros(grid.cells.shape, dtype=np.bool_)
    shown[rows[inside], cols[inside]] = True
    canvas.cells(shown, corner, grid.resolution, CELLS if len(update.segments) else BLACK)
    for ends in update.segments.reshape(-1, 2, 2):
        canvas.line(ends, BLACK, 3.0)


def _draw_world(canvas: Canvas, world: World, height: float, time: float) -> None:
    """Outlines of what reaches into the robot's height, thin where only higher or lower things are."""
    for obstacle in world.obstacles:
        colour = SKY if overlaps(obstacle.z, (0.0, height)) else (200, 225, 240)
        if isinstance(obstacle, Box):
            canvas.polygon(box_corners(obstacle, time), None, colour)
        else:
            canvas.disc(*centre_at(obstacle, time), obstacle.radius, None, colour)


def _draw_outlines(canvas: Canvas, episode: Episode) -> None:
    """The robot's footprint every two seconds."""
    outline = episode.system.robot.footprint
    every = max(1, round(2.0 / episode.system.config.run.period))
    for _, x, y, heading, _, _ in episode.recorder.truth[::every]:
        canvas.polygon(transform(np.array([x, y, heading]), outline), None, (240, 200, 180))

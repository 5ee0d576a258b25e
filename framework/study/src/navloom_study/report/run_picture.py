"""Draws a run: the robot's map, the plan, the trajectory and the driven track."""

from __future__ import annotations

import io
import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from navloom.geometry.cells import places_of
from navloom.geometry.frames import transform
from navloom.geometry.solids import box_corners, centre_at, overlaps
from navloom.geometry.world import Box
from navloom.messages import MapUpdate, OccupancyGrid
from navloom.runs.episode import Episode
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from scipy.ndimage import binary_dilation

__all__ = ["Canvas", "Key", "draw_map_update", "draw_poses", "draw_run", "png_of"]

Floats = NDArray[np.float64]
Colour = tuple[int, int, int]
Rectangle = tuple[float, float, float, float]
"""Smallest u, smallest v, largest u, largest v, pixels of the canvas; or the same in x and y, m."""
WIDTH, OVERSAMPLING, MARGIN = 1100, 2, 60
# Palette of Okabe and Ito, suitable for any colour vision.
BLACK, ORANGE, SKY, GREEN, BLUE, VERMILION, GREY = (
    (30, 30, 30), (230, 159, 0), (86, 180, 233), (0, 158, 115), (0, 114, 178), (213, 94, 0), (150, 150, 150)
)  # fmt: skip


CELLS, FOOTPRINT = (205, 205, 205), (235, 175, 145)
START = 0.08
"""Radius of the disc that marks a start, m."""
OUTLINE_EVERY = 2.0
"""Interval of the robot's outlines, s."""
DASH, GAP = 9.0, 6.0
"""Dash and gap of a dashed line, pixels of the finished picture."""
ROW, SWATCH = 22, 24
"""Height of a legend row and width of the sample before each name, pixels of the finished picture."""


@dataclass(frozen=True)
class Key:
    """One entry of a legend.

    Attributes:
        name: What the sample represents.
        colour: Its colour.
        shape: Shape of the sample; "dashed" is a dashed outline.
    """

    name: str
    colour: Colour
    shape: Literal["fill", "line", "outline", "dashed", "disc"] = "fill"


DRIVEN = Key("driven", VERMILION, "line")
TRUE, ABOVE = Key("true obstacles", SKY, "outline"), Key("above the robot", SKY, "dashed")


# Drawn by Pillow and not by matplotlib: PNG maps need Pillow anyway, so that `--out` works without the plotting extra.
class Canvas:
    """Draws in metres, map frame, y up. It is drawn larger and scaled down for smooth lines.

    Args:
        bounds: Lowest x, lowest y, highest x, highest y, m.
        keys: The legend, in rows above the frame.
    """

    def __init__(self, bounds: Rectangle, keys: Sequence[Key]) -> None:
        x0, y0, x1, y1 = bounds
        self.x0, self.y1 = x0, y1
        self.scale = OVERSAMPLING * (WIDTH - 2 * MARGIN) / max(x1 - x0, (y1 - y0) * 0.75)
        self.font = ImageFont.load_default(13 * OVERSAMPLING)
        self.bounds = bounds
        width = round((x1 - x0) * self.scale) + 2 * OVERSAMPLING * MARGIN
        self._legend, more = self._rows(keys, width - OVERSAMPLING * MARGIN)
        self._top = OVERSAMPLING * MARGIN + more
        height = round((y1 - y0) * self.scale) + self._top + OVERSAMPLING * MARGIN
        self.image = Image.new("RGB", (width, height), "white")
        self.pen = ImageDraw.Draw(self.image)
        self._texts: list[Rectangle] = []

    def pixels(self, points: Floats) -> list[tuple[float, float]]:
        """Pixel positions of (n, 2) points, m."""
        edge = OVERSAMPLING * MARGIN
        return [((x - self.x0) * self.scale + edge, (self.y1 - y) * self.scale + self._top) for x, y in points]

    def line(self, points: Floats, colour: Colour, width: float) -> None:
        """Draw a polyline; width in pixels of the finished picture."""
        if len(points) > 1:
            self.pen.line(self.pixels(points), fill=colour, width=round(width * OVERSAMPLING), joint="curve")

    def polygon(self, points: Floats, fill: Colour | None, outline: Colour) -> None:
        """Draw a filled or empty polygon."""
        self.pen.polygon(self.pixels(points), fill=fill, outline=outline, width=OVERSAMPLING)

    def dashed(self, points: Floats, outline: Colour) -> None:
        """Draw a dashed polygon."""
        _dashed_polygon(self.pen, self.pixels(points), outline)

    def disc(self, x: float, y: float, radius: float, fill: Colour | None, outline: Colour) -> None:
        """Draw a disc; position and radius in m."""
        ((u, v),) = self.pixels(np.array([(x, y)]))
        r = radius * self.scale
        self.pen.ellipse((u - r, v - r, u + r, v + r), fill=fill, outline=outline, width=OVERSAMPLING)

    def text(self, x: float, y: float, text: str, clear: float = 0.0) -> None:
        """Draw text beside a point, at least `clear` m away, with a white rim so that it is legible on any background.

        Of the four sides it takes one inside the frame, without other text and with the least drawing below it.
        """
        ((u, v),) = self.pixels(np.array([(x, y)]))
        away, rim = clear * self.scale + 5 * OVERSAMPLING, 3 * OVERSAMPLING
        sides = ((u + away, v, "lm"), (u - away, v, "rm"), (u, v + away, "ma"), (u, v - away, "md"))
        boxes = [self.pen.textbbox((a, b), text, self.font, anchor, stroke_width=rim) for a, b, anchor in sides]
        number = min(range(len(boxes)), key=lambda n: (self._is_taken(boxes[n]), self._ink(boxes[n])))
        a, b, anchor = sides[number]
        self._texts.append(boxes[number])
        self.pen.text((a, b), text, BLACK, self.font, anchor, stroke_width=rim, stroke_fill="white")

    def _is_taken(self, box: Rectangle) -> bool:
        """Whether the box overlaps another text or is partly outside the frame."""
        (left, low), (right, high) = self.pixels(np.array([self.bounds[:2], self.bounds[2:]]))
        is_inside = left <= box[0] and box[2] <= right and high <= box[1] and box[3] <= low
        return not is_inside or any(_overlap(box, other) for other in self._texts)

    def _ink(self, box: Rectangle) -> int:
        """Number of pixels in the box that are not white."""
        left, top, right, bottom = (round(edge) for edge in box)
        return int((np.asarray(self.image.crop((left, top, right, bottom))) < 255).any(axis=2).sum())

    def cells(self, occupied: NDArray[np.bool_], corner: Floats, resolution: float, colour: Colour) -> None:
        """Draw every true cell of a raster; `corner` is the pose of its lower left corner: x, y, m, heading, rad."""
        square = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], dtype=np.float64)
        for row, col in np.argwhere(occupied):
            self.pen.polygon(self.pixels(transform(corner, (square + (col, row)) * resolution)), fill=colour)

    def frame(self) -> None:
        """Clear the area outside the bounds; draw the legend, and a frame with ticks in m at steps of 1, 2, 5, …"""
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
        self.pen.text((left - 9 * OVERSAMPLING, high - 11 * OVERSAMPLING), "y, m", GREY, self.font, anchor="rb")

        for key, (u, v) in self._legend:
            _sample(self.pen, key, (u, v, u + SWATCH * OVERSAMPLING, v + 14 * OVERSAMPLING))
            self.pen.text((u + (SWATCH + 5) * OVERSAMPLING, v - OVERSAMPLING), key.name, BLACK, self.font)

    def _rows(self, keys: Sequence[Key], right: float) -> tuple[list[tuple[Key, tuple[float, float]]], int]:
        """Position of each legend entry, and the additional height of the legend compared to one row, pixels."""
        left, top = float(OVERSAMPLING * MARGIN), 0.3 * OVERSAMPLING * MARGIN
        places, u, v = [], left, top
        for key in keys:
            wide = (SWATCH + 5) * OVERSAMPLING + self.font.getlength(key.name)
            if left < u and right < u + wide:
                u, v = left, v + ROW * OVERSAMPLING
            places.append((key, (u, v)))
            u += wide + 18 * OVERSAMPLING
        return places, round(v - top)

    def finished(self) -> Image.Image:
        """The picture at its final size."""
        size = (self.image.width // OVERSAMPLING, self.image.height // OVERSAMPLING)
        return self.image.resize(size, Image.Resampling.LANCZOS)


def _overlap(rectangle: Rectangle, other: Rectangle) -> bool:
    return rectangle[0] < other[2] and other[0] < rectangle[2] and rectangle[1] < other[3] and other[1] < rectangle[3]


def _dashed_polygon(pen: ImageDraw.ImageDraw, corners: Sequence[tuple[float, float]], colour: Colour) -> None:
    """Draw dashes from each corner to the next, in pixels."""
    for (u0, v0), (u1, v1) in zip(corners, [*corners[1:], corners[0]], strict=True):
        length = math.hypot(u1 - u0, v1 - v0)
        for begin in np.arange(0.0, length, (DASH + GAP) * OVERSAMPLING):
            ends = [share / length for share in (begin, min(length, begin + DASH * OVERSAMPLING))]
            pen.line([(u0 + s * (u1 - u0), v0 + s * (v1 - v0)) for s in ends], fill=colour, width=OVERSAMPLING)


def _sample(pen: ImageDraw.ImageDraw, key: Key, box: Rectangle) -> None:
    """Draw the sample before a name in the legend."""
    left, top, right, bottom = box
    middle, half = 0.5 * (top + bottom), 0.5 * (bottom - top)
    if key.shape == "line":
        pen.line((left, middle, right, middle), fill=key.colour, width=3 * OVERSAMPLING)
    elif key.shape == "dashed":
        _dashed_polygon(pen, [(left, top), (right, top), (right, bottom), (left, bottom)], key.colour)
    elif key.shape == "disc":
        centre = 0.5 * (left + right)
        pen.ellipse((centre - half, top, centre + half, bottom), key.colour, BLACK, OVERSAMPLING)
    else:
        pen.rectangle(box, key.colour if key.shape == "fill" else None, key.colour, OVERSAMPLING)


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


def png_of(picture: Image.Image) -> bytes:
    """A picture as a PNG file."""
    file = io.BytesIO()
    picture.save(file, format="PNG")
    return file.getvalue()


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
    canvas.line(recorder.driven, VERMILION, 2.5)
    canvas.disc(system.start.x, system.start.y, START, GREEN, BLACK)
    canvas.text(system.start.x, system.start.y, "start", START)
    if system.goal is not None:
        canvas.disc(system.goal.x, system.goal.y, system.goal_tolerance, None, GREEN)
        canvas.text(system.goal.x, system.goal.y, "goal", system.goal_tolerance)
    canvas.frame()
    return canvas.finished()


def _run_keys(episode: Episode, obstacles: Collection[Key]) -> list[Key]:
    """The legend of a run, with entries only for what is drawn."""
    recorder = episode.recorder
    keys = [] if recorder.map is None else _map_keys(recorder.map)
    keys += [key for key in (TRUE, ABOVE) if key in obstacles]
    keys += [Key("plan", ORANGE, "line")] * bool(recorder.plans)
    keys += [Key("trajectory", BLUE, "line")] * bool(recorder.trajectories)
    return [*keys, DRIVEN, Key(f"robot every {OUTLINE_EVERY:g} s", FOOTPRINT, "outline")]


def _map_keys(update: MapUpdate) -> list[Key]:
    """Legend of a map: segments black and cells grey; without segments, cells black."""
    if not len(update.segments):
        return [Key("occupied cells of the map", BLACK)]
    return [Key("outlines in the map", BLACK, "line"), Key("occupied cells of the map", CELLS)]


def _extent(episode: Episode) -> tuple[float, float, float, float]:
    """Bounds of the picture, m: start, plans and track with a margin, cut to the world's bounds."""
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
    centres = places_of(grid, np.column_stack((rows, cols)))
    x0, y0, x1, y1 = canvas.bounds
    inside = (centres[:, 0] > x0) & (centres[:, 0] < x1) & (centres[:, 1] > y0) & (centres[:, 1] < y1)
    shown = np.zeros(grid.cells.shape, dtype=np.bool_)
    shown[rows[inside], cols[inside]] = True
    canvas.cells(shown, corner, grid.resolution, CELLS if len(update.segments) else BLACK)
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
        if _overlap((*outline.min(axis=0), *outline.max(axis=0)), extent):
            found.append((outline, TRUE if overlaps(obstacle.z, (0.0, height)) else ABOVE))
    return found


def _draw_outlines(canvas: Canvas, episode: Episode) -> None:
    """Draw the robot's footprint at intervals along the track."""
    outline = episode.system.robot.footprint
    every = max(1, round(OUTLINE_EVERY / episode.system.config.run.period))
    for _, x, y, heading, _, _ in episode.recorder.truth[::every]:
        canvas.polygon(transform(np.array([x, y, heading]), outline), None, FOOTPRINT)

"""A canvas in metres for pictures of maps and runs, with legend, frame and texts that do not hide each other."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from navloom.geometry.frames import transform
from navloom.messages import OccupancyGrid
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

__all__ = ["BLACK", "BLUE", "GREEN", "GREY", "ORANGE", "OVERSAMPLING", "SKY", "UNKNOWN", "VERMILION", "Canvas", "Key",
           "overlap", "png_of"]  # fmt: skip

Floats = NDArray[np.float64]
Colour = tuple[int, int, int]
Rectangle = tuple[float, float, float, float]
"""Smallest u, smallest v, largest u, largest v, pixels of the canvas; or the same in x and y, m."""
WIDTH, OVERSAMPLING, MARGIN = 1100, 2, 60
# Palette of Okabe and Ito, suitable for any colour vision.
BLACK, ORANGE, SKY, GREEN, BLUE, VERMILION, GREY = (
    (30, 30, 30), (230, 159, 0), (86, 180, 233), (0, 158, 115), (0, 114, 178), (213, 94, 0), (150, 150, 150)
)  # fmt: skip


FREE, UNKNOWN = (255, 255, 255), (226, 231, 238)
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
        return not is_inside or any(overlap(box, other) for other in self._texts)

    def _ink(self, box: Rectangle) -> int:
        """Number of pixels in the box that are neither free nor unknown."""
        left, top, right, bottom = (round(edge) for edge in box)
        return int((np.asarray(self.image.crop((left, top, right, bottom))) < min(UNKNOWN)).any(axis=2).sum())

    def cells(self, occupied: NDArray[np.bool_], corner: Floats, resolution: float, colour: Colour) -> None:
        """Draw every true cell of a raster; `corner` is the pose of its lower left corner: x, y, m, heading, rad."""
        square = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], dtype=np.float64)
        for row, col in np.argwhere(occupied):
            self.pen.polygon(self.pixels(transform(corner, (square + (col, row)) * resolution)), fill=colour)

    def grid(self, grid: OccupancyGrid, occupied: Colour) -> None:
        """Paint each pixel by its cell: occupied, free, or unknown, as is all outside of the grid."""
        edge, (width, height) = OVERSAMPLING * MARGIN, self.image.size
        # By pixel and not by cell: a large map has more cells than the picture has pixels.
        x = (np.arange(width) - edge) / self.scale + self.x0
        colours = np.array([UNKNOWN, FREE, occupied], dtype=np.uint8)
        cos, sin = math.cos(grid.origin.heading), math.sin(grid.origin.heading)
        rows, cols = grid.cells.shape
        for top in range(0, height, 256):
            v = np.arange(top, min(top + 256, height))
            y = self.y1 - (v[:, None] - self._top) / self.scale - grid.origin.y
            col = np.floor((cos * (x - grid.origin.x) + sin * y) / grid.resolution).astype(np.int64)
            row = np.floor((cos * y - sin * (x - grid.origin.x)) / grid.resolution).astype(np.int64)
            is_inside = (row >= 0) & (row < rows) & (col >= 0) & (col < cols)
            values = np.where(is_inside, grid.cells[np.clip(row, 0, rows - 1), np.clip(col, 0, cols - 1)], -1)
            kinds = np.where(values < 0, 0, np.where(values < 50, 1, 2))
            self.image.paste(Image.fromarray(colours[kinds]), (0, top))

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


def overlap(rectangle: Rectangle, other: Rectangle) -> bool:
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


def png_of(picture: Image.Image) -> bytes:
    """A picture as a PNG file."""
    file = io.BytesIO()
    picture.save(file, format="PNG")
    return file.getvalue()

"""Draws in plan view, map frame: cells, outlines, lines, and texts that do not hide each other."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.transforms import Affine2D, Bbox
from navloom.geometry.frames import transform
from navloom.geometry.solids import box_corners, centre_at
from navloom.geometry.world import Box, Obstacle, Place
from navloom.messages import Pose2D
from numpy.typing import NDArray

from navloom_study.report.plotting import MM, new_figure, styled

__all__ = ["add_legend", "draw_cells", "draw_footprints", "draw_lines", "draw_outlines", "outline_of",
           "outline_of_part", "plan_figure", "write_beside"]  # fmt: skip

Floats = NDArray[np.float64]
LABELS = 16.0
"""Room for the labels beside the axes, and for those below and a title, mm."""
TALLEST = 222.0
"""Largest height of a figure, mm: with its caption it fits on one page."""
WIDEST = 2.5
"""Largest ratio of the axes' width to their height: a straight track must not become a line."""
CELLS_TO_PIXEL = 1.4
"""Most cells drawn to a pixel of 100 dpi: √2 pixels of 200 dpi each, or a wall of one cell would have gaps."""
ROW, SAMPLE, LETTER = 3.8, 13.0, 1.3
"""Of the legend: height of a row, width of a sample with its gaps, and width of a letter, mm."""
_TURNS = np.linspace(0.0, math.tau, 36, endpoint=False)
_CIRCLE = np.column_stack([np.cos(_TURNS), np.sin(_TURNS)])
SIDES = ((1, 0, "left", "center"), (-1, 0, "right", "center"), (0, -1, "center", "top"), (0, 1, "center", "bottom"))


@styled()
def plan_figure(width: float, bounds: Sequence[float]) -> tuple[Figure, Any]:
    """A figure, `width` mm wide, and its axes with equal scales; they show the bounds and what fills the axes.

    Args:
        width: Width of the figure, mm.
        bounds: Lowest x, lowest y, highest x, highest y, m.
    """
    low, high = np.array(bounds[:2]), np.array(bounds[2:])
    across = width - LABELS
    up = max(across / WIDEST, min(across * (high[1] - low[1]) / (high[0] - low[0]), TALLEST - LABELS))
    figure, axes = new_figure(width, up + LABELS)
    size = np.array([across, up])
    (x0, y0), (x1, y1) = 0.5 * (low + high + np.outer((-1.0, 1.0), size * ((high - low) / size).max()))
    axes.set(aspect="equal", xlim=(x0, x1), ylim=(y0, y1), xlabel="x, m", ylabel="y, m")
    return figure, axes


@styled()
def add_legend(figure: Figure, axes: Any) -> None:
    """Add the legend above the axes of a `plan_figure`, which grows by it."""
    handles, names = axes.get_legend_handles_labels()
    if not names:
        return
    width, height = figure.get_size_inches() / MM
    columns = len(names)
    while columns > 1 and sum(_width(part) for part in np.array_split(names, columns)) > width:
        columns -= 1
    figure.set_size_inches(width * MM, (height + ROW * math.ceil(len(names) / columns)) * MM)
    figure.legend(handles, names, loc="outside upper left", ncols=columns)


def _width(names: Iterable[str]) -> float:
    """Width of a column of the legend, mm."""
    return SAMPLE + LETTER * max(map(len, names))


def draw_cells(
    axes: Any, kinds: NDArray[np.uint8], origin: Pose2D | Place, resolution: float, colours: Sequence[str]
) -> None:
    """Draw the part of a raster within the axes; of several cells in one pixel the one of the highest kind is shown.

    Args:
        axes: Matplotlib axes, m, map frame, with their limits.
        kinds: (rows, columns) number of each cell's colour.
        origin: Pose of the lower left corner, map frame.
        resolution: Side of a cell, m.
        colours: Colours, "none" for transparent.
    """
    cells_to_map = Affine2D().scale(resolution).rotate(origin.heading).translate(origin.x, origin.y)
    corners = cells_to_map.inverted().transform(axes.viewLim.corners())
    within = np.clip([corners.min(axis=0), corners.max(axis=0) + 1.0], 0, kinds.shape[::-1])
    (left, low), (right, high) = within.astype(int)
    if left == right or low == high:
        return
    kinds = kinds[low:high, left:right]
    every = math.ceil(np.ptp(axes.get_xlim()) / resolution / (CELLS_TO_PIXEL * axes.bbox.width))
    for axis in (0, 1) if every > 1 else ():
        kinds = np.maximum.reduceat(kinds, np.arange(0, kinds.shape[axis], every), axis=axis)
    tall, wide = every * np.array(kinds.shape)
    axes.imshow(kinds, cmap=ListedColormap(list(colours)), vmin=0, vmax=len(colours) - 1, origin="lower",
                extent=(left, left + wide, low, low + tall), interpolation="nearest",
                transform=cells_to_map + axes.transData, zorder=1)  # fmt: skip


def draw_lines(axes: Any, lines: Iterable[Floats], colour: str, name: str, width: float = 1.2, **style: Any) -> None:
    """Draw polylines, (n, 2) each, m, as one entry of the legend; nothing if none has two points."""
    drawn = [line for line in lines if len(line) > 1]
    if drawn:
        axes.add_collection(LineCollection(drawn, colors=colour, linewidths=width, label=name, **style), autolim=False)


def draw_outlines(axes: Any, outlines: Iterable[Floats], colour: str, name: str | None = None, **style: Any) -> None:
    """Draw polygons, (n, 2) corners each, m, as one entry of the legend; nothing if there are none."""
    drawn = list(outlines)
    if drawn:
        style = {"facecolors": "none", "linewidths": 0.7, "zorder": 2, **style}
        axes.add_collection(PolyCollection(drawn, edgecolors=colour, label=name, **style), autolim=False)


def draw_footprints(axes: Any, poses: Iterable[Sequence[float]], outline: Floats, colour: str, name: str) -> None:
    """Draw the robot's outline, (n, 2) m, base frame, at poses: x, y, m, heading, rad, map frame."""
    outlines = (transform(np.array(pose), outline) for pose in poses)
    draw_outlines(axes, outlines, colour, name, linewidths=0.5)


def outline_of(obstacle: Obstacle, time: float = 0.0) -> Floats:
    """(n, 2) corners of an obstacle at a run time, s: m, map frame. A disc is a polygon of 36 corners."""
    if isinstance(obstacle, Box):
        return box_corners(obstacle, time)
    return obstacle.radius * _CIRCLE + centre_at(obstacle, time)


def outline_of_part(part: Sequence[float]) -> Floats:
    """(n, 2) corners, m, map frame, of a row of `Bodies.parts`."""
    _, x, y, half, side, yaw, *_ = part
    if side > 0.0:
        corners = np.array([(half, side), (-half, side), (-half, -side), (half, -side)])
        return transform(np.array([x, y, yaw]), corners)
    return half * _CIRCLE + (x, y)


@styled()
def write_beside(axes: Any, texts: Iterable[tuple[float, float, str, float]]) -> None:
    """Write texts beside places, with a white rim so that they are legible on any background.

    Of its four sides each takes one inside the axes, without other text and with the fewest lines below it.

    Args:
        axes: Axes with everything else drawn.
        texts: x, y, m, the text, and its least distance from there, m.
    """
    axes.figure.draw_without_rendering()  # lays out
    frame, pixels = axes.get_window_extent(), axes.transData.transform
    scale = axes.transData.get_matrix()[0, 0] * 72.0 / axes.figure.dpi  # points in a metre
    # A thick line counts more than a thin one: its points are closer together.
    paths = [
        _along(pixels(path.vertices), 4.0 / drawn.get_linewidth()[0])
        for drawn in axes.collections for path in drawn.get_paths()
    ]  # fmt: skip
    lines = np.vstack([np.empty((0, 2)), *paths])
    taken: list[Bbox] = []
    for x, y, text, clear in texts:
        note = axes.annotate(text, (x, y), (0, 0), textcoords="offset points", fontsize=7, zorder=8,
                             path_effects=[withStroke(linewidth=2.5, foreground="white")])  # fmt: skip
        away = clear * scale + 6.0
        choices: list[tuple[bool, int, int, Bbox]] = []
        for across, up, ha, va in SIDES:
            note.set(position=(across * away, up * away), ha=ha, va=va)
            box = note.get_window_extent().padded(2.0)
            is_free = frame.contains(*box.min) and frame.contains(*box.max) and not box.count_overlaps(taken)
            choices.append((not is_free, box.count_contains(lines), len(choices), box))
        *_, number, box = min(choices, key=lambda choice: choice[:3])
        across, up, ha, va = SIDES[number]
        note.set(position=(across * away, up * away), ha=ha, va=va)
        taken.append(box)


def _along(points: Floats, distance: float) -> Floats:
    """Points at equal distances along a polyline, (n, 2); further apart on one that leaves the picture by far."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    at = np.linspace(0.0, along[-1], 1 + min(int(along[-1] / distance), 20_000))
    return np.column_stack([np.interp(at, along, points[:, 0]), np.interp(at, along, points[:, 1])])

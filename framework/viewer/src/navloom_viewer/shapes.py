"""Vertex arrays of drawn shapes, m: arcs, cones, rings, prisms."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from navloom.geometry.polylines import Polyline
from navloom.messages import Pose2D
from numpy.typing import NDArray

from navloom_viewer.colours import Colour

__all__ = [
    "arc_of_twist",
    "at_height",
    "cones",
    "label",
    "placed",
    "prism",
    "rgba_cells",
    "ring_bars",
    "slot_arcs",
    "stripes",
]  # fmt: skip

Floats = NDArray[np.float64]
STRIPE = 0.3
"""Length of the pieces of a line that several robots draw in turn, m."""


def at_height(points: Floats, z: float) -> Floats:
    """(n, 3) points from (n, 2) points and a height, m."""
    return np.column_stack([points, np.full(len(points), z)])


def placed(pose: Pose2D, points: Floats) -> Floats:
    """(n, 2) points given in a frame at `pose`, transformed to the parent frame of the pose."""
    cosine, sine = math.cos(pose.heading), math.sin(pose.heading)
    moved: Floats = points @ np.array([[cosine, sine], [-sine, cosine]]) + (pose.x, pose.y)
    return moved


def prism(outline: Floats, height: float, lift: float = 0.05) -> tuple[Floats, NDArray[np.uint32]]:
    """Vertices (2n + 2, 3) and triangles (m, 3) of the prism over a convex outline (n, 2) between two heights, m."""
    n = len(outline)
    low, high = at_height(outline, lift), at_height(outline, height)
    middle = outline.mean(axis=0)
    vertices = np.concatenate([low, high, [(*middle, lift), (*middle, height)]])
    here = np.arange(n)
    after = (here + 1) % n
    sides = [np.column_stack([here, after, after + n]), np.column_stack([here, after + n, here + n])]
    caps = [
        np.column_stack([after, here, np.full(n, 2 * n)]),
        np.column_stack([here + n, after + n, np.full(n, 2 * n + 1)]),
    ]
    return vertices, np.concatenate(sides + caps).astype(np.uint32)


def stripes(points: Floats, number: int, count: int) -> list[Floats]:
    """The pieces of a polyline (n, 2), m, that one of `count` robots draws; together they draw the whole line.

    Pieces are `STRIPE` long, or shorter if the line is too short for one piece each.
    """
    line = Polyline(points)
    if count == 1 or line.length == 0.0:
        return [points]
    length = min(STRIPE, line.length / count)
    pieces = []
    for begin in np.arange(number * length, line.length - 1e-9, count * length):
        end = min(begin + length, line.length)
        inside = line.along[(line.along > begin) & (line.along < end)]
        pieces.append(line.at(np.concatenate([[begin], inside, [end]])))
    return pieces


def arc_of_twist(vx: float, wz: float, seconds: float, z: float, steps: int = 12) -> Floats:
    """(steps, 3) points, m, that a constant velocity, m/s and rad/s, leads to from the origin."""
    times = np.linspace(0.0, seconds, steps)
    turned = wz * times
    if abs(wz) < 1e-6:
        points = np.column_stack([vx * times, np.zeros(steps)])
    else:
        points = np.column_stack([np.sin(turned), 1.0 - np.cos(turned)]) * (vx / wz)
    return at_height(points, z)


def cones(origins: Floats, bearings: Floats, half_angles: Floats, ranges: Floats, z: float) -> Floats:
    """(n, 7, 3) outlines of sonar cones: origin, one edge, arc and back. All input arrays are (n, …)."""
    shares = np.linspace(-1.0, 1.0, 5)
    turns = bearings[:, None] + shares * half_angles[:, None]
    arc = origins[:, None, :] + ranges[:, None, None] * np.stack([np.cos(turns), np.sin(turns)], axis=-1)
    outline = np.concatenate([origins[:, None, :], arc, origins[:, None, :]], axis=1)
    return np.concatenate([outline, np.full((*outline.shape[:2], 1), z)], axis=2)


def ring_bars(pose: Pose2D, densities: Floats, radius: float, unit: float, most: float, z: float) -> Floats:
    """(sectors, 2, 3) bars of a polar histogram around a pose, m, map frame.

    Args:
        pose: Centre.
        densities: (sectors,) in units of the threshold; sector 0 is along the map's x axis.
        radius: Inner radius of the bars, m.
        unit: Length of density 1, m.
        most: Density above which a bar is cut.
        z: Height, m.
    """
    turns = np.arange(len(densities)) * (math.tau / max(1, len(densities)))
    ways = np.column_stack([np.cos(turns), np.sin(turns)])
    outer = radius + 0.03 + unit * np.clip(densities, 0.0, most)
    ends = np.stack([ways * radius, ways * outer[:, None]], axis=1) + (pose.x, pose.y)
    return np.concatenate([ends, np.full((len(ends), 2, 1), z)], axis=2)


def slot_arcs(pose: Pose2D, slots: Floats, radius: float, z: float) -> Floats:
    """(k, 13, 3) arcs of free slots, (k, 2) first and last direction, rad, counter-clockwise, map frame."""
    wide = np.mod(slots[:, 1] - slots[:, 0], math.tau)
    wide[(wide == 0.0) & (slots[:, 1] != slots[:, 0])] = math.tau
    turns = slots[:, :1] + wide[:, None] * np.linspace(0.0, 1.0, 13)
    points = radius * np.stack([np.cos(turns), np.sin(turns)], axis=-1) + (pose.x, pose.y)
    return np.concatenate([points, np.full((*points.shape[:2], 1), z)], axis=2)


def rgba_cells(colours: NDArray[np.uint8]) -> tuple[bytes, int, int]:
    """Bytes, width and height of an image whose row 0 is the top, from (rows, cols, 4) with row 0 at the lowest y."""
    rows, cols = colours.shape[:2]
    return np.ascontiguousarray(colours[::-1]).tobytes(), cols, rows


def label(places: Sequence[tuple[float, ...]], names: Sequence[str], colour: Colour) -> Any:
    """Labels on invisible points, because a label is only as opaque as its shape."""
    import rerun as rr

    points = np.array(places).reshape(-1, 3)
    return rr.Points3D(points, radii=0.001, labels=names, colors=[colour], show_labels=True)

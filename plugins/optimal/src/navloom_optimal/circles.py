"""The circles that a shortest path of a disc turns around, and the path itself.

A shortest path among obstacles inflated by a disc consists of segments that touch two inflation arcs (or an end of the
path) and of parts of these arcs (Laumond 1987; Liu & Arimoto 1992).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from navloom_optimal.shapes import Shapes

__all__ = ["Circles", "ShortestPath", "circles_of", "on_arc"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_ARC_SAMPLE = math.radians(5.0)


@dataclass(frozen=True, eq=False)
class Circles:
    """Circles whose arcs a path may follow: start and goal, of radius 0, then four for each box, one a cylinder.

    Attributes:
        places: (n, 3) centre x, y and radius, m.
        usable: (n, 2) first angle and extent of the arc that bounds the inflated obstacle, rad; extent 2π is a whole
            circle.
        owners: (n,) number of the obstacle that the circle surrounds, boxes first, or -1.
    """

    places: Floats
    usable: Floats
    owners: Ints


@dataclass(frozen=True, eq=False)
class ShortestPath:
    """A path: its length, m, and (n, 2) points along it, m; arcs are sampled every 5 degrees."""

    length: float
    points: Floats


def circles_of(shapes: Shapes, ends: Floats) -> Circles:
    """The ends of a path (2, 2), m, a quarter circle around each corner of each box, a circle around each cylinder."""
    boxes, discs, radius = shapes.boxes, shapes.discs, shapes.radius
    signs = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
    local = boxes[:, None, 2:4] * signs
    cosine, sine = boxes[:, None, 4], boxes[:, None, 5]
    x = boxes[:, None, 0] + cosine * local[..., 0] - sine * local[..., 1]
    y = boxes[:, None, 1] + sine * local[..., 0] + cosine * local[..., 1]
    corners = np.stack([x, y, np.full_like(x, radius)], axis=-1).reshape(-1, 3)
    yaws = np.arctan2(boxes[:, 5], boxes[:, 4])
    first = (yaws[:, None] + np.array([1.0, 1.5, 0.0, 0.5]) * np.pi).reshape(-1)
    quarter = np.stack([first, np.full_like(first, 0.5 * np.pi)], axis=-1)
    whole = np.tile((0.0, 2.0 * np.pi), (2 + len(discs), 1))
    points = np.pad(ends, ((0, 0), (0, 1)))
    places = np.concatenate([points, corners, discs + np.array((0.0, 0.0, radius))])
    owners = np.concatenate([(-1, -1), np.repeat(np.arange(len(boxes)), 4), len(boxes) + np.arange(len(discs))])
    return Circles(places, np.concatenate([whole[:2], quarter, whole[2:]]), owners)


def on_arc(circle: Floats, angles: Floats) -> Floats:
    """(n, 2) points of an arc on a circle (3,), from the first to the last of two angles, rad."""
    sampled = np.linspace(angles[0], angles[1], 2 + int(abs(angles[1] - angles[0]) / _ARC_SAMPLE))
    points: Floats = circle[:2] + circle[2] * np.stack([np.cos(sampled), np.sin(sampled)], axis=-1)
    return points

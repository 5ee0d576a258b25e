"""Where a convex outline and an upright cylinder or box are nearest to each other, and in which direction."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["nearest_points", "part_outline"]

Floats = NDArray[np.float64]
_ALIKE = 1e-6
"""Distances that differ by no more are those of two parallel edges, m."""


def part_outline(part: Sequence[float]) -> Floats:
    """(4, 2) corners, counter-clockwise, m, map frame, of a box in a row of `Bodies.parts`."""
    _, x, y, half, side, yaw, *_ = part
    c, s = math.cos(yaw), math.sin(yaw)
    corners = np.array([(-half, -side), (half, -side), (half, side), (-half, side)])
    placed: Floats = corners @ np.array([[c, s], [-s, c]]) + (x, y)
    return placed


def nearest_points(outline: Floats, part: Sequence[float]) -> tuple[float, Floats, Floats]:
    """Gap between an outline and a part, m; and of the outline the nearest point, and the direction to the part there.

    Args:
        outline: (n, 2) corners of a convex polygon, counter-clockwise, m, map frame.
        part: A row of `Bodies.parts`.

    Returns:
        The gap, m, negative if they overlap: the shortest motion that parts them. (2,) the point, m, and (2,) the unit
        vector from the outline to the part: the normal of the contact.
    """
    if part[4] == 0.0:
        gap, point, normal = _from_polygon(outline, np.array(part[1:3]))
        return gap - part[3], point, normal
    return _to_polygon(outline, part_outline(part))


def _from_polygon(polygon: Floats, place: Floats) -> tuple[float, Floats, Floats]:
    """Distance of a place from a polygon, negative inside; the nearest point of its rim, and the normal there."""
    ends = np.roll(polygon, -1, axis=0)
    edges = ends - polygon
    lengths = np.hypot(edges[:, 0], edges[:, 1])
    normals = np.column_stack([edges[:, 1], -edges[:, 0]]) / lengths[:, None]
    beyond = ((place - polygon) * normals).sum(axis=1)
    if beyond.max() <= 0.0:
        k = int(beyond.argmax())
        return float(beyond[k]), place - beyond[k] * normals[k], normals[k]
    share = np.clip(((place - polygon) * edges).sum(axis=1) / lengths**2, 0.0, 1.0)
    rim = polygon + share[:, None] * edges
    apart = np.hypot(*(place - rim).T)
    k = int(apart.argmin())
    if apart[k] == 0.0:
        return 0.0, rim[k], normals[int(beyond.argmax())]
    return float(apart[k]), rim[k], (place - rim[k]) / apart[k]


def _to_polygon(outline: Floats, other: Floats) -> tuple[float, Floats, Floats]:
    """The same for another convex polygon; where edges face each other, the middle of what faces."""
    found = [_from_polygon(outline, corner) for corner in other]
    for corner in outline:
        gap, _, normal = _from_polygon(other, corner)
        found.append((gap, corner, -normal))
    least = min(gap for gap, _, _ in found)
    # A corner inside, or edges that cross without one: they overlap, and the least motion that parts them decides.
    depth, normal = _separation(outline, other)
    if depth <= 0.0:
        inside = [corner for corner in other if _from_polygon(outline, corner)[0] <= _ALIKE]
        inside += [corner for corner in outline if _from_polygon(other, corner)[0] <= _ALIKE]
        middle = np.mean(inside, axis=0) if inside else 0.5 * (outline.mean(axis=0) + other.mean(axis=0))
        return depth, middle, normal
    near = [(point, normal) for gap, point, normal in found if gap <= least + _ALIKE]
    return least, np.mean([point for point, _ in near], axis=0), near[0][1]


def _separation(outline: Floats, other: Floats) -> tuple[float, Floats]:
    """Largest gap along an edge normal of either polygon, m, negative if they overlap; and that normal, outwards."""
    best, chosen = -math.inf, np.zeros(2)
    for polygon, against, sign in ((outline, other, 1.0), (other, outline, -1.0)):
        edges = np.roll(polygon, -1, axis=0) - polygon
        normals = np.column_stack([edges[:, 1], -edges[:, 0]]) / np.hypot(edges[:, 0], edges[:, 1])[:, None]
        gaps = (normals @ against.T).min(axis=1) - (normals * polygon).sum(axis=1)
        k = int(gaps.argmax())
        if gaps[k] > best:
            best, chosen = float(gaps[k]), sign * normals[k]
    return best, chosen

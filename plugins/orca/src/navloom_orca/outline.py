"""Echoes around the robot as a few lines: what it cannot pass between is one obstacle."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
SECTORS = 180
"""Directions in which the nearest echo counts: 2 degrees each."""


@njit(cache=True, nogil=True)
def nearest_by_direction(points: Floats, x: float, y: float, reach: float) -> Floats:
    """The nearest point in each direction.

    Args:
        points: (n, >= 2) m. x, y: Where the directions begin, m. reach: Farther points do not count, m.

    Returns:
        (k, 2) m, counter-clockwise from the direction -pi on.
    """
    squares, nearest = np.full(SECTORS, reach * reach), np.full(SECTORS, -1)
    for i in range(points.shape[0]):
        dx, dy = points[i, 0] - x, points[i, 1] - y
        square = dx * dx + dy * dy
        if square >= reach * reach:
            continue
        k = min(SECTORS - 1, int((math.atan2(dy, dx) + math.pi) * SECTORS / (2.0 * math.pi)))
        if square < squares[k]:
            squares[k], nearest[k] = square, i
    found, count = np.empty((SECTORS, 2)), 0
    for k in range(SECTORS):
        if nearest[k] >= 0:
            found[count, 0], found[count, 1] = points[nearest[k], 0], points[nearest[k], 1]
            count += 1
    return found[:count]


@njit(cache=True, nogil=True)
def farthest_beside(chain: Floats, first: int, last: int) -> tuple[int, float]:
    """The point of a chain between two others that is farthest from the line through both, and its distance, m."""
    sx, sy = chain[last, 0] - chain[first, 0], chain[last, 1] - chain[first, 1]
    length = math.hypot(sx, sy)
    at, farthest = first, 0.0
    for i in range(first + 1, last):
        dx, dy = chain[i, 0] - chain[first, 0], chain[i, 1] - chain[first, 1]
        beside = abs(dx * sy - dy * sx) / length if length > 0.0 else math.hypot(dx, dy)
        if beside > farthest:
            at, farthest = i, beside
    return at, farthest


@njit(cache=True, nogil=True)
def lines_of(points: Floats, x: float, y: float, reach: float, gap: float, tolerance: float) -> Floats:
    """Line obstacles of echoes: neighbours by direction that are near to each other are joined, then simplified.

    The simplification is that of Douglas & Peucker 1973.

    Args:
        points: (n, >= 2) m. x, y: Centre of the robot, m. reach: Farther points do not count, m.
        gap: Neighbours nearer to each other than this are joined, m.
        tolerance: Greatest distance of a point from its line, m.

    Returns:
        (k, 4) ends x, y, x, y, m; both are one point where an echo is alone.
    """
    ring = nearest_by_direction(points, x, y, reach)
    n = ring.shape[0]
    begin = 0
    for i in range(n):  # begin where the ring is open, so that no chain is cut
        if math.hypot(ring[i, 0] - ring[i - 1, 0], ring[i, 1] - ring[i - 1, 1]) > gap:
            begin = i
            break
    chain = np.empty((n + 1, 2))
    for i in range(n + 1):
        chain[i, 0], chain[i, 1] = ring[(begin + i) % max(n, 1), 0], ring[(begin + i) % max(n, 1), 1]
    is_closed = n > 2 and math.hypot(chain[n, 0] - chain[n - 1, 0], chain[n, 1] - chain[n - 1, 1]) <= gap
    total = n + 1 if is_closed else n
    lines, count = np.empty((total, 4)), 0
    waiting = np.empty((total + 1, 2), np.int64)
    first = 0
    while first < total:
        last = first
        while last + 1 < total and (
            math.hypot(chain[last + 1, 0] - chain[last, 0], chain[last + 1, 1] - chain[last, 1]) <= gap
        ):
            last += 1
        waiting[0, 0], waiting[0, 1], left = first, last, 1
        while left:
            left -= 1
            a, b = waiting[left, 0], waiting[left, 1]
            at, beside = farthest_beside(chain, a, b)
            if beside > tolerance:
                waiting[left, 0], waiting[left, 1] = a, at
                waiting[left + 1, 0], waiting[left + 1, 1] = at, b
                left += 2
            else:
                lines[count, 0], lines[count, 1], lines[count, 2], lines[count, 3] = (
                    chain[a, 0], chain[a, 1], chain[b, 0], chain[b, 1],
                )  # fmt: skip
                count += 1
        first = last + 1
    return lines[:count]

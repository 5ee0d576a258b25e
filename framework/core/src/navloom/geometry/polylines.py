"""Points along polylines, distance between polylines, and their simplification."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["Polyline", "corners", "hausdorff_distance"]

Floats = NDArray[np.float64]
STEP = 0.02
"""Spacing of the points at which a polyline is compared, m."""
MOST = 4000
"""Most points at which a polyline is compared; on longer ones the spacing is larger."""
# In blocks, since all points times all sides may not fit into memory.
AT_ONCE = 256


class Polyline:
    """A polyline with the distances along it.

    Args:
        points: (n, 2) corners, m.

    Attributes:
        points: As given.
        along: (n,) distance along the line at each corner, m; of an empty line one 0.
    """

    def __init__(self, points: Floats) -> None:
        self.points = points
        self.along: Floats = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])

    @property
    def length(self) -> float:
        """Length, m."""
        return float(self.along[-1])

    def at(self, distances: Floats) -> Floats:
        """(k, 2) points, m, at distances along the line, (k,) m; beyond an end of the line, that end."""
        # np.interp needs increasing places: of coinciding corners, one is kept.
        kept = np.concatenate([[True], np.diff(self.along) > 0.0])
        return np.column_stack([np.interp(distances, self.along[kept], self.points[kept, axis]) for axis in (0, 1)])


def hausdorff_distance(ours: Floats, theirs: Floats) -> float:
    """Greatest distance from a point of either polyline to the other one, m.

    Args:
        ours, theirs: (n, 2) and (m, 2) corners, m, of one frame; at least one each.

    Returns:
        Exact at corners; between them it is sampled every 2 cm, so the result is at most 1 cm too small.
    """
    return max(_farthest(ours, theirs), _farthest(theirs, ours))


def corners(points: Floats, tolerance: float) -> Floats:
    """A subset of a polyline's points (n, 2) from which no other point is farther than a tolerance, m.

    Ramer 1972, Douglas and Peucker 1973; the first and last point are kept.
    """
    # Not recursive: a long path may nest deeper than Python does.
    kept, spans = {0, len(points) - 1}, [(0, len(points) - 1)]
    while spans:
        first, last = spans.pop()
        if last - first < 2:
            continue
        along, between = points[last] - points[first], points[first + 1 : last] - points[first]
        # A closed line has a chord of no length.
        share = np.clip(between @ along / max(float(along @ along), 1e-12), 0.0, 1.0)
        away = np.hypot(*(between - share[:, None] * along).T)
        if away.max() > tolerance:
            middle = first + 1 + int(away.argmax())
            kept.add(middle)
            spans += [(first, middle), (middle, last)]
    return points[sorted(kept)]


def _farthest(points: Floats, line: Floats) -> float:
    """Greatest distance from a polyline to another, m."""
    sampled = _sampled(points)
    starts, ends = (line[:-1], line[1:]) if len(line) > 1 else (line, line)
    sides = ends - starts
    # For a side of no length, where the dividend is 0 too.
    squares = np.maximum((sides**2).sum(axis=1), 1e-300)
    farthest = 0.0
    for first in range(0, len(sampled), AT_ONCE):
        away = sampled[first : first + AT_ONCE, None] - starts
        share = np.clip((away * sides).sum(axis=2) / squares, 0.0, 1.0)
        gap = away - share[..., None] * sides
        farthest = max(farthest, float(np.hypot(gap[..., 0], gap[..., 1]).min(axis=1).max()))
    return farthest


def _sampled(points: Floats) -> Floats:
    """(k, 2) the corners, and samples between them."""
    line = Polyline(points)
    between = np.linspace(0.0, line.length, min(MOST, int(line.length / STEP) + 2))
    return line.at(np.union1d(line.along, between))

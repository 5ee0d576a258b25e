"""A search over the whole map that runs in slices while the robot drives."""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np
from navloom_scans.anywhere import MapSearch
from navloom_scans.poses import compose, relative
from numpy.typing import NDArray

__all__ = ["Finder", "Found", "History"]

Floats = NDArray[np.float64]

_KEPT = 10
"""Number of scans of the way that are kept."""
_KEEP_WAY, _KEEP_TURN = 0.4, math.radians(40.0)
"""Motion from one kept scan to the next, m or rad."""


class Found(NamedTuple):
    """Places that a search has found, the best first.

    Attributes:
        poses: (k, 3) x, y, m, heading, rad, map frame, at the time of the answer.
        scores: (k,) score of each, at most 1.
        score_here: Score of the pose that was given for comparison; -inf without one.
    """

    poses: Floats
    scores: Floats
    score_here: float


class Finder:
    """Searches a map for the place of a scan, and moves the places found by the odometry since that scan.

    Attributes:
        is_busy: Whether a search is running.
        odometry: (3,) odometry pose of the last scan that was searched for; None before the first.
    """

    def __init__(self, search: MapSearch, count: int) -> None:
        """Search a map for at most `count` places at a time."""
        self._search, self._count = search, count
        self.is_busy, self.odometry = False, np.zeros(3)
        self._guess: tuple[Floats, tuple[float, float]] | None = None

    def begin(
        self,
        beams: Floats,
        echoes: int,
        odometry: Floats,
        near: Floats | None = None,
        sigma: tuple[float, float] = (math.inf, math.inf),
    ) -> None:
        """Begin a search for the place of a scan; see `MapSearch.begin`.

        Args:
            odometry: (3,) x, y, m, heading, rad, odometry frame, at the time of the scan.
        """
        self.odometry, self.is_busy = odometry.copy(), True
        self._guess = None if near is None else (near.copy(), sigma)
        self._search.begin(beams, echoes, self._count, near, sigma)

    def score_of(self, pose: Floats) -> float:
        """Score of a pose, (3,) map frame, for the scan that the last search began with."""
        return self._search.score_of(pose)

    def step(self, budget: int, odometry: Floats, here: Floats | None = None) -> Found | None:
        """Continue the search; its answer if it has ended.

        Args:
            budget: Work, in nodes.
            odometry: (3,) odometry pose now.
            here: (3,) pose now with which the places are to be compared, map frame.
        """
        if not self.is_busy or not self._search.step(budget):
            return None
        self.is_busy = False
        poses, scores = self._search.result()
        step = relative(self.odometry, odometry)
        back = relative(step, np.zeros(3))
        score_here = -math.inf if here is None else self._search.score_of(compose(here, back))
        if self._guess is not None:
            scores = scores - _unlikely(poses, *self._guess)
        moved = np.array([compose(pose, step) for pose in poses]).reshape(-1, 3)
        return Found(moved, scores, score_here)

    def stop(self) -> None:
        """Drop a running search."""
        self.is_busy = False


class History:
    """Scans along the way so far: a place that fits now must fit them too, where odometry says that they were taken."""

    def __init__(self) -> None:
        self._scans: deque[tuple[Floats, int, Floats]] = deque(maxlen=_KEPT)

    def add(self, search: MapSearch, beams: Floats, echoes: int, odometry: Floats) -> None:
        """Keep a scan, as for `Finder.begin`, if the robot has moved since the last one that was kept."""
        if self._scans:
            step = relative(self._scans[-1][2], odometry)
            if math.hypot(step[0], step[1]) < _KEEP_WAY and abs(step[2]) < _KEEP_TURN:
                return
        self._scans.append((*search.rays_of(beams, echoes), odometry.copy()))

    def score(self, search: MapSearch, pose: Floats, odometry: Floats) -> float:
        """Mean score of the scans for a robot that is now at a pose, (3,) map frame; 1 without scans.

        Each is fitted, since odometry drifts.
        """
        total = 0.0
        for rays, heard, then in self._scans:
            place = compose(pose, relative(odometry, then))
            total += search.score_of(search.fitted(place, rays, heard), rays, heard)
        return total / len(self._scans) if self._scans else 1.0

    def clear(self) -> None:
        """Forget the way."""
        self._scans.clear()


def _unlikely(poses: Floats, near: Floats, sigma: tuple[float, float]) -> Floats:
    """(k,) what a guess takes from the score of each pose: 0.1 per unit of its negative log likelihood."""
    found = np.zeros(len(poses))
    for i, pose in enumerate(poses):
        off = math.hypot(pose[0] - near[0], pose[1] - near[1]) / sigma[0]
        turned = math.remainder(pose[2] - near[2], math.tau) / sigma[1]
        found[i] = 0.05 * (off * off + turned * turned)
    return found

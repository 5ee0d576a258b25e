"""Looks in the background for a place on the map that fits better than the tracked one."""

from __future__ import annotations

import math

import numpy as np
from navloom_scan_localizer.judging import Judge
from navloom_scan_localizer.tracking import PoseTracker
from numpy.typing import NDArray

from navloom_mcl.finding import Finder

__all__ = ["Watch"]

Floats = NDArray[np.float64]

_START = (0.8, math.radians(30.0))
"""Standard deviations of a start that is believed right, m and rad."""
_WAY = 0.5
"""Way between two searches near a start, until a drive has proven it, m."""
_THROUGH, _PAUSE = 0.15, 3.0
"""Share of the beams to mapped walls that pass through them, above which the whole map is searched; least time between
two searches then, s."""
_BETTER, _FAR_BETTER = 0.1, 0.3
"""Lead in the score of another place before a drive has proven the tracked one, and after."""
_APART = (0.4, math.radians(12.0))
"""Least distance of another place, m or rad."""


class Watch:
    """Searches near a start, and the whole map while beams pass through walls or after odometry was wrong."""

    def __init__(self, finder: Finder, work: int) -> None:
        """Search with a finder by some work in one tick, in nodes."""
        self._finder, self._work = finder, work
        self._at: Floats | None = None
        self._time = -math.inf
        self._weight, self._score = 1.0, -math.inf
        self._is_suspected = False

    def wants(self, judge: Judge, time: float) -> bool:
        """Whether the beams of this tick are needed."""
        return not self._finder.is_busy and (not judge.is_proven or self._is_doubted(judge, time))

    def suspect(self) -> None:
        """Search the whole map at the next scan: odometry and scans have contradicted each other."""
        self._is_suspected = True

    def _is_doubted(self, judge: Judge, time: float) -> bool:
        return (self._is_suspected or judge.through > _THROUGH) and time - self._time >= _PAUSE

    def step(self, judge: Judge, tracker: PoseTracker, time: float, beams: Floats | None, echoes: int) -> bool:
        """Continue; whether another place fits clearly better.

        Args:
            judge, tracker: Those of the tracked pose.
            time: Current time, s.
            beams, echoes: Beams of this tick if it has any, see `MapSearch.begin`.
        """
        finder = self._finder
        if beams is not None and echoes and not finder.is_busy:
            near = None if judge.is_proven or self._is_doubted(judge, time) else (tracker.pose, _START)
            way = math.inf if self._at is None else math.dist(self._at[:2], tracker.odometry[:2])
            if near is None or way >= _WAY:
                finder.begin(beams, echoes, tracker.odometry, *(near or ()))
                # Not of the pose at the end, moved back: odometry may have turned wrong meanwhile.
                self._score = finder.score_of(tracker.pose)
                self._at, self._time = tracker.odometry.copy(), time
                # Few echoes fit somewhere on every map.
                self._weight = min(1.0, 2.0 * echoes / len(beams))
        if not finder.is_busy or (found := finder.step(self._work, tracker.odometry)) is None:
            return False
        lead = (_BETTER if self._is_suspected or not judge.is_proven else _FAR_BETTER) / self._weight
        self._is_suspected = False
        for pose, score in zip(found.poses, found.scores.tolist(), strict=True):
            off = math.hypot(pose[0] - tracker.pose[0], pose[1] - tracker.pose[1])
            turned = abs(math.remainder(pose[2] - tracker.pose[2], math.tau))
            if (off > _APART[0] or turned > _APART[1]) and score >= self._score + lead:
                return True
        return False

"""The places where the robot may be: each is tracked by scan matching, and weighed by all scans of a drive.

A place that a search finds later is followed back along the drive, so that all places are weighed by the same scans.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from navloom_scan_localizer.tracking import PoseTracker, Settings
from navloom_scans.field import DistanceField
from navloom_scans.poses import compose, pose_of, relative
from navloom_scans.sight import look_along
from navloom_scans.small import inverse
from numpy.typing import NDArray

from navloom_mcl.likelihood import log_likelihoods

__all__ = ["Place", "Places"]

Floats = NDArray[np.float64]

_MODEL = np.array([0.08, 0.2, 0.05, 0.3, 0.24, 20.0])
"""Likelihood of beams, see `likelihood.log_likelihoods`: that of `mcl`, but more beams count as one. Every scan of a
drive sees the same unmapped things, and no place is left out because of them."""
_BEAMS = 60
"""About how many beams of a scan weigh the places."""
_KEYS = 60
"""Scans of the drive that are kept; of a longer one, every second is dropped."""
_WAY, _TURN = 0.1, math.radians(6.0)
"""Motion from one scan that is used to the next, m and rad."""
_FIRST = 3
"""Scans that are used without motion."""
_REFUTED = 12.0
"""Logarithm of the ratio of likelihoods from which a place is refuted."""
_LOOSE = np.diag([0.1**2, 0.1**2, math.radians(4.0) ** 2])
"""Covariance of a place that a search has found, and of a step back along the drive, m² and rad²."""
_SAME = (0.3, math.radians(10.0))
"""Distance below which two places are one, m and rad."""
_MOST = 64
"""Most places, as in the framework's message."""
_FORGET = 0.6
"""Share of the earlier counts of beams that a new scan leaves."""


@dataclass(slots=True)
class _Key:
    """A scan of the drive: some of its beams, (n, 4), how many have an echo, and (3,) its odometry pose."""

    beams: Floats
    echoes: int
    odometry: Floats


@dataclass(slots=True, eq=False)
class Place:
    """One place where the robot may be.

    Attributes:
        tracker: Tracks the robot as if it were there.
        prior: Logarithm of how likely it was before the drive, compared with others.
        logs: Logarithm of the likelihood of each scan that is kept.
        way: Way along which it has been followed since it was found, m; a turn counts too.
        counts: (6,) recent counts of what beams see, see `Sight`.
        weight: Its probability among all places.
    """

    tracker: PoseTracker
    prior: float
    logs: list[float]
    counts: Floats
    way: float = 0.0
    weight: float = 0.0

    @property
    def log(self) -> float:
        """Logarithm of the likelihood of the drive, with the prior."""
        return self.prior + sum(self.logs)

    @property
    def mean(self) -> float:
        """Mean logarithm of the likelihood of a scan of the drive, which is 0 if every beam ends at a mapped wall."""
        return sum(self.logs) / max(len(self.logs), 1)


class Places:
    """Follows places and weighs them.

    Attributes:
        found: The places, the likeliest first.
        way: Way of the drive, m; a turn of 1 rad counts as `turn_as` metres.
    """

    def __init__(self, settings: Settings, field: DistanceField, odometry: Floats, turn_as: float) -> None:
        self.settings, self.field, self._turn_as = settings, field, turn_as
        self.found: list[Place] = []
        self.way = 0.0
        self._keys: list[_Key] = []
        self._odometry, self._last = odometry.copy(), odometry.copy()
        self._left = _FIRST
        self._part = 0

    def take_map(self, field: DistanceField) -> None:
        """Match another map from now on."""
        self.field = field
        for place in self.found:
            place.tracker.field = field

    def advance(self, odometry: Floats, time: float) -> None:
        """Move all places by odometry, (3,) x, y, m, heading, rad, odometry frame, over a time, s."""
        step, self._odometry = relative(self._odometry, odometry), odometry.copy()
        way = math.hypot(step[0], step[1]) + self._turn_as * abs(float(step[2]))
        self.way += way
        for place in self.found:
            place.tracker.predict(odometry, time)
            place.way += way

    def restart(self) -> None:
        """Forget the drive and what was likelier before it: the robot was carried, and each place may be the one."""
        self._keys, self._left, self.way = [], _FIRST, 0.0
        for place in self.found:
            place.prior, place.logs, place.way = 0.0, [], 0.0

    def see(self, beams: Floats, echoes: int) -> None:
        """Weigh the places by a scan, (n, 4) beams of which the first have an echo, if the robot has moved."""
        off = relative(self._last, self._odometry)
        # A robot that stands sees the same again: that is no further evidence.
        if self._left <= 0 and math.hypot(off[0], off[1]) < _WAY and abs(off[2]) < _TURN:
            return
        self._left, self._last = self._left - 1, self._odometry
        stride = max(1, len(beams) // _BEAMS)
        self._part = (self._part + 1) % stride
        used = np.ascontiguousarray(beams[self._part :: stride])
        key = _Key(used, len(range(self._part, echoes, stride)), self._odometry)
        self._keys.append(key)
        for place in self.found:
            place.tracker.correct(beams[:echoes])
            place.logs.append(self._log(key, place.tracker.pose))
            self._look(place, key)
        if len(self._keys) > _KEYS:
            # The newest scan stays: the next motion begins there.
            keep = slice(len(self._keys) % 2 ^ 1, None, 2)
            self._keys = self._keys[keep]
            for place in self.found:
                place.logs = place.logs[keep]
        self._weigh()

    def add(self, pose: Floats, prior: float, covariance: Floats = _LOOSE) -> bool:
        """Add a place of now, if it is another one and fits the drive.

        Args:
            pose: (3,) x, y, m, heading, rad, map frame. covariance: (3, 3) of it.
            prior: Logarithm of how likely it is, compared with others.
        """
        if any(_is_same(pose, place.tracker.pose) for place in self.found):
            return False
        tracker = PoseTracker(self.settings, self.field, pose)
        tracker.odometry = self._odometry.copy()
        tracker.relocate(pose, covariance)
        tracker.is_proven = True
        logs: list[float] = []
        best = self.found[0] if self.found else None
        at, since, total, ahead = pose, self._odometry, prior, best.prior if best else 0.0
        for k in range(len(self._keys) - 1, -1, -1):
            key = self._keys[k]
            at = compose(at, relative(since, key.odometry))
            fitted, fused, inliers = tracker.fit(key.beams[: key.echoes], at, _LOOSE)
            if inliers >= 0.3 * key.echoes:
                at = pose_of(*fitted.tolist())
            if k == len(self._keys) - 1 and inliers:
                now = compose(at, relative(key.odometry, self._odometry))
                if any(_is_same(now, place.tracker.pose) for place in self.found):
                    return False
                tracker.relocate(now, inverse(fused))
                tracker.is_proven = True
            since = key.odometry
            logs.append(self._log(key, at))
            total += logs[-1]
            ahead += best.logs[k] if best else 0.0
            if best is not None and total < ahead - 2.0 * _REFUTED:
                return False
        place = Place(tracker, prior, logs[::-1], np.zeros(6))
        if self._keys:
            self._look(place, self._keys[-1])
        self.found.append(place)
        self._weigh()
        return place in self.found

    def covariance(self, pose: Floats) -> Floats:
        """(3, 3) mean square deviation of all places from a pose, (3,)."""
        total = np.zeros((3, 3))
        for place in self.found:
            off = place.tracker.pose - pose
            off[2] = math.remainder(off[2], math.tau)
            total += place.weight * (np.outer(off, off) + place.tracker.covariance)
        return total

    def _look(self, place: Place, key: _Key) -> None:
        place.counts *= _FORGET
        look_along(self.field, key.beams, key.echoes, place.tracker.pose, _MODEL[4], (0, 1), place.counts)

    def _log(self, key: _Key, pose: Floats) -> float:
        logs = np.empty(1)
        log_likelihoods(self.field.values, self.field.frame, pose[None, :], key.beams, key.echoes, _MODEL, logs)
        return float(logs[0])

    def _weigh(self) -> None:
        """Order the places, and drop those that are refuted or that came to the place of a better one."""
        if not self.found:
            return
        logs = {id(place): place.log for place in self.found}
        self.found.sort(key=lambda place: -logs[id(place)])
        best = logs[id(self.found[0])]
        kept: list[Place] = []
        for place in self.found:
            pose = place.tracker.pose
            if logs[id(place)] < best - _REFUTED or len(kept) == _MOST:
                break
            twin = next((other for other in kept if _is_same(pose, other.tracker.pose)), None)
            if twin is None:
                kept.append(place)
            else:
                twin.way = max(twin.way, place.way)
        self.found = kept
        shares = [math.exp(logs[id(place)] - best) for place in kept]
        for place, share in zip(kept, shares, strict=True):
            place.weight = share / sum(shares)


def _is_same(pose: Floats, other: Floats) -> bool:
    off, turned = math.hypot(pose[0] - other[0], pose[1] - other[1]), math.remainder(pose[2] - other[2], math.tau)
    return off < _SAME[0] and abs(turned) < _SAME[1]

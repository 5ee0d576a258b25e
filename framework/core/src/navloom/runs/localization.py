"""How well a localizer knew where the robot was: its estimates beside the true poses. Definitions: docs/metrics.md."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from navloom.geometry.angles import wrap
from navloom.geometry.frames import compose, inverse

__all__ = ["Localization", "beside_truth", "corrections"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

FOUND, FOUND_TURN, FOUND_FOR = 0.2, math.radians(5.0), 1.0
"""A robot is found once it has been tracked within these errors, m and rad, for this time, s."""
FALSE, FALSE_TURN, FALSE_FOR = 0.5, math.radians(15.0), 1.0
"""Tracking is false where either error is larger than this, m and rad, for longer than this time, s."""
JUMP = 0.02
"""Correction of a tick from which it counts as a jump, m: it moves the controller's cross-track error at once."""
SIGMAS = 3.0
"""Standard deviations within which the true pose has to be along each axis."""
STILL_SPEED, STILL_TURN = 0.02, 0.02
"""Speed, m/s, and turn rate, rad/s, below which a robot stands: those of the metric `stopped_time`."""


@dataclass(frozen=True, eq=False)
class Localization:
    """Estimates of an active localizer whose true poses are known, one row each, in order of their stamps.

    Attributes:
        time: (n,) stamps, s, increasing.
        truth, estimate: (n, 3) x, y, m, heading, rad, map frame.
        covariance: (n, 4) of the estimates: xx, xy, yy, m², and of the heading, rad².
        is_tracking: (n,) whether the localizer said that it tracks.
        is_moving: (n,) whether the robot drove or turned.
        correction: (n,) distance, m, between the estimate and the previous one moved on by odometry; NaN if there is
            none.
    """

    time: Floats = field(default_factory=lambda: np.empty(0))
    truth: Floats = field(default_factory=lambda: np.empty((0, 3)))
    estimate: Floats = field(default_factory=lambda: np.empty((0, 3)))
    covariance: Floats = field(default_factory=lambda: np.empty((0, 4)))
    is_tracking: Bools = field(default_factory=lambda: np.empty(0, dtype=np.bool_))
    is_moving: Bools = field(default_factory=lambda: np.empty(0, dtype=np.bool_))
    correction: Floats = field(default_factory=lambda: np.empty(0))

    @cached_property
    def error(self) -> Floats:
        """(n,) distance between the estimated and the true position, m."""
        away = self.estimate[:, :2] - self.truth[:, :2]
        return np.hypot(away[:, 0], away[:, 1])

    @cached_property
    def turn_error(self) -> Floats:
        """(n,) difference between the estimated and the true heading, rad, >= 0."""
        return np.abs(wrap(self.estimate[:, 2] - self.truth[:, 2]))

    @cached_property
    def spans(self) -> Floats:
        """(n,) time from each estimate to the next, s; 0 for the last."""
        return np.diff(self.time, append=self.time[-1:])

    @property
    def found_at(self) -> int | None:
        """The first row of lasting true tracking; None if there is none."""
        is_true = self.is_tracking & (self.error <= FOUND) & (self.turn_error <= FOUND_TURN)
        return next((first for first, last in _stretches(is_true) if self._lasts(first, last) >= FOUND_FOR), None)

    @property
    def not_tracking(self) -> float:
        """Time in which the localizer searched or was lost, s."""
        return float(self.spans[~self.is_tracking].sum())

    @property
    def false_tracking(self) -> float:
        """Time in which the localizer said that it tracks and was wrong, in stretches longer than `FALSE_FOR`, s."""
        is_false = self.is_tracking & ((self.error > FALSE) | (self.turn_error > FALSE_TURN))
        lasting = (self._lasts(first, last) for first, last in _stretches(is_false))
        return sum(time for time in lasting if time > FALSE_FOR)

    @cached_property
    def jumps(self) -> Floats:
        """(k,) corrections of one tick to the next while tracking and moving, m."""
        follows = np.concatenate([[False], self.is_tracking[:-1]]) & self.is_tracking & self.is_moving
        return self.correction[follows & np.isfinite(self.correction)]

    @cached_property
    def is_within(self) -> Bools:
        """(n,) whether the true pose is within `SIGMAS`: along both main axes of the covariance, and in heading."""
        away = self.estimate[:, :2] - self.truth[:, :2]
        spread, axes = np.linalg.eigh(self.covariance[:, [0, 1, 1, 2]].reshape(-1, 2, 2))
        along = np.abs(np.einsum("ni,nij->nj", away, axes))
        is_near = (along <= SIGMAS * np.sqrt(np.maximum(spread, 0.0))).all(axis=1)
        return np.asarray(is_near & (self.turn_error <= SIGMAS * self.turn_sigma))

    @cached_property
    def sigma(self) -> Floats:
        """(n,) largest standard deviation of the position in any direction, m."""
        xx, xy, yy = self.covariance[:, :3].T
        return np.asarray(np.sqrt(np.maximum(0.5 * (xx + yy) + np.hypot(0.5 * (xx - yy), xy), 0.0)))

    @property
    def turn_sigma(self) -> Floats:
        """(n,) standard deviation of the heading, rad."""
        return np.sqrt(np.maximum(self.covariance[:, 3], 0.0))

    def _lasts(self, first: int, last: int) -> float:
        """Time from the first row of a stretch until the row behind it, s."""
        return round(float(self.time[min(last + 1, len(self.time) - 1)] - self.time[first]), 9)


def beside_truth(truth: Floats, turn_rates: Floats, estimates: Floats, odometry: Floats) -> Localization:
    """The estimates of a run that are stamped with a tick of the ground truth.

    Args:
        truth: (n, 5 or more) time, s, x, y, m, heading, rad, map frame, speed, m/s.
        turn_rates: (n,) rad/s.
        estimates: (k, 9) time, s, x, y, m, heading, rad, 1 while tracking, xx, xy, yy, m², and of the heading, rad².
        odometry: (m, 4) time, s, x, y, m, heading, rad, odometry frame.
    """
    at, is_known = _rows_at(truth[:, 0], estimates[:, 0])
    given, at = estimates[is_known], at[is_known]
    wheels, is_driven = _rows_at(odometry[:, 0], given[:, 0])
    driven = np.full((len(given), 3), np.nan)
    driven[is_driven] = odometry[wheels[is_driven], 1:4]
    return Localization(
        time=given[:, 0],
        truth=truth[at, 1:4],
        estimate=given[:, 1:4],
        covariance=given[:, 5:9],
        is_tracking=given[:, 4] == 1.0,
        is_moving=(np.abs(truth[at, 4]) > STILL_SPEED) | (np.abs(turn_rates[at]) > STILL_TURN),
        correction=corrections(given[:, 1:4], driven),
    )


def corrections(estimate: Floats, odometry: Floats) -> Floats:
    """(n,) distance between each estimate and the previous one moved on by odometry, m; NaN where it is not known.

    Args:
        estimate: (n, 3) x, y, m, heading, rad, map frame.
        odometry: (n, 3) the same, odometry frame, at the same times; NaN where there is none.
    """
    moved = compose(estimate[:-1], compose(inverse(odometry[:-1]), odometry[1:]))
    away = estimate[1:, :2] - moved[:, :2]
    return np.concatenate([np.full(min(1, len(estimate)), np.nan), np.hypot(away[:, 0], away[:, 1])])


def _rows_at(stamps: Floats, wanted: Floats) -> tuple[NDArray[np.int64], Bools]:
    """(n,) row whose stamp is each wanted time, the last of several, and whether there is one."""
    last = np.searchsorted(stamps, wanted, side="right") - 1
    return last, np.append(stamps, np.nan)[last] == wanted


def _stretches(states: Bools) -> list[tuple[int, int]]:
    """First and last row of each stretch of true rows."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], states, [False]]).astype(np.int8)))
    return [(int(first), int(end) - 1) for first, end in edges.reshape(-1, 2)]

"""The time offset of a laser: the shift in time at which odometry turns as the scans show that the robot turned.

With the heading θ of the scans at their stamps s, and the heading H of the odometry, whose noise is that of slipping
wheels and whose turns are wrong by a scale k and by a drift c per metre:

    θ(s_j+1) - θ(s_j) = k [H(s_j+1 + δ) - H(s_j + δ)] + c way + noise

δ, k and c are found by instrumental variables: the noise must not be correlated with the angular acceleration, the
turn and the way as the *scans* show them. Least squares would be drawn to shifts at which interpolation averages the
noise of neighbouring odometry messages; instruments that hold no noise of the odometry are not. The interval comes from
blocks of time, so that noise that lasts counts as what it is.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.stats import t as student_t

from navloom_calibration.laser_track import Track, Way

__all__ = ["FARTHEST", "Interval", "Offset", "find_offset", "interval_of"]

Floats = NDArray[np.float64]

FARTHEST = 1.0
"""Largest offset that is searched, s: the largest that a config takes for late scans."""
_GRID = 0.01
"""Step of the first search, s."""
_SMOOTHING = 0.1
"""Standard deviation of the filter of turn rates, s; at least the time between two scans."""
_BLOCK = 2.0
"""Length of the blocks of the interval, s: longer than a manoeuvre's noise lasts, shorter than a turn's return."""
_FINEST = 0.001
"""Standard deviation of what all turns have in common, as the resolution of stamps, s."""
_SILENT = 0.3
"""Least time between two odometry messages between which nothing is interpolated, s."""
_TUKEY = 5.0
"""Standard deviations from which an increment does not count: a slip, or a scan that was fitted wrongly."""


class Interval(NamedTuple):
    """A value with its 95 % interval."""

    value: float
    low: float
    high: float

    @property
    def half(self) -> float:
        """Half the interval's width."""
        return 0.5 * (self.high - self.low)


class Offset(NamedTuple):
    """How late a laser is.

    Attributes:
        offset: To be added to its stamps, s.
        scale: Turn of the odometry, as a multiple, that is the turn of the scans.
        turn: Sum of the turns of the scans, rad.
        agreement: Correlation of the turn rates of scans and odometry, with the offset.
    """

    offset: Interval
    scale: Interval
    turn: float
    agreement: float


class _Increments(NamedTuple):
    """From one scan to the next, (n,) each: stamps, s; turn, rad; angular acceleration, rad/s²; turn rate, rad/s."""

    begin: Floats
    end: Floats
    turn: Floats
    acceleration: Floats
    rate: Floats


def find_offset(track: Track, way: Way) -> Offset | None:
    """The offset of a laser; None if its scans and the odometry cannot be compared at all."""
    steps = _increments(track)
    if len(steps.turn) < 10:
        return None
    first, agreement = _coarse(steps, way)
    steps = _without_gaps(steps, way, first)
    if len(steps.turn) < 10:
        return None
    turned = float(np.abs(steps.turn).sum())
    driven = np.concatenate(([0.0], np.cumsum(_signed_steps(way.poses))))
    offset, scale, drift = first, 1.0, 0.0
    # From the start: a step of the odometry by 30° would otherwise lead the first iterations astray.
    weights, _ = _weights(_residuals(steps, way, driven, offset, scale, drift)[0], steps)
    for _ in range(12):
        instruments = _instruments(steps, way, driven, offset)
        rest, slope = _residuals(steps, way, driven, offset, scale, drift)
        moment = (instruments * weights[:, None]).T
        change = np.linalg.lstsq(moment @ slope, moment @ rest, rcond=None)[0]
        offset = float(np.clip(offset + np.clip(change[0], -0.05, 0.05), -FARTHEST, FARTHEST))
        scale, drift = scale + change[1], drift + change[2]
        rest, _ = _residuals(steps, way, driven, offset, scale, drift)
        weights, _ = _weights(rest, steps)
    rest, slope = _residuals(steps, way, driven, offset, scale, drift)
    weights, steepness = _weights(rest, steps)
    instruments = _instruments(steps, way, driven, offset)
    moments, slopes = instruments * (weights * rest)[:, None], instruments * steepness[:, None]
    return Offset(*_intervals((offset, float(scale)), steps, moments, slopes, slope), turned, agreement)


def _increments(track: Track) -> _Increments:
    """Increments within the parts of a track that are long enough to show accelerations."""
    gaps = np.diff(track.stamps)
    usual = float(np.median(gaps)) if len(gaps) else 0.0
    smoothing = max(_SMOOTHING, usual)
    begins = np.flatnonzero(np.concatenate(([True], (np.diff(track.parts) != 0) | (gaps > 3.0 * usual + 0.1))))
    rows: list[Floats] = []
    for first, last in zip(begins, [*begins[1:], len(track.stamps)], strict=True):
        times, headings = track.stamps[first:last], track.poses[first:last, 2]
        if len(times) < 4 or times[-1] - times[0] < 4.0 * smoothing:
            continue
        step = min(0.02, 0.5 * usual)
        grid = np.arange(times[0], times[-1] + step, step)
        even, sigma = np.interp(grid, times, headings), smoothing / step
        middles = 0.5 * (times[1:] + times[:-1])
        bend, rate = (gaussian_filter1d(even, sigma, order=order, mode="nearest") / step**order for order in (2, 1))
        rows.append(
            np.stack([times[:-1], times[1:], np.diff(headings), np.interp(middles, grid, bend),
                      np.interp(middles, grid, rate)])
        )  # fmt: skip
    return _Increments(*(np.concatenate(rows, axis=1) if rows else np.empty((5, 0))))


def _without_gaps(steps: _Increments, way: Way, offset: float) -> _Increments:
    """The increments in which odometry was not silent for a while."""
    gaps = np.diff(way.stamps)
    (silent,) = np.nonzero(gaps > max(_SILENT, 5.0 * float(np.median(gaps))))
    places = np.searchsorted(way.stamps, steps.begin + offset), np.searchsorted(way.stamps, steps.end + offset)
    kept = ~((places[0][:, None] <= silent + 1) & (places[1][:, None] >= silent + 1)).any(axis=1)
    return _Increments(*(row[kept] for row in steps))


def _coarse(steps: _Increments, way: Way) -> tuple[float, float]:
    """The offset of the grid at which the turn rates are correlated most, s, and that correlation; 0 if none is."""
    step = float(np.median(np.diff(way.stamps)))
    grid = np.arange(way.stamps[0], way.stamps[-1] + _GRID, _GRID)
    heading = np.interp(grid, way.stamps, way.poses[:, 2])
    smoothing = max(_SMOOTHING, step, float(np.median(steps.end - steps.begin)))
    rate = gaussian_filter1d(heading, smoothing / _GRID, order=1, mode="nearest") / _GRID
    middles, found = 0.5 * (steps.begin + steps.end), (0.0, 0.0)
    # Odometry that steps by 30° at once must not outweigh a minute of turns.
    fastest = 1.5 * float(np.percentile(np.abs(steps.rate), 99.0))
    rate, seen = np.clip(rate, -fastest, fastest), np.clip(steps.rate, -fastest, fastest)
    for offset in np.arange(-FARTHEST, FARTHEST + 0.5 * _GRID, _GRID):
        there = np.interp(middles + offset, grid, rate)
        size = math.sqrt(float(there @ there) * float(seen @ seen))
        if size > 0.0 and float(there @ seen) / size > found[1]:
            found = float(offset), float(there @ seen) / size
    return found


def _signed_steps(poses: Floats) -> Floats:
    """(n - 1,) way between neighbouring poses, m, negative backwards."""
    moved, heading = np.diff(poses[:, :2], axis=0), 0.5 * (poses[1:, 2] + poses[:-1, 2])
    found: Floats = moved[:, 0] * np.cos(heading) + moved[:, 1] * np.sin(heading)
    return found


def _residuals(
    steps: _Increments, way: Way, driven: Floats, offset: float, scale: float, drift: float
) -> tuple[Floats, Floats]:
    """(n,) turns of the scans less those of the odometry, rad, and (n, 3) what offset, scale and drift add to the
    latter."""

    def turned(shift: float) -> Floats:
        found: Floats = np.interp(steps.end + shift, way.stamps, way.poses[:, 2]) - np.interp(
            steps.begin + shift, way.stamps, way.poses[:, 2]
        )
        return found

    ways = np.interp(steps.end + offset, way.stamps, driven) - np.interp(steps.begin + offset, way.stamps, driven)
    here, reach = turned(offset), 0.05
    slope = (turned(offset + reach) - turned(offset - reach)) * scale / (2.0 * reach)
    return steps.turn - scale * here - drift * ways, np.stack([slope, here, ways], axis=1)


def _instruments(steps: _Increments, way: Way, driven: Floats, offset: float) -> Floats:
    """(n, 3) what the noise must not be correlated with."""
    spans = steps.end - steps.begin
    ways = np.interp(steps.end + offset, way.stamps, driven) - np.interp(steps.begin + offset, way.stamps, driven)
    return np.stack([steps.acceleration * spans, steps.rate * spans, ways], axis=1)


def _weights(rest: Floats, steps: _Increments) -> tuple[Floats, Floats]:
    """(n,) weight of each increment, and derivative of the weighted residual by the residual.

    By the noise while the robot turns and while it does not; outliers have none (Tukey's biweight).
    """
    size = np.abs(steps.turn)
    fast = size > np.median(size)
    spread = np.where(fast, _spread(rest[fast]), _spread(rest[~fast]))
    square = np.minimum(1.0, np.abs(rest) / (_TUKEY * spread)) ** 2
    return (1.0 - square) ** 2 / spread**2, (1.0 - square) * (1.0 - 5.0 * square) / spread**2


def _spread(rest: Floats) -> float:
    """Standard deviation by the median, rad; never 0."""
    return max(1e-5, 1.4826 * float(np.median(np.abs(rest - np.median(rest))))) if len(rest) else 1e-5


def _intervals(
    found: tuple[float, float], steps: _Increments, rows: Floats, gains: Floats, slope: Floats
) -> tuple[Interval, Interval]:
    """95 % intervals of offset and scale by leaving out one block of time after the other (jackknife).

    Args:
        found: The offset, s, and the scale.
        steps: The increments.
        rows: (n, 3) their moments, whose sum is 0.
        gains: (n, 3) derivatives of the moments by the residual.
        slope: (n, 3) derivatives of the residual, negative, by offset, scale and drift.
    """
    block = np.unique(np.floor((steps.begin - steps.begin[0]) / _BLOCK), return_inverse=True)[1]
    count = int(block.max()) + 1
    moments, slopes = np.zeros((count, 3)), np.zeros((count, 3, 3))
    np.add.at(moments, block, rows)
    np.add.at(slopes, block, gains[:, :, None] * slope[:, None, :])
    total, inverse = slopes.sum(axis=0), np.linalg.pinv(slopes.sum(axis=0))
    shifts = np.array([np.linalg.pinv(total - own) @ moment for own, moment in zip(slopes, moments, strict=True)])
    sigma = np.sqrt((shifts**2).sum(axis=0))
    # The first row of the inverse says what each instrument contributes to the offset, the nuisances taken out.
    informed = np.abs(np.bincount(block, (gains @ inverse[0]) * slope[:, 0]))
    effective = float(informed.sum() ** 2 / max(1e-30, float((informed**2).sum())))
    freedom = max(1.0, effective - 1.0)
    return (
        interval_of(found[0], math.hypot(float(sigma[0]), _FINEST), freedom),
        interval_of(found[1], float(sigma[1]), freedom),
    )


def interval_of(value: float, sigma: float, freedom: float) -> Interval:
    """95 % interval of an estimate with a standard deviation from so many degrees of freedom (Student's t)."""
    half = float(student_t.ppf(0.975, freedom)) * sigma
    return Interval(value, value - half, value + half)

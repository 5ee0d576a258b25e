"""Computes the metrics as functions of a trail. Definitions, sources and limits: docs/metrics.md.

Values are interpolated linearly between ticks, and integrals over time are those of the polyline. So another sampling
period gives the same result, up to the motion between two ticks.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from navloom.runs.episode_trail import FALSE_SUCCESS, Trail

__all__ = [
    "CLOCK_STARTS",
    "DEAD_BAND",
    "JERK_WINDOW",
    "LEAST_WAY",
    "REFERENCE_SPEED",
    "STILL_SPEED",
    "STILL_TURN",
    "avoider_share",
    "barn_2_8",
    "barn_4_8",
    "clearance_min",
    "clearance_p5",
    "collisions",
    "others_contacts",
    "own_contacts",
    "cross_track_max",
    "cross_track_rms",
    "danger_share",
    "false_success",
    "gate_limits",
    "gate_stops",
    "goal_distance",
    "heading_error",
    "integrated_jerk",
    "path_length",
    "recoveries",
    "spl",
    "steering_flips_per_metre",
    "stopped_time",
    "success",
    "time_to_goal",
    "turning_per_metre",
]

Floats = NDArray[np.float64]

JERK_WINDOW = 0.4
"""Window over which the acceleration is averaged, s: longer than any control period, shorter than any manoeuvre."""
LEAST_WAY = 0.1
"""Shortest driven distance for metrics per metre, m; below it the denominator is noise."""
DEAD_BAND = 0.05
"""Largest commanded turn rate that counts neither as left nor as right, rad/s: 3°/s."""
STILL_SPEED = 0.02
"""Speed below which a robot counts as not driving, m/s."""
STILL_TURN = 0.02
"""Turn rate below which a robot counts as not turning, rad/s."""
REFERENCE_SPEED = 2.0
"""Speed of the BARN challenge's optimal time, m/s, whatever the robot's own limit."""
CLOCK_STARTS = 0.1
"""Distance from the start beyond which the BARN challenge's clock runs, m."""
_JERK_STEPS = 8
"""Number of grid steps of the jerk in one window; the grid does not depend on the control period."""


def success(trail: Trail) -> float:
    """1 if the goal was reached, according to the ground truth if there is one, else 0."""
    return float(trail.succeeded)


def false_success(trail: Trail) -> float | None:
    """1 if the robot reported that it had arrived but had not, else 0; None without ground truth."""
    return float(trail.outcome == FALSE_SUCCESS) if trail.has_truth else None


def spl(trail: Trail) -> float | None:
    """Success weighted by path length: Anderson et al. 2018, S l / max(p, l)."""
    optimal = _optimal(trail)
    if optimal is None or _is_untold(trail):
        return None
    return optimal / max(trail.path_length_to_goal, optimal) if trail.succeeded else 0.0


def barn_2_8(trail: Trail) -> float | None:
    """Score of the BARN challenge since 2023."""
    return _barn(trail, 2.0, 8.0)


def barn_4_8(trail: Trail) -> float | None:
    """Score of the BARN challenge of 2022."""
    return _barn(trail, 4.0, 8.0)


def time_to_goal(trail: Trail) -> float | None:
    """Time from the start of the run to the goal, s. A failure counts as the limit, so that giving up is not fast."""
    if _is_untold(trail):
        return None
    return round(trail.end - float(trail.time[0]), 9) if trail.succeeded else trail.limit


def path_length(trail: Trail) -> float | None:
    """Distance driven, m."""
    return trail.path_length if trail.time.size else None


def goal_distance(trail: Trail) -> float | None:
    """Distance to the goal at the end, m."""
    return trail.goal_distance


def heading_error(trail: Trail) -> float | None:
    """Difference between the final heading and the one asked for, rad."""
    return trail.heading_error


def clearance_min(trail: Trail) -> float | None:
    """Least clearance, m, signed."""
    known = _known(trail.clearance)
    least = float(known.min()) if known.size else math.inf
    return least if math.isfinite(least) else None


def clearance_p5(trail: Trail) -> float | None:
    """5th percentile of the clearance over the ticks, m, interpolated linearly."""
    known = np.sort(_known(trail.clearance))
    if not known.size:
        return None
    place = 0.05 * (known.size - 1)
    low, share = int(place), place - int(place)
    ends = known[low : low + 2] if share else known[low : low + 1]
    if not np.isfinite(ends).all():
        return None
    return float(ends[0] + share * (ends[-1] - ends[0]))


def danger_share(trail: Trail) -> float | None:
    """Share of the time in which the clearance is at most the stopping distance at the current speed.

    The stopping distance is |v| t + v² / (2 a), with t the longest time a command stays in effect without renewal, and
    a the robot's deceleration.
    """
    speed = np.hypot(trail.vx, trail.vy) if trail.vy.size else np.abs(trail.vx)
    to_stop = speed * trail.reaction + 0.5 * speed**2 / trail.max_deceleration
    is_known = ~np.isnan(trail.clearance)
    # Clearances beyond the stopping distance are equivalent; infinite ones would break the interpolation.
    spare = np.minimum(trail.clearance, to_stop + 1.0) - to_stop
    return _share_below(trail.time[is_known], spare[is_known])


def cross_track_rms(trail: Trail) -> float | None:
    """Root mean square over time of the cross-track error, m, over the intervals with a reference."""
    e = trail.cross_track
    if np.isnan(e).all():
        return None
    steps = np.diff(trail.time)
    there = ~np.isnan(e[:-1]) & ~np.isnan(e[1:])
    if not there.any():
        return math.sqrt(float(np.nanmean(e**2)))
    a, b, step = e[:-1][there], e[1:][there], steps[there]
    # The mean square of a line from a to b is (a² + ab + b²) / 3.
    return math.sqrt(float(((a * a + a * b + b * b) * step).sum() / (3.0 * step.sum())))


def cross_track_max(trail: Trail) -> float | None:
    """Largest magnitude of the cross-track error, m."""
    known = _known(trail.cross_track)
    return float(np.abs(known).max()) if known.size else None


def integrated_jerk(trail: Trail) -> float | None:
    """∫ |da/dt| dt, m/s², of the acceleration a of base in the plane, averaged over a sliding window.

    The mean acceleration of a window is the change of velocity over the window divided by its length, which avoids a
    second derivative of samples. The integral is the path length of a, on a separate grid.
    """
    if trail.duration < 2.0 * JERK_WINDOW:
        return None
    step = JERK_WINDOW / _JERK_STEPS
    count = int(round((trail.duration - JERK_WINDOW) / step, 6)) + 1
    at = trail.time[0] + step * np.arange(count)
    acceleration = (_velocity(trail, at + JERK_WINDOW) - _velocity(trail, at)) / JERK_WINDOW
    change = np.diff(acceleration, axis=0)
    return float(np.hypot(change[:, 0], change[:, 1]).sum())


def turning_per_metre(trail: Trail) -> float | None:
    """∫ |dθ| over the distance driven, rad/m; turns on the spot count."""
    turned = float(np.abs(np.diff(np.unwrap(trail.heading))).sum())
    return _per_metre(trail, turned)


def steering_flips_per_metre(trail: Trail) -> float | None:
    """Changes of the commanded turn rate from left to right or back, 1/m, ignoring commands within the dead band."""
    steering = trail.command_wz[np.abs(trail.command_wz) > DEAD_BAND]
    return _per_metre(trail, float(np.count_nonzero(np.diff(np.sign(steering)))))


def stopped_time(trail: Trail) -> float | None:
    """Time in which the robot neither drove nor turned, s."""
    if not trail.time.size:
        return None
    moves = [trail.vx / STILL_SPEED, trail.wz / STILL_TURN]
    if trail.vy.size:
        moves.append(trail.vy / STILL_SPEED)
    begins, ends = zip(*(_within(part) for part in moves), strict=True)
    shares = np.maximum(np.min(ends, axis=0) - np.max(begins, axis=0), 0.0)
    return float((shares * np.diff(trail.time)).sum())


def avoider_share(trail: Trail) -> float | None:
    """Share of the ticks in which the avoider drove."""
    return float(trail.engaged.mean()) if trail.time.size else None


def recoveries(trail: Trail) -> float:
    """Number of recovery attempts."""
    return float(trail.recoveries)


def gate_stops(trail: Trail) -> float:
    """Number of times the gate stopped a driving robot."""
    return float(trail.gate_stops)


def gate_limits(trail: Trail) -> float:
    """Number of times the gate's monitor began to slow or stop the robot."""
    return float(trail.gate_limits)


def collisions(trail: Trail) -> float:
    """Number of contacts; at least 1 if the run ended in a collision, even without ground truth."""
    return float(max(trail.touches, trail.outcome == "collision"))


def own_contacts(trail: Trail) -> float | None:
    """Number of contacts that are the robot's own."""
    return float(sum(touch.is_own for touch in trail.contacts)) if trail.has_truth else None


def others_contacts(trail: Trail) -> float | None:
    """Number of contacts that are the other's."""
    return float(sum(not touch.is_own for touch in trail.contacts)) if trail.has_truth else None


def _is_untold(trail: Trail) -> bool:
    """Whether the robot reports success but there is no ground truth of its time and path."""
    return trail.succeeded and not trail.has_truth


def _optimal(trail: Trail) -> float | None:
    return trail.optimal if trail.optimal is not None and trail.optimal > 0.0 else None


def _barn(trail: Trail, low: float, high: float) -> float | None:
    """Perille et al. 2020, Xiao et al. 2022: S OT / clip(AT, low OT, high OT), OT the reference length at 2 m/s."""
    length = trail.optimal if trail.reference is None else trail.reference
    if length is None or length <= 0.0 or _is_untold(trail):
        return None
    optimum = length / REFERENCE_SPEED
    return optimum / min(max(_moving_time(trail), low * optimum), high * optimum) if trail.succeeded else 0.0


def _moving_time(trail: Trail) -> float:
    """AT, s: from when the robot was first 0.1 m from its start until it reached the goal; 0 if it never was."""
    if not trail.time.size:
        return 0.0
    away = np.hypot(trail.x - trail.x[0], trail.y - trail.y[0])
    first = int(np.argmax(away >= CLOCK_STARTS))
    if first == 0:
        return 0.0
    began = np.interp(CLOCK_STARTS, away[first - 1 : first + 1], trail.time[first - 1 : first + 1])
    return max(0.0, trail.end - float(began))


def _known(values: Floats) -> Floats:
    return values[~np.isnan(values)]


def _per_metre(trail: Trail, amount: float) -> float | None:
    way = trail.path_length
    return amount / way if way >= LEAST_WAY else None


def _velocity(trail: Trail, at: Floats) -> Floats:
    """(k, 2) velocity of base in the map frame at times within the trail, m/s: linear between ticks."""
    cos, sin = np.cos(trail.heading), np.sin(trail.heading)
    vx, vy = trail.vx * cos, trail.vx * sin
    if trail.vy.size:
        vx, vy = vx - trail.vy * sin, vy + trail.vy * cos
    return np.stack([np.interp(at, trail.time, vx), np.interp(at, trail.time, vy)], axis=-1)


def _share_below(time: Floats, values: Floats) -> float | None:
    """Share of the time in which a polyline of values is at most 0; for a single tick 1 or 0."""
    if time.size < 2:
        return float(values[0] <= 0.0) if time.size else None
    a, b = values[:-1], values[1:]
    rise = np.abs(b - a)
    below = np.where(rise > 0.0, np.maximum(-np.minimum(a, b), 0.0) / np.where(rise > 0.0, rise, 1.0), a <= 0.0)
    return float((np.minimum(below, 1.0) * np.diff(time)).sum() / (time[-1] - time[0]))


def _within(values: Floats) -> tuple[Floats, Floats]:
    """Where a polyline of values enters -1 to 1 in each of its n - 1 pieces, and where it leaves it: (n - 1,) shares.

    The values keep their signs: a line between magnitudes would not show a standstill between two directions.
    """
    a, rise = values[:-1], np.diff(values)
    is_level = rise == 0.0
    slope = np.where(is_level, 1.0, rise)
    with np.errstate(over="ignore"):  # of a rise of almost nothing: it is cut below
        low, high = np.sort([(-1.0 - a) / slope, (1.0 - a) / slope], axis=0)
    is_in = np.abs(a) <= 1.0
    low, high = np.where(is_level, np.where(is_in, 0.0, 1.0), low), np.where(is_level, np.where(is_in, 1.0, 0.0), high)
    return np.clip(low, 0.0, 1.0), np.clip(high, 0.0, 1.0)

"""Computes the metrics of localizers as functions of a trail. Definitions: docs/metrics.md."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from navloom.runs.episode_trail import Trail
from navloom.runs.localization import JUMP

__all__ = [
    "false_tracking",
    "false_tracking_time",
    "found_distance",
    "found_time",
    "heading_sigma_median",
    "jump_max",
    "jumps",
    "not_tracking_time",
    "pose_error_max",
    "pose_error_median",
    "pose_error_p95",
    "pose_error_rms",
    "pose_heading_max",
    "pose_heading_median",
    "pose_heading_rms",
    "sigma_median",
    "within_3_sigma",
]

Floats = NDArray[np.float64]


def pose_error_rms(trail: Trail) -> float | None:
    """Root mean square over the tracked ticks of the distance between the estimated and the true position, m."""
    return _rms(_tracked(trail, trail.localization.error))


def pose_error_median(trail: Trail) -> float | None:
    """Median over the tracked ticks of the distance between the estimated and the true position, m."""
    return _median(_tracked(trail, trail.localization.error))


def pose_error_p95(trail: Trail) -> float | None:
    """95th percentile over the tracked ticks of the distance between the estimated and the true position, m."""
    known = _tracked(trail, trail.localization.error)
    return float(np.percentile(known, 95)) if known.size else None


def pose_error_max(trail: Trail) -> float | None:
    """Largest distance between the estimated and the true position, m."""
    return _largest(_tracked(trail, trail.localization.error))


def pose_heading_rms(trail: Trail) -> float | None:
    """Root mean square over the tracked ticks of the difference between the estimated and the true heading, rad."""
    return _rms(_tracked(trail, trail.localization.turn_error))


def pose_heading_median(trail: Trail) -> float | None:
    """Median of that difference, rad."""
    return _median(_tracked(trail, trail.localization.turn_error))


def pose_heading_max(trail: Trail) -> float | None:
    """Largest such difference, rad."""
    return _largest(_tracked(trail, trail.localization.turn_error))


def found_time(trail: Trail) -> float | None:
    """Time until lasting true tracking, s. A robot that is never found counts with the limit."""
    known = trail.localization
    if not known.time.size:
        return None
    at = known.found_at
    return trail.limit if at is None else round(float(known.time[at] - trail.time[0]), 9)


def found_distance(trail: Trail) -> float | None:
    """Distance driven until then, m; all of it for a robot that is never found."""
    known = trail.localization
    if not known.time.size:
        return None
    at = known.found_at
    return trail.path_length if at is None else float(np.interp(known.time[at], trail.time, trail.way))


def not_tracking_time(trail: Trail) -> float | None:
    """Time in which the localizer did not track, s."""
    return trail.localization.not_tracking if trail.localization.time.size else None


def false_tracking(trail: Trail) -> float | None:
    """1 if the localizer tracked falsely for longer than a moment, else 0."""
    return float(trail.localization.false_tracking > 0.0) if trail.localization.time.size else None


def false_tracking_time(trail: Trail) -> float | None:
    """Time of that, s."""
    return trail.localization.false_tracking if trail.localization.time.size else None


def jump_max(trail: Trail) -> float | None:
    """Largest correction of a tick beyond odometry while the robot drove, m."""
    return _largest(trail.localization.jumps)


def jumps(trail: Trail) -> float | None:
    """Number of such corrections above `JUMP`."""
    found = trail.localization.jumps
    return float((found > JUMP).sum()) if found.size else None


def within_3_sigma(trail: Trail) -> float | None:
    """Share of the tracked ticks whose true pose is within three standard deviations."""
    known = trail.localization
    return float(known.is_within[known.is_tracking].mean()) if known.is_tracking.any() else None


def sigma_median(trail: Trail) -> float | None:
    """Median over the tracked ticks of the largest standard deviation of the position, m."""
    return _median(_tracked(trail, trail.localization.sigma))


def heading_sigma_median(trail: Trail) -> float | None:
    """The same of the heading, rad."""
    return _median(_tracked(trail, trail.localization.turn_sigma))


def _tracked(trail: Trail, values: Floats) -> Floats:
    """The values of the ticks in which the localizer tracked."""
    return values[trail.localization.is_tracking]


def _rms(values: Floats) -> float | None:
    return math.sqrt(float((values**2).mean())) if values.size else None


def _largest(values: Floats) -> float | None:
    return float(values.max()) if values.size else None


def _median(values: Floats) -> float | None:
    return float(np.median(values)) if values.size else None

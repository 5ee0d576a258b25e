"""Limits of a differential drive, scaling of a velocity to them on the same arc, and a bound on the tracking error."""

from __future__ import annotations

import math
from typing import NamedTuple

from navloom_lyapunov_tracker.law import TrackingError

__all__ = ["DriveLimits", "stiffest", "within_limits", "within_reach"]


class DriveLimits(NamedTuple):
    """Limits of a drive.

    Attributes:
        linear, angular: Largest |v|, m/s, and |w|, rad/s.
        wheel: Largest speed of a wheel, rad/s.
        wheel_radius, half_track: m.
        may_reverse: Whether the robot may drive backwards.
    """

    linear: float
    angular: float
    wheel: float
    wheel_radius: float
    half_track: float
    may_reverse: bool


def within_limits(v: float, w: float, limits: DriveLimits) -> tuple[float, float]:
    """Scale a velocity to meet all limits: v and w by the same factor, which keeps the curvature of the arc.

    The faster wheel turns at (|v| + half_track |w|) / wheel_radius: eq. (2) of Hoang et al. 2013. If the drive may not
    reverse, a negative speed becomes 0 and the turn rate is kept.

    Args:
        v, w: m/s and rad/s.
    """
    if v < 0.0 and not limits.may_reverse:
        v = 0.0
    wheel = (abs(v) + limits.half_track * abs(w)) / limits.wheel_radius
    excess = max(1.0, abs(v) / limits.linear, abs(w) / limits.angular, wheel / limits.wheel)
    return v / excess, w / excess


def stiffest(turn_radius: float) -> float:
    """Largest lateral gain, 1/m², of a law for a robot that steers: its wheels are at their limit R / 8 beside a path.

    Not from the papers, whose robots turn in place; infinite for these.

    Args:
        turn_radius: R, m; 0 for a robot that turns in place.
    """
    return 8.0 / turn_radius**2 if turn_radius > 0.0 else math.inf


def within_reach(error: TrackingError, reach: float) -> TrackingError:
    """Limit e1 and e2, m, of an error to ± `reach`, m."""
    e1, e2, e3 = error
    return TrackingError(min(max(e1, -reach), reach), min(max(e2, -reach), reach), e3)

"""The approach to a goal: slow enough near the end of a trajectory that the robot can stop within the goal's tolerance.

The speed profile of `trajectory` ends at the lowest speed of the reference. That is too fast for a small tolerance, a
soft brake or slow motors. Where it is not, the profile stays as it is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from navloom.navigation.braking import ACROSS, Braking

__all__ = ["SLOWEST", "least_tolerance", "slow_down"]

Floats = NDArray[np.float64]

SLOWEST = 0.01
"""Lowest speed of an approach, m/s: wheels do not turn steadily at less."""


def least_tolerance(braking: Braking) -> float:
    """Smallest tolerance, m, that a robot can stop within: its way to standstill from the slowest approach."""
    return braking.way(SLOWEST)


def slow_down(samples: Floats, braking: Braking, tolerance: float) -> Floats:
    """A trajectory whose last part is slow enough to stop within the tolerance of its end.

    From the speed v with which the robot comes within the tolerance, it stops near the goal. Within the tolerance the
    speed falls to v / 2. Before it, it falls by at most v / 2 in the time that the robot needs to follow.

    Args:
        samples: (n, 6) of `trajectory.SmoothPath`, read-only.
        braking: How the robot comes to rest.
        tolerance: Of the goal, m.

    Returns:
        The same array if it is slow enough, else a read-only copy with lower speeds.
    """
    left = samples[-1, 0] - samples[:, 0]
    if braking.way(float(np.interp(-tolerance, -left, samples[:, 5]))) <= ACROSS * tolerance:
        return samples
    v = max(SLOWEST, braking.speed_within(tolerance))
    # The robot follows the reference late, by its delay: over that time it may fall by half of v at most.
    gentle = min(braking.robot.max_deceleration, 0.5 * v / braking.delay)
    # Not down to zero: tracking laws need a moving reference, and the goal stops the robot.
    within = np.maximum(SLOWEST, 0.5 * v * (1.0 + left / tolerance))
    before = np.sqrt(v * v + 2.0 * gentle * np.maximum(left - tolerance, 0.0))
    # Copied, because the trajectory given may already be published.
    slowed = samples.copy()
    slowed[:, 5] = np.minimum(samples[:, 5], np.where(left <= tolerance, within, before))
    slowed.setflags(write=False)
    return slowed

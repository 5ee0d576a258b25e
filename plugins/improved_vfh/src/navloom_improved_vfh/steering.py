"""Choice of a direction, and the speed law: Hoang et al. 2013, III.C."""

import math
from collections.abc import Sequence

from navloom_avoidance.steering import wrap


def select_direction(
    directions: Sequence[float],
    heading: float,
    target: float,
    window: float,
    case_limit: float,
    previous: float | None,
    loyalty: float,
) -> float | None:
    """Direction to steer to, theta_d: steps 1 and 2, cases 1 and 2 of the paper.

    Args:
        directions: Candidate directions of the slots, rad, pose frame.
        heading: theta, rad. target: theta_t, direction of the target, rad.
        window: Candidates within this of the heading count, rad (100 deg).
        case_limit: Angle between heading and target, rad (90 deg). Below it the candidate nearest the target is taken
            (case 1), else the one nearest the heading (case 2).
        previous: Direction chosen last, rad, or None.
        loyalty: The cost of a candidate within this angle of the previous one is reduced by it, rad. Paper: 0.

    Returns:
        Direction, rad in [-pi, pi), or None where no candidate is within the window.
    """
    wanted = target if abs(wrap(heading - target)) < case_limit else heading
    best, least = None, math.inf
    for direction in directions:
        if abs(wrap(direction - heading)) >= window:
            continue
        cost = abs(wrap(direction - wanted))
        if previous is not None and abs(wrap(direction - previous)) <= loyalty:
            cost -= loyalty
        if cost < least:
            best, least = wrap(direction), cost
    return best


def forward_speed(
    d30: float, gain: float, standoff: float, v_max: float, free_run: float, deceleration: float, delay: float = 0.0
) -> float:
    """V = 5 (d30 - 0.4) between 0 and V_max, and never faster than the robot can stop within the free run.

    Args:
        d30: Distance to the nearest obstacle within 30 deg of the heading, m.
        gain: 1/s (5). standoff: m (0.4). v_max: m/s (0.5).
        free_run: Free distance straight ahead, m; +inf gives the paper's law alone.
        deceleration: m/s^2. delay: Delay of the motors before they brake, s.
    """
    lost = deceleration * delay
    stoppable = math.sqrt(lost * lost + 2.0 * deceleration * max(0.0, free_run)) - lost
    return max(0.0, min(v_max, gain * (d30 - standoff), stoppable))


def is_turning(turn: float, was_turning: bool, on: float, off: float) -> bool:
    """Whether V is divided by 2.5: from |omega| >= `on` (10 deg/s) until |omega| < `off`; all in rad/s."""
    return abs(turn) >= (off if was_turning else on)

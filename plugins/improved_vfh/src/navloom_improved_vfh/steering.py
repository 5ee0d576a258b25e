"""Choice of a direction, and the law for the speed: Hoang et al. 2013, III.C."""

import math
from collections.abc import Sequence

from navloom.avoidance.steering import wrap


def select_direction(
    directions: Sequence[float],
    heading: float,
    target: float,
    window: float,
    case_limit: float,
    previous: float | None,
    loyalty: float,
) -> float | None:
    """The direction to steer to, theta_d: steps 1 and 2, cases 1 and 2 of the paper.

    Args:
        directions: Candidates of the slots, rad, pose frame.
        heading: theta, rad. target: theta_t, direction of the target, rad.
        window: Candidates within this of the heading count, rad (100 deg).
        case_limit: Below this angle between heading and target the candidate nearest the target is taken (case 1),
            else the one nearest the heading (case 2), rad (90 deg).
        previous: Direction chosen last, rad, or None.
        loyalty: A candidate within this of the previous one is preferred by as much, rad; 0 is the paper.

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
    """V = 5 (d30 - 0.4) between 0 and V_max, and never more than can be stopped in the free run.

    Args:
        d30: Distance to the nearest obstacle within 30 deg of the heading, m.
        gain: 1/s (5). standoff: m (0.4). v_max: m/s (0.5).
        free_run: m, straight ahead; +inf leaves the paper's law alone.
        deceleration: m/s^2. delay: Of the motors, s, before they brake.
    """
    lost = deceleration * delay
    stoppable = math.sqrt(lost * lost + 2.0 * deceleration * max(0.0, free_run)) - lost
    return max(0.0, min(v_max, gain * (d30 - standoff), stoppable))


def is_turning(turn: float, was_turning: bool, on: float, off: float) -> bool:
    """Whether V is divided by 2.5: |omega| >= 10 deg/s, until it falls below `off`; all in rad/s."""
    return abs(turn) >= (off if was_turning else on)

"""Turn rate and speed for a direction: Borenstein & Koren 1991 (VFH), also used by VFH+ and VFH*."""

import math

from navloom_avoidance.steering import turn_rate

__all__ = ["forward_speed", "stopping_speed", "turn_rate", "turning_speed"]


def forward_speed(density: float, full: float, turn: float, max_turn: float, v_max: float, v_min: float) -> float:
    """V' = V_max (1 - min(h'_c, h_m) / h_m) and V = max(V_min, V' (1 - |Omega| / Omega_max)).

    Args:
        density: h'_c, in the current direction of travel. full: h_m, density from which V' is 0.
        turn, max_turn: Omega and Omega_max, rad/s. v_max, v_min: m/s.
    """
    slowed = v_max * (1.0 - min(density, full) / full)
    return max(v_min, slowed * (1.0 - min(1.0, abs(turn) / max_turn)))


def stopping_speed(distance: float, deceleration: float, reaction: float) -> float:
    """Greatest speed, m/s, from which a robot stops within a distance: v t + v^2 / (2 b) = d.

    Args:
        distance: d, m. deceleration: b, m/s^2. reaction: t, time before it brakes, s.
    """
    lost = deceleration * reaction
    return math.sqrt(lost * lost + 2.0 * deceleration * max(0.0, distance)) - lost


def turning_speed(distance: float, error: float, max_turn: float) -> float:
    """Greatest speed, m/s, at which the robot's smallest circle still reaches its target.

    The circle from the robot through the target has the curvature 2 sin(e) / d, so v <= Omega_max d / (2 sin(e)). A
    target behind, |e| > 90 deg, is turned to first: the limit falls to 0 at 180 deg.

    Args:
        distance: d, m. error: e, bearing of the target relative to the heading, rad. max_turn: Omega_max, rad/s.
    """
    off = abs(error)
    if off > 0.5 * math.pi:
        return 0.5 * max_turn * distance * (1.0 + math.cos(off))
    return 0.5 * max_turn * distance / max(math.sin(off), 1.0e-6)

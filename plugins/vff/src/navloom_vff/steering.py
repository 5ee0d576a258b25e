"""Turn rate and speed for a resultant force: Borenstein & Koren 1989."""

import math

from navloom_avoidance.steering import turn_rate

__all__ = ["forward_speed", "low_pass", "slowed_for_turn", "turn_rate"]


def low_pass(previous: float, wanted: float, period: float, time_constant: float) -> float:
    """Omega'(i) = (T Omega(i) + (tau - T) Omega'(i - 1)) / tau, with tau = 0.4 s.

    Args:
        previous: Omega'(i - 1). wanted: Omega(i), in the same unit.
        period: T, s. time_constant: tau, s; there is no filtering if tau <= T.
    """
    share = min(1.0, period / time_constant) if time_constant > 0.0 else 1.0
    return previous + share * (wanted - previous)


def forward_speed(strength: float, cosine: float, v_max: float, slows_leaving: bool, full: float) -> float:
    """V = V_max where there is no force, else V_max (1 - |cos theta|).

    Args:
        strength: |F_r|. cosine: forces.travel_cosine(). v_max: m/s.
        slows_leaving: True is the printed formula, which stops a robot that heads straight away from an obstacle.
        full: Force from which |cos theta| counts in full; a weaker force counts in proportion. 0 is the printed
            formula, where even the weakest push from straight ahead stops the robot.
    """
    share = min(1.0, strength / full) if full > 0.0 else float(strength > 0.0)
    toward = abs(cosine) if slows_leaving else max(0.0, -cosine)
    return v_max * (1.0 - share * toward)


def slowed_for_turn(speed: float, direction: float, heading: float) -> float:
    """Component of a speed, m/s, in the wanted direction, rad; 0 from 90 degrees off."""
    return speed * max(0.0, math.cos(direction - heading))

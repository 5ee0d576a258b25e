"""Fierro, Lewis, *Control of a Nonholonomic Mobile Robot: Backstepping Kinematics into Dynamics*, Journal of Robotic
Systems 14 (3), 1997: a kinematic law, and the acceleration that brings the robot's actual velocity to it.

The paper converts that acceleration into wheel torques with the robot's masses. A navloom platform takes velocities, so
here it is integrated over a tick. The kinematic law is eq. (8) of Kanayama et al. 1990 with other gains.
"""

from __future__ import annotations

import math

from navloom_lyapunov_tracker.law import TrackingError

from navloom_trackers.kanayama import control_rule

__all__ = [
    "acceleration",
    "command_rates",
    "energy",
    "energy_rate",
    "kinematic_command",
    "projected_speed",
    "velocity_after",
]


def kinematic_command(
    error: TrackingError, v_ref: float, w_ref: float, k1: float, k2: float, k3: float
) -> tuple[float, float]:
    """Velocity v_c of a robot without lag: v_r cos e3 + k1 e1 and w_r + k2 v_r e2 + k3 v_r sin e3.

    Args:
        error: m and rad, base frame.
        v_ref, w_ref: Reference speed, m/s (> 0), and turn rate, rad/s.
        k1, k2, k3: 1/s, 1/m² and 1/m, > 0.
    """
    return control_rule(error, v_ref, w_ref, k1, k2, k3)


def command_rates(
    error: TrackingError, rates: TrackingError, v_ref: float, k1: float, k2: float, k3: float
) -> tuple[float, float]:
    """Time derivative of `kinematic_command`, m/s² and rad/s², for a constant reference speed and turn rate.

    Args:
        error, rates: Error, m and rad, and its rates, m/s and rad/s, from `kanayama.error_rates`.
        v_ref: Reference speed, m/s.
        k1, k2, k3: 1/s, 1/m² and 1/m.
    """
    forward = -v_ref * math.sin(error.e3) * rates.e3 + k1 * rates.e1
    return forward, v_ref * (k2 * rates.e2 + k3 * math.cos(error.e3) * rates.e3)


def acceleration(actual: float, command: float, command_rate: float, k4: float) -> float:
    """Control u of one velocity, m/s² or rad/s²: the rate of v_c, plus k4 (v_c - v).

    Args:
        actual, command: v and v_c, m/s or rad/s.
        command_rate: Rate of v_c, m/s² or rad/s².
        k4: 1/s, > 0.
    """
    return command_rate + k4 * (command - actual)


def velocity_after(actual: float, command: float, command_rate: float, k4: float, period: float) -> float:
    """Velocity after a period, s, of `acceleration`, while v_c changes at its rate.

    The solution is exact, so any k4 is stable. The other arguments are those of `acceleration`.
    """
    return command + command_rate * period + (actual - command) * math.exp(-k4 * period)


def projected_speed(v: float, e3: float, curvature: float, cross_track: float) -> float:
    """Speed of the robot's foot point on its path, m/s: v cos e3 / (1 - κ n).

    Not from the paper, whose reference moves with time.

    Args:
        v: Speed of the robot, m/s.
        e3: Heading error, rad.
        curvature: κ of the path at the foot point, 1/m, positive to the left.
        cross_track: n, distance of the robot to the left of the path, m; n is limited to 0.8 / κ where κ n > 0.8.
    """
    # At the centre of the path's curve the foot point is not defined, and the speed grows without bound.
    return v * math.cos(e3) / max(1.0 - curvature * cross_track, 0.2)


def energy(
    error: TrackingError, lags: tuple[float, float], v_ref: float, gains: tuple[float, float, float, float]
) -> float:
    """Lyapunov function, m²/s: k1 (e1² + e2²) + 2 k1 / k2 (1 - cos e3) + (e4² + k1 / (k2 k3 v_r) e5²) / 2 k4.

    Args:
        error: e1, e2, m, and e3, rad.
        lags: e4, m/s, and e5, rad/s: the robot's velocity minus `kinematic_command`.
        v_ref: Reference speed, m/s, constant and > 0.
        gains: k1, k2, k3, k4.
    """
    (k1, k2, k3, k4), (e4, e5) = gains, lags
    kinematic = k1 * (error.e1**2 + error.e2**2) + 2.0 * k1 / k2 * (1.0 - math.cos(error.e3))
    return kinematic + (e4**2 + k1 / (k2 * k3 * v_ref) * e5**2) / (2.0 * k4)


def energy_rate(
    error: TrackingError, lags: tuple[float, float], v_ref: float, gains: tuple[float, float, float, float]
) -> float:
    """Rate of `energy` under `acceleration`, m²/s², never positive; arguments are those of `energy`.

    -k1² e1² - (k1 e1 + e4)² - k1 k3 v_r / k2 sin² e3 - k1 / (k2 k3 v_r) (k3 v_r sin e3 + e5)².
    """
    (k1, k2, k3, _), (e4, e5) = gains, lags
    turned = k3 * v_ref * math.sin(error.e3)
    ahead = (k1 * error.e1) ** 2 + (k1 * error.e1 + e4) ** 2
    return -ahead - k1 / (k2 * k3 * v_ref) * (turned**2 + (turned + e5) ** 2)

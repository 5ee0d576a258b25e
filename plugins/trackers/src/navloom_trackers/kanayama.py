"""Kanayama, Kimura, Miyazaki, Noguchi, *A Stable Tracking Control Method for an Autonomous Mobile Robot*, ICRA 1990.

Errors are those of `navloom_lyapunov_tracker.law.tracking_error`, which is also the paper's eq. (4). The turn rate is
proportional to the reference speed, so the shape of the way back to the path does not depend on that speed.
"""

from __future__ import annotations

import math

from navloom_lyapunov_tracker.law import TrackingError

__all__ = ["control_rule", "critical_gain", "energy", "energy_rate", "error_rates", "reach"]


def error_rates(error: TrackingError, v: float, w: float, v_ref: float, w_ref: float) -> TrackingError:
    """Time derivative of the error, m/s and rad/s: eq. (7).

    Args:
        error: m and rad, base frame.
        v, w: Speed, m/s, and turn rate, rad/s, of the robot.
        v_ref, w_ref: The same of the reference point.
    """
    return TrackingError(
        w * error.e2 - v + v_ref * math.cos(error.e3),
        v_ref * math.sin(error.e3) - w * error.e1,
        w_ref - w,
    )


def control_rule(
    error: TrackingError, v_ref: float, w_ref: float, k_x: float, k_y: float, k_theta: float
) -> tuple[float, float]:
    """Velocity that makes the error vanish: eq. (8).

    Args:
        error: m and rad, base frame.
        v_ref, w_ref: Reference speed, m/s (> 0), and turn rate, rad/s.
        k_x: 1/s, > 0.
        k_y: 1/m², > 0.
        k_theta: 1/m, > 0. Lateral poles: s² + k_theta v_ref s + k_y v_ref².

    Returns:
        Forward speed, m/s, and turn rate, rad/s, before the limits of the robot.
    """
    v = v_ref * math.cos(error.e3) + k_x * error.e1
    w = w_ref + v_ref * (k_y * error.e2 + k_theta * math.sin(error.e3))
    return v, w


def critical_gain(k_y: float) -> float:
    """k_theta, 1/m, for critical damping at k_y, 1/m²: eq. (20), k_theta² = 4 k_y."""
    return 2.0 * math.sqrt(k_y)


def reach(k_y: float, k_theta: float, approach: float) -> float:
    """Lateral error, m, at which eq. (8) settles at a heading error of `approach`, rad (0..π/2), for w_r = 0.

    Not from the paper. Farther from the path, eq. (8) alone heads back at ever steeper angles, and a robot that turns
    in place above some angle does so repeatedly.
    """
    return k_theta * math.sin(approach) / k_y


def energy(error: TrackingError, k_y: float) -> float:
    """Lyapunov function, m²: eq. (10), ½ (e1² + e2²) + (1 - cos e3) / k_y."""
    return 0.5 * (error.e1**2 + error.e2**2) + (1.0 - math.cos(error.e3)) / k_y


def energy_rate(error: TrackingError, v_ref: float, k_x: float, k_y: float, k_theta: float) -> float:
    """Rate of eq. (10) under eq. (8), m²/s: -k_x e1² - v_ref k_theta sin² e3 / k_y, from the proof of proposition 1."""
    return -k_x * error.e1**2 - v_ref * k_theta * math.sin(error.e3) ** 2 / k_y

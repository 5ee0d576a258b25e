"""Kanayama, Kimura, Miyazaki, Noguchi, *A Stable Tracking Control Method for an Autonomous Mobile Robot*, ICRA 1990.

Errors are those of `navloom_lyapunov_tracker.law.tracking_error`, which is the paper's eq. (4) too. The turn rate is in
proportion to the reference speed, so that the shape of the way back does not depend on it.
"""

from __future__ import annotations

import math

from navloom_lyapunov_tracker.law import TrackingError

__all__ = ["control_rule", "critical_gain", "energy", "energy_rate", "error_rates", "reach"]


def error_rates(error: TrackingError, v: float, w: float, v_ref: float, w_ref: float) -> TrackingError:
    """How fast the error changes, m/s and rad/s: eq. (7).

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
    """k_theta, 1/m, that damps critically at k_y, 1/m²: eq. (20), k_theta² = 4 k_y."""
    return 2.0 * math.sqrt(k_y)


def reach(k_y: float, k_theta: float, approach: float) -> float:
    """Lateral error, m, at which eq. (8) settles on a heading error of `approach`, rad (0..π/2), where w_r is 0. Ours.

    Farther off, eq. (8) alone heads back ever more squarely, and a robot that turns in place above an angle does so
    again and again.
    """
    return k_theta * math.sin(approach) / k_y


def energy(error: TrackingError, k_y: float) -> float:
    """Lyapunov function, m²: eq. (10), ½ (e1² + e2²) + (1 - cos e3) / k_y."""
    return 0.5 * (error.e1**2 + error.e2**2) + (1.0 - math.cos(error.e3)) / k_y


def energy_rate(error: TrackingError, v_ref: float, k_x: float, k_y: float, k_theta: float) -> float:
    """How fast eq. (10) falls under eq. (8), m²/s: proof of proposition 1, -k_x e1² - v_ref k_theta sin² e3 / k_y."""
    return -k_x * error.e1**2 - v_ref * k_theta * math.sin(error.e3) ** 2 / k_y

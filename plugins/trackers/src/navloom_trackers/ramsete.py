"""The nonlinear tracker known as RAMSETE: De Luca, Oriolo, Vendittelli, *Control of Wheeled Mobile Robots: An
Experimental Overview*, 2001, section on nonlinear feedback, after Samson 1993.

It is law (6) of `navloom-lyapunov-tracker` with a lateral gain b and gains that grow with the reference velocity.
"""

from __future__ import annotations

import math

from navloom_lyapunov_tracker.law import TrackingError, sinc

__all__ = ["energy", "energy_rate", "feedback_gain", "reach", "tracking_command"]


def feedback_gain(v_ref: float, w_ref: float, zeta: float, b: float) -> float:
    """Gain of e1 and e3, 1/s: k = 2 zeta sqrt(w_ref² + b v_ref²).

    Args:
        v_ref, w_ref: Reference speed, m/s, and turn rate, rad/s.
        zeta: Damping of the lateral error, > 0; 1 is critical.
        b: Lateral gain, 1/m², > 0.
    """
    return 2.0 * zeta * math.sqrt(w_ref * w_ref + b * v_ref * v_ref)


def tracking_command(error: TrackingError, v_ref: float, w_ref: float, zeta: float, b: float) -> tuple[float, float]:
    """Velocity that makes the error vanish: v = v_r cos e3 + k e1, w = w_r + k e3 + b v_r e2 sin e3 / e3.

    Args:
        error: m and rad in [-π, π), base frame.
        v_ref, w_ref, zeta, b: As for `feedback_gain`. Lateral poles on a line: s² + 2 zeta √b v_ref s + b v_ref².

    Returns:
        Forward speed, m/s, and turn rate, rad/s, before the limits of the robot.
    """
    k = feedback_gain(v_ref, w_ref, zeta, b)
    v = v_ref * math.cos(error.e3) + k * error.e1
    w = w_ref + k * error.e3 + b * v_ref * error.e2 * sinc(error.e3)
    return v, w


def reach(v_ref: float, w_ref: float, zeta: float, b: float, approach: float) -> float:
    """Lateral error, m, whose term in the turn rate balances that of a heading error of `approach`, rad (0..π/2).

    Not from the paper. The other arguments are those of `feedback_gain`.
    """
    return feedback_gain(v_ref, w_ref, zeta, b) * approach / (b * v_ref * sinc(approach))


def energy(error: TrackingError, b: float) -> float:
    """Lyapunov function: ½ b (e1² + e2²) + ½ e3²."""
    return 0.5 * b * (error.e1**2 + error.e2**2) + 0.5 * error.e3**2


def energy_rate(error: TrackingError, v_ref: float, w_ref: float, zeta: float, b: float) -> float:
    """Rate of `energy` under `tracking_command`, 1/s: -k b e1² - k e3², also for a changing reference."""
    return -feedback_gain(v_ref, w_ref, zeta, b) * (b * error.e1**2 + error.e3**2)

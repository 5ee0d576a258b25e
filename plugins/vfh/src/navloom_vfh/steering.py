"""Turn rate and speed for a direction: Borenstein & Koren 1991 (VFH), also used by VFH+ and VFH*."""

from navloom_avoidance.steering import turn_rate

__all__ = ["forward_speed", "turn_rate"]


def forward_speed(density: float, full: float, turn: float, max_turn: float, v_max: float, v_min: float) -> float:
    """V' = V_max (1 - min(h'_c, h_m) / h_m) and V = max(V_min, V' (1 - |Omega| / Omega_max)).

    Args:
        density: h'_c, in the current direction of travel. full: h_m, density from which V' is 0.
        turn, max_turn: Omega and Omega_max, rad/s. v_max, v_min: m/s.
    """
    slowed = v_max * (1.0 - min(density, full) / full)
    return max(v_min, slowed * (1.0 - min(1.0, abs(turn) / max_turn)))

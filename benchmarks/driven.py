"""Robot and goals of `soak`, `fleet` and `robot_cpu`: a simulated robot with the paper's laser and sonars."""

from __future__ import annotations

__all__ = ["PLACES", "config"]

PLACES = ((0.0, 3.2), (1.6, 2.0), (-1.2, 2.4), (0.0, 0.8))
"""Goals in the first room of `paper_gates`, visited in turn, m, map frame."""


def config(world: str, period: float, stop_after: float, sweeps: str = "on_request") -> str:
    """TOML of a robot that waits for goals.

    Args:
        world: Name of the world.
        period: Period of the control tick, s.
        stop_after: Longest run, s.
        sweeps: Mode of the laser: "on_request" or "continuous".
    """
    return f"""
[run]
period = {period}
stop_after = {stop_after}

[world]
ref = "{world}"

[platform]
plugin = "sensors_sim"

[[sensor]]
name = "laser"
kind = "pitched_laser"
geometry = "paper"
mode = "{sweeps}"

[[sensor]]
name = "sonars"
kind = "sonar_ring"
layout = "p3dx"

[navigation]
drive = false
start = {{ x = 0.0, y = 0.0, heading_deg = 90.0 }}
"""

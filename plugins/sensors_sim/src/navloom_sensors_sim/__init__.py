"""A simulated robot for navloom: worlds, lasers, sonars, odometry and contact."""

from __future__ import annotations

from navloom import Registry, hookimpl


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Adds the platform."""
    from navloom_sensors_sim.adapter import SensorsSim

    registry.add(SensorsSim)

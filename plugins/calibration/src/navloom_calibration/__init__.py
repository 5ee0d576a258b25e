"""Measures a laser's time offset and the yaw of its mount from a recorded drive.

Begin with `laser_track.py`, the motion that the scans show without odometry; `offset.py` compares its turn rate with
that of the odometry, `mount_yaw.py` its direction. `recorded.py` reads a recording into arrays.
"""

from navloom import Registry, hookimpl


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add the command."""
    registry.command("calibrate", "navloom_calibration.cli:calibrate")

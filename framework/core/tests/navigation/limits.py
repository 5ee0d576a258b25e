"""Limits for tests that vary one property of the robot or of the reference."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, TypeVar

from navloom.navigation.braking import Braking
from navloom.navigation.collision_monitor import MonitorLimits
from navloom.navigation.command_gate import GateLimits
from navloom.navigation.trajectory import SpeedLimits
from navloom.testing import robot

__all__ = ["speed_limits", "with_robot"]

L = TypeVar("L", GateLimits, MonitorLimits, Braking)


def with_robot(limits: L, **changes: Any) -> L:
    """The same limits for a robot with some other attributes of RobotSpec."""
    return replace(limits, robot=replace(limits.robot, **changes))


def speed_limits(slowest: float = 0.2, fastest: float = 0.4, lateral: float = 0.3, **changes: Any) -> SpeedLimits:
    """Limits of a reference, for a robot with some other attributes of RobotSpec."""
    spec = {"max_angular": math.radians(25.0), "max_deceleration": 0.5}
    return SpeedLimits(robot(**{**spec, **changes}), slowest, fastest, lateral)

"""The robot's properties that avoiders use."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from navloom.roles import RobotSpec

__all__ = ["Robot"]


@dataclass(frozen=True)
class Robot:
    """The robot's properties that avoiders use.

    Attributes:
        footprint: (k, 2) corners of a convex polygon, m, base frame.
        max_linear, max_angular: Speed limits, m/s and rad/s.
        max_acceleration, max_deceleration: m/s².
        motor_lag: Time constant with which the wheels follow a command, s.
        dead_time: Time from a command until it acts on the wheels, s.
        half_track: Half the distance between the wheels, m.
        max_angular_acceleration: rad/s²; infinite for no limit.
        turn_radius: Smallest radius that it can drive, m; 0 if it turns in place.
    """

    footprint: NDArray[np.float64]
    max_linear: float
    max_angular: float
    max_acceleration: float
    max_deceleration: float
    motor_lag: float = 0.0
    dead_time: float = 0.0
    half_track: float = 0.0
    max_angular_acceleration: float = math.inf
    turn_radius: float = 0.0

    @classmethod
    def of(cls, spec: RobotSpec) -> Self:
        """From the description of the robot in a plugin's context."""
        return cls(
            spec.footprint, spec.max_linear, spec.max_angular, spec.max_acceleration, spec.max_deceleration,
            spec.motor_lag, spec.dead_time, spec.half_track, spec.max_angular_acceleration, spec.turn_radius,
        )  # fmt: skip

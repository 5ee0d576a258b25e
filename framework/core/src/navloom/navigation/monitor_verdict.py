"""What the gate's monitor knows of the robot, and what it says of a command."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navloom.messages import Point2D, Twist2D
from navloom.roles import RobotSpec

__all__ = ["Kind", "MonitorLimits", "Planar", "Surroundings", "Touch", "Verdict", "scaled"]

Kind = Literal["", "obstacle", "unseen"]
Floats = NDArray[np.float64]
Planar = tuple[float, float, float]
"""A velocity: forward, m/s, turn rate, rad/s, to the left, m/s."""
Touch = tuple[Kind, Point2D, float]
"""What the robot would touch: kind, place in the base frame, m, and distance from the footprint, m."""


@dataclass(frozen=True)
class MonitorLimits:
    """The robot and sensor model of the monitor.

    Attributes:
        robot: Its footprint, how it brakes, and its delays.
        period: Control tick, s.
        sigma: Standard deviation of a range, m.
        margin: Distance from the footprint that counts as touching, m.
        approach_speed: Largest speed of moving obstacles that is allowed for, m/s; 0 takes all to be at rest.
    """

    robot: RobotSpec
    period: float
    sigma: float
    margin: float = 0.01
    approach_speed: float = 0.0


class Surroundings(NamedTuple):
    """What a command is judged by.

    Attributes:
        in_flight: (k, 3) commands given before, see `stopping_way`.
        age: Age of the newest odometry, s.
        points: (k, 3) obstacles, m, base frame of the newest odometry, and how far they may reach beyond, m.
        moving: (k, 7) obstacles that move, see `first_meeting`.
        accelerates: The command is faster than the one before, by half of what the robot can or more.
    """

    in_flight: Floats
    age: float
    points: Floats
    moving: Floats
    accelerates: bool


class Verdict(NamedTuple):
    """The monitor's decision on a command.

    Attributes:
        twist: The velocity that may be driven.
        share: Its share of the command; 1 if the command passes unchanged.
        kind: What limits it: nothing, an obstacle, or space that no sensor has seen.
        place: Place of the obstacle or unseen space in the base frame, m; None for nothing.
        distance: Distance from the footprint to it, m.
    """

    twist: Twist2D
    share: float = 1.0
    kind: Kind = ""
    place: Point2D | None = None
    distance: float | None = None

    @property
    def is_stopped(self) -> bool:
        """Whether the robot is stopped because something is in the way."""
        return bool(self.kind) and self.twist.vx == 0.0 and self.twist.vy == 0.0 and self.twist.wz == 0.0


def scaled(command: Planar, share: float) -> Planar:
    """A share of a velocity."""
    return share * command[0], share * command[1], share * command[2]

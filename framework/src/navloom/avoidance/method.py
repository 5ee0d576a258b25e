"""What methods have in common that decide on one command a tick: the robot, its motors, and what it was sent."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from navloom.avoidance.beams import Beams
from navloom.avoidance.clearance import footprint_edges
from navloom.avoidance.decision import Decision
from navloom.avoidance.motors import Motors
from navloom.avoidance.robot import Robot

__all__ = ["Method"]

Pose = tuple[float, float, float]
Point = tuple[float, float]


class Method(ABC):
    """A method that decides on one command a tick, for one robot. What is its own is `decide`.

    Args:
        robot: What it has to know of it.
        period: Of the control tick, s.

    Attributes:
        edges: Of the footprint, see `clearance.footprint_edges`.
        motors: Of the robot, with the commands that it was given.
        in_flight: (n, 2) m/s and rad/s, of this tick, see `Motors.in_flight`.
    """

    def __init__(self, robot: Robot, period: float) -> None:
        self.robot, self.period = robot, period
        self.edges = footprint_edges(robot.footprint)
        self.motors = Motors.of(robot, period)
        self.in_flight = np.zeros((1, 2))

    def reset(self) -> None:
        """Forget every command."""
        self.motors.reset()
        self.in_flight = np.zeros((1, 2))

    def step(
        self, beams: Beams | None, pose: Pose, twist: tuple[float, float], target: Point, share: float = 1.0
    ) -> Decision:
        """Decide for one tick.

        Args:
            beams: Readings of this tick, None where there are none.
            pose: x, y, m, heading, rad, of the base in the pose frame.
            twist: Present forward speed, m/s, and turn rate, rad/s.
            target: x_t, y_t, m, pose frame.
            share: Of the last command that the gate let through.
        """
        self.in_flight = self.motors.in_flight(twist, share)
        decision = self.decide(beams, pose, twist, target)
        self.motors.give(decision.speed, decision.turn)
        return decision

    @abstractmethod
    def decide(self, beams: Beams | None, pose: Pose, twist: tuple[float, float], target: Point) -> Decision:
        """The command of this tick; arguments as for `step`."""

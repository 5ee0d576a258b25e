"""Base of avoidance methods that decide on one command per tick: the robot, its motors, and the commands in flight."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from navloom_avoidance.beams import Beams
from navloom_avoidance.clearance import footprint_edges
from navloom_avoidance.decision import Decision
from navloom_avoidance.motors import Motors
from navloom_avoidance.robot import Robot

__all__ = ["Method"]

Pose = tuple[float, float, float]
Point = tuple[float, float]


class Method(ABC):
    """A method that decides on one command per tick for one robot. A subclass implements `decide`.

    Args:
        robot: The robot's properties.
        period: Control tick, s.

    Attributes:
        edges: Half planes of the footprint, see `clearance.footprint_edges`.
        motors: Model of the robot's motors, with the commands that they have not followed yet.
        in_flight: (n, 2) commands in flight in this tick, m/s and rad/s, see `Motors.in_flight`.
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
            beams: Readings of this tick; None for none.
            pose: x, y, m, heading, rad, of the base in the pose frame.
            twist: Current forward speed, m/s, and turn rate, rad/s.
            target: x_t, y_t, m, pose frame.
            share: Share of the last command that the gate let pass.
        """
        self.in_flight = self.motors.in_flight(twist, share)
        decision = self.decide(beams, pose, twist, target)
        self.motors.give(decision.speed, decision.turn)
        return decision

    @abstractmethod
    def decide(self, beams: Beams | None, pose: Pose, twist: tuple[float, float], target: Point) -> Decision:
        """The command of this tick; arguments as for `step`."""

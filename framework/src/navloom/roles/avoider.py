"""Avoider: the velocity that passes what the map does not know."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

from navloom.messages import Avoidance, Point2D, PoseEstimate, RangeScan, Twist2D
from navloom.roles.base import Role

__all__ = ["Avoider", "AvoiderInput"]


@dataclass(frozen=True, slots=True)
class AvoiderInput:
    """What an avoider sees. Its footprint and limits are in the context.

    Attributes:
        stamp_ns: Run clock.
        scans: What the range sensors gave in this tick, in order of sensor; empty where none was due.
        estimate: Pose in the map and velocity in base.
        target: Point to steer to, m, map frame.
        corridor: Half width of the strip to the target that must be free, m.
        desired: What the controller asks for.
        remaining: Distance still to drive after the target, m; 0 where the target is the goal.
        share: Of the last command that the gate's monitor let through; 1 where it saw nothing in the way.
    """

    stamp_ns: int
    scans: tuple[RangeScan, ...]
    estimate: PoseEstimate
    target: Point2D
    corridor: float
    desired: Twist2D
    remaining: float
    share: float = 1.0


class Avoider(Role):
    """Steers round what is sensed. It steps every tick, whether it drives or not."""

    role = "avoider"
    needs_sensor = True

    @abstractmethod
    def avoid(self, given: AvoiderInput) -> Avoidance:
        """Velocity for this tick, the status, and why."""

"""The node of what moves in the simulated world beside the robot."""

from __future__ import annotations

from navloom.engine.node_ports import Latest, Output
from navloom.engine.nodes.node_base import Node, Tick
from navloom.engine.streams import PlatformPorts, WorldPorts
from navloom.geometry.moving_world import Mover, MovingWorld
from navloom.messages import Pose2D, Truth, Twist2D

__all__ = ["WorldNode", "mover_of"]


def mover_of(truth: Truth) -> Mover:
    """A robot as the others meet it."""
    pose, twist = truth.pose, truth.twist
    return Mover(pose.x, pose.y, pose.heading, twist.vx, twist.vy, twist.wz)


class WorldNode(Node):
    """Says before each tick of the platform what moves, from the truth of the tick before.

    Only a robot that is simulated in a world where something moves has this node.

    Args:
        world: The world; None in a member of a fleet, which steps one world for all and puts what it says on `bodies`.
        start: True start of the robot, map frame, before its first truth.
        lead_ns: Time from its tick to the moment of which it tells, ns. In lockstep 0, as it steps first in the tick.
            Live one period: there it steps when the platform has, whose next tick reads it.
    """

    role = "world"
    ticks = True
    truth = Latest(PlatformPorts.truth, delayed=True)
    odometry = Latest(PlatformPorts.odometry, delayed=True)
    cause = odometry  # and not the truth, which may be dropped between hosts
    bodies = Output(WorldPorts.bodies)

    def __init__(self, world: MovingWorld | None, start: Pose2D, lead_ns: int = 0) -> None:
        self.world, self.lead_ns = world, lead_ns
        self._start = Truth(start, Twist2D(0.0, 0.0, 0.0), 0.0, "", False)

    def step(self, tick: Tick) -> None:
        assert self.world is not None
        robot = mover_of(self.truth.value or self._start)
        self.bodies.put(self.world.advance(tick.time_ns + self.lead_ns, [robot]))

"""The loop of `navloom ros serve`: forwards the streams of a live robot to a ROS network, and goals to the robot."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from navloom import Navigator, NavloomError

from navloom_ros.message_types import Types
from navloom_ros.node import Node
from navloom_ros.serving.goals import Goals
from navloom_ros.serving.outlets import STREAMS, Outlets
from navloom_ros.serving.poses import Poses
from navloom_ros.times import time_of
from navloom_ros.translating import Translated, Translator
from navloom_ros.wire import epoch_ns, monotonic_ns

__all__ = ["TAKEN", "Serving", "serve"]

TAKEN = ("goals", "pose")
"""Inputs that --take can allow."""
CHANGE_CHECK_INTERVAL = 0.1
"""Longest wait for messages of the robot in one iteration, s."""
AGAIN = 1.0
"""Interval of diagnostics, of checks that the robot is up, and of attempts to connect to it, s."""
GONE = 3
"""Consecutive checks without a node of the robot after which it counts as down."""


@dataclass(frozen=True)
class Serving:
    """Settings of `serve`.

    Attributes:
        robot, connect, keys, insecure: The robot; arguments of `navloom.Navigator`.
        router, domain, namespace, types: The ROS network; arguments of `Node`.
        publish: What to publish, keys of STREAMS.
        take: What to take from the network, of TAKEN.
    """

    robot: str | None
    connect: str | None
    keys: str | None
    insecure: bool
    router: str
    domain: int
    namespace: str
    types: Types
    publish: Sequence[str]
    take: Sequence[str]


def serve(given: Serving, ends: Callable[[], bool], say: Callable[[str], None]) -> None:
    """Serve a robot until told to end; while it is down, retry.

    Args:
        given: What to serve, and where.
        ends: Whether to end.
        say: Shows a line to the user.

    Raises:
        RosError: The ROS network cannot be joined.
    """
    with Node("navloom_server", namespace=given.namespace, router=given.router, domain=given.domain,
              types=given.types) as node:  # fmt: skip
        outlets = Outlets(node, given.publish, say)
        goals = Goals(node, "map", (NavloomError, RuntimeError), say) if "goals" in given.take else None
        poses = Poses(node, "map", say) if "pose" in given.take else None
        said = ""
        try:
            while not ends():
                try:
                    with Navigator(given.robot, given.connect, given.keys, given.insecure) as robot:
                        say(f"robot {robot.client.keys.prefix} is served in domain {given.domain} of {given.router}")
                        said = ""
                        _Session(given, robot, outlets, goals, poses, say).run(ends)
                        why = "the robot went down"
                except NavloomError as error:
                    why = str(error)
                if not ends() and why != said:
                    said = why
                    say(f"{why}; retrying until it is up")
                outlets.put(_gone(given.types, why))
                node.wait_for(lambda graph: ends(), AGAIN)
        finally:
            if goals is not None:
                goals.close()


class _Session:
    """One connection to the robot, from its start to the robot's end."""

    def __init__(
        self,
        given: Serving,
        robot: Navigator,
        outlets: Outlets,
        goals: Goals | None,
        poses: Poses | None,
        say: Callable[[str], None],
    ) -> None:
        self._say = say
        self._robot, self._outlets, self._goals, self._poses = robot, outlets, goals, poses
        self._translator = Translator(given.types)
        streams = sorted({stream for name in given.publish for stream in STREAMS[name]})
        always = ("localizer/pose", "gate/selection", "gate/status")
        self._listening = robot.listen(sorted({*streams, *always}))
        self._status: tuple[Any, ...] | None = None

    def run(self, ends: Callable[[], bool]) -> None:
        """Forward messages until the robot is down or `ends` returns true."""
        missed, looked_ns = 0, monotonic_ns()
        try:
            while not ends() and missed < GONE:
                for told in self._listening.take(CHANGE_CHECK_INTERVAL):
                    self._take(*told)
                if self._poses is not None and (place := self._poses.take()) is not None:
                    self._place(place)
                if monotonic_ns() - looked_ns > AGAIN * 1e9:
                    looked_ns = monotonic_ns()
                    missed = 0 if self._robot.client.has_nodes() else missed + 1
                    if self._status is not None:  # diagnostics tools expect 1 Hz
                        self._publish(*self._status)
        finally:
            if self._goals is not None:
                self._goals.robot = None

    def _place(self, place: tuple[float, float, float]) -> None:
        try:
            self._robot.place(*place)
        except NavloomError as error:  # as from a localizer that takes no pose
            self._say(f"pose refused: {error}")

    def _take(self, role: str, instance: str, port: str, message: Any, stamp_ns: int) -> None:
        if (role, port) == ("gate", "status"):
            self._status = role, instance, port, message, stamp_ns
        if self._goals is not None and (role, port) == ("localizer", "pose"):
            self._goals.pose = (message.pose.x, message.pose.y, message.pose.heading)
            self._goals.robot = self._robot
        self._publish(role, instance, port, message, stamp_ns)

    def _publish(self, role: str, instance: str, port: str, message: Any, stamp_ns: int) -> None:
        # ROS tools look up transforms at the stamp of each message, so all stamps are times of this host.
        self._translator.offset_ns = epoch_ns() - stamp_ns
        for made in self._translator.translate(role, instance, port, message, stamp_ns):
            self._outlets.put(made)


def _gone(types: Types, why: str) -> Translated:
    status = {"level": 2, "name": "navloom: gate", "message": f"no robot: {why}"}
    header = {"stamp": time_of(epoch_ns())}
    return Translated("/diagnostics", types.new("diagnostic_msgs/msg/DiagnosticArray", header=header, status=[status]))

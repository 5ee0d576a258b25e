"""The loop of `navloom ros serve`: forwards the streams of a live robot to a ROS network, and goals to the robot."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from navloom import Navigator, NavloomError
from navloom.geometry.collision import overlap_depth
from navloom.geometry.footprints import inscribed_radius
from navloom.geometry.frames import transform
from navloom.geometry.world import Place, Raster, World
from numpy.typing import NDArray

from navloom_ros.message_types import Types
from navloom_ros.node import Node
from navloom_ros.serving.behaviours import Behaviours
from navloom_ros.serving.clock import Clock
from navloom_ros.serving.costmaps import inflated, local_costmap, monitor_state
from navloom_ros.serving.goals import Goals
from navloom_ros.serving.lifecycle import offer_states
from navloom_ros.serving.map_cells import OCCUPIED, OUTSIDE, UNKNOWN, cells_at, outside
from navloom_ros.serving.outlets import STREAMS, Outlets
from navloom_ros.serving.planning import Planning
from navloom_ros.serving.poses import Estimate, Poses
from navloom_ros.serving.speed_limits import SpeedLimits
from navloom_ros.times import time_of
from navloom_ros.translating import Translated, Translator
from navloom_ros.wire import monotonic_ns

__all__ = ["TAKEN", "Serving", "serve"]

TAKEN = ("goals", "pose")
"""Inputs that --take can allow."""
FAILURES = (NavloomError, RuntimeError)
"""What the robot's client raises if a request is refused, or not answered."""
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
        router, domain, namespace, types, remap: The ROS network; arguments of `Node`.
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
    remap: Mapping[str, str] = field(default_factory=dict)


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
              types=given.types, remap=given.remap) as node:  # fmt: skip
        clock = Clock(node)  # before the actions, which stamp goals with it
        outlets = Outlets(node, given.publish, say)
        goals = Goals(node, "map", FAILURES, say) if "goals" in given.take else None
        if goals is not None:
            Behaviours(node, goals, FAILURES, time.sleep)
            Planning(node, goals, "map", FAILURES, hits)
            offer_states(node, lambda: goals.can_drive, lambda: goals.robot is not None)
        poses = Poses(node, "map", FAILURES, say) if "pose" in given.take else None
        limits = SpeedLimits(node, FAILURES, say) if "goals" in given.take else None
        said = ""
        try:
            while not ends():
                try:
                    with Navigator(given.robot, given.connect, given.keys, given.insecure) as robot:
                        say(f"robot {robot.client.keys.prefix} is served in domain {given.domain} of {given.router}")
                        said = ""
                        _Session(given, robot, outlets, goals, poses, limits, clock, say).run(ends)
                        why = "the robot went down"
                except NavloomError as error:
                    why = str(error)
                if not ends() and why != said:
                    said = why
                    say(f"{why}; retrying until it is up")
                outlets.put(_gone(given.types, why, clock.now_ns()))
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
        limits: SpeedLimits | None,
        clock: Clock,
        say: Callable[[str], None],
    ) -> None:
        self._say, self._clock = say, clock
        self._is_simulated: bool | None = None
        self._map: Any = None
        self._costmap: Any = None
        self._limits = limits
        self._footprint = robot.footprint()
        if goals is not None:
            goals.footprint = self._footprint
        self._pose: tuple[float, float] | None = None
        self._types = given.types
        self._robot, self._outlets, self._goals, self._poses = robot, outlets, goals, poses
        self._translator = Translator(given.types)
        streams = sorted({stream for name in given.publish for stream in STREAMS[name]})
        always = ("localizer/pose", "gate/selection", "gate/status", "mapper/map")
        self._listening = robot.listen(sorted({*streams, *always}))
        self._status: tuple[Any, ...] | None = None

    def run(self, ends: Callable[[], bool]) -> None:
        """Forward messages until the robot is down or `ends` returns true."""
        missed, looked_ns = 0, monotonic_ns()
        if self._poses is not None:
            self._poses.robot = self._robot
        try:
            while not ends() and missed < GONE:
                if self._is_simulated is None:
                    self._find_clock()
                heard = self._clock.wait(CHANGE_CHECK_INTERVAL)
                for told in self._listening.take(CHANGE_CHECK_INTERVAL) if heard else ():
                    self._take(*told)
                if self._poses is not None and (place := self._poses.take()) is not None:
                    self._place(place)
                is_due = monotonic_ns() - looked_ns > AGAIN * 1e9
                if self._limits is not None:
                    self._limits.take(self._robot, repeats=is_due)
                if is_due:
                    looked_ns = monotonic_ns()
                    missed = 0 if self._robot.client.has_nodes() else missed + 1
                    if self._status is not None:  # diagnostics tools expect 1 Hz
                        self._publish(*self._status)
                    self._publish_local_costmap()
        finally:
            if self._goals is not None:
                self._goals.detach()
            if self._poses is not None:
                self._poses.robot = None

    def _find_clock(self) -> None:
        """Follow the clock of the robot's platform: `ros2_base` may drive a simulated robot."""
        self._is_simulated = _is_simulated(self._robot)
        self._clock.follow(bool(self._is_simulated))
        if self._is_simulated:
            self._say("the robot is simulated: stamps are those of /clock, and nothing is published before it")

    def _place(self, place: Estimate) -> None:
        # The robot itself knows only the bounds of a world that its config names.
        if why := outside(self._map, *place[:2]):
            self._say(f"pose refused: {why}")
            return
        try:
            try:
                self._robot.place(*place)
            except NavloomError:
                if place.sigma is None:
                    raise
                # RViz gives every pose a spread, and most localizers that cannot search take one.
                self._robot.place(*place[:3])
        except NavloomError as error:  # as from a localizer that takes no pose
            self._say(f"pose refused: {error}")

    def _take(self, role: str, instance: str, port: str, message: Any, stamp_ns: int) -> None:
        if (role, port) == ("localizer", "pose"):
            self._pose = message.pose.x, message.pose.y
        if (role, port) == ("mapper", "map"):
            self._map = grid = message.grid
            radius = inscribed_radius(self._footprint) / grid.resolution
            self._costmap = replace(grid, cells=inflated(grid.cells, radius))
            if self._goals is not None:
                self._goals.map = message.grid
        if (role, port) == ("gate", "status"):
            self._status = role, instance, port, message, stamp_ns
        if self._goals is not None and (role, port) == ("gate", "status"):
            is_silent = message.why is not None and message.why.kind == "silent_platform"
            self._goals.is_stopped = message.latched or is_silent
        if self._goals is not None and (role, port) == ("localizer", "pose"):
            self._goals.pose = (message.pose.x, message.pose.y, message.pose.heading)
            self._goals.robot = self._robot
        self._publish(role, instance, port, message, stamp_ns)

    def _publish(self, role: str, instance: str, port: str, message: Any, stamp_ns: int) -> None:
        # ROS tools look up transforms at the stamp of each message, so all stamps are times of one clock.
        self._translator.offset_ns = self._clock.now_ns() - stamp_ns
        for made in self._translator.translate(role, instance, port, message, stamp_ns):
            self._outlets.put(made)
            if made.topic == "/map":
                values = {
                    "header": made.message.header,
                    "info": made.message.info,
                    "data": self._costmap.cells.reshape(-1),
                }
                costmap = self._types.new("nav_msgs/msg/OccupancyGrid", **values)
                self._outlets.put(Translated("/global_costmap/costmap", costmap))
        if (role, port) == ("gate", "status"):
            self._outlets.put(monitor_state(self._types, message))

    def _publish_local_costmap(self) -> None:
        """The part of the global costmap round the robot, which has none of its own."""
        if self._costmap is not None and self._pose is not None:
            header = {"stamp": time_of(self._clock.now_ns()), "frame_id": "map"}
            self._outlets.put(local_costmap(self._types, self._costmap, self._pose, header))


def hits(
    footprint: NDArray[np.float64], grid: Any, places: NDArray[np.float64], is_unknown_bad: bool
) -> NDArray[np.bool_]:
    """Which places, (n, 3) m, m, rad, the robot cannot be at: its footprint covers an obstacle or leaves the map.

    As the framework judges contact; touching is allowed.
    """
    blocked = (grid.cells >= OCCUPIED) | ((grid.cells == UNKNOWN) & is_unknown_bad)
    origin = Place(grid.origin.x, grid.origin.y, grid.origin.heading)
    world = World("map", raster=Raster("map", blocked, grid.resolution, origin))
    return np.array(
        [
            (cells_at(grid, transform(place, footprint)) == OUTSIDE).any()
            or overlap_depth(footprint, Place(*place.tolist()), world, "map") > 0.0
            for place in places
        ],
        np.bool_,
    )


def _is_simulated(robot: Navigator) -> bool | None:
    """Whether the stamps of the robot's platform are those of /clock; None if no platform answers."""
    for node in robot.client.describe():
        if node.role == "platform":
            with suppress(NavloomError):  # it restarts, and is asked again
                return bool(robot.get_parameters("platform", node.instance).get("simulated", False))
    return None


def _gone(types: Types, why: str, now_ns: int) -> Translated:
    status = {"level": 2, "name": "navloom: gate", "message": f"no robot: {why}"}
    header = {"stamp": time_of(now_ns)}
    return Translated("/diagnostics", types.new("diagnostic_msgs/msg/DiagnosticArray", header=header, status=[status]))

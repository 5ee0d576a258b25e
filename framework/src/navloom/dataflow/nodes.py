"""Nodes round the roles: each turns what its ports hold into the role's input, and the answer into port messages."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np

from navloom.dataflow.door import LocalizerDoor, MapperDoor, PlannerDoor, PlatformDoor, TwistDoor
from navloom.messages import (
    Avoidance,
    AvoiderStatus,
    Command,
    Message,
    Path,
    PoseEstimate,
    PoseTrack,
    RangeScan,
    RecoveryStep,
    Sweep,
    TrackingCommand,
    Twist2D,
)
from navloom.navigation.handover import NOWHERE, HandOverRule, own_way
from navloom.plugins.blame import raised_in
from navloom.roles import (
    Avoider,
    AvoiderInput,
    Controller,
    ControllerInput,
    Localizer,
    LocalizerInput,
    Mapper,
    MapperInput,
    Planner,
    PlannerInput,
    Platform,
    PlatformInput,
    Recovery,
    RecoveryInput,
    Role,
)

__all__ = ["Node", "Outputs", "Tick", "fault_text", "role_node"]

Inputs = Mapping[str, Any]
Outputs = list[tuple[str, Message]]
STILL = Twist2D(0.0, 0.0, 0.0)
BEFORE_DATA_NS = 500_000_000
"""How much more of a track a mapper is given than its data covers."""
TRAIL_STEP = 0.05
"""m between two places a robot has been, as recoveries see them."""
TRAIL_LENGTH = 100


class Tick(NamedTuple):
    """The step's place in time: number, run clock in s and ns, and the selection in force."""

    number: int
    time: float
    time_ns: int
    epoch: int


class Track(Protocol):
    """The newest poses, oldest first."""

    def __len__(self) -> int: ...

    def __getitem__(self, place: int, /) -> PoseEstimate: ...


class Node(Protocol):
    """What an executor steps."""

    def step(self, tick: Tick, given: Inputs) -> Outputs:
        """Outputs as (port, message) from what the ports hold."""


class PlatformNode:
    """The robot itself."""

    def __init__(self, plugin: Platform) -> None:
        self.plugin = plugin
        self.door = PlatformDoor(plugin)

    def step(self, tick: Tick, given: Inputs) -> Outputs:
        command, sweeps = given["command"], given["sweep"]
        twist = command.twist if command is not None else STILL
        seen = PlatformInput(twist, sweeps[-1] if sweeps else None, tick.time_ns)
        got = self.door.check(self.plugin.advance(seen), seen)
        out: Outputs = [("odometry", got.odometry), ("contact", got.contact), *got.scans.items()]
        if got.truth is not None:
            out.append(("truth", got.truth))
        return out


class LocalizerNode:
    """Odometry and scans to a pose in the map."""

    def __init__(self, plugin: Localizer) -> None:
        self.plugin = plugin
        self.door = LocalizerDoor(plugin)
        self.scans = _ScanReader()

    def step(self, tick: Tick, given: Inputs) -> Outputs:
        seen = LocalizerInput(given["odometry"], self.scans.read(given), given["map"])
        return [("pose", self.door.check(self.plugin.localize(seen), seen))]


class MapperNode:
    """Range data and the poses that cover it to a map."""

    def __init__(self, plugin: Mapper) -> None:
        self.plugin = plugin
        self.door = MapperDoor(plugin)
        self.scans = _ScanReader()

    def step(self, tick: Tick, given: Inputs) -> Outputs:
        data = self.scans.read(given)
        sweeps = tuple(message for message in data if isinstance(message, Sweep))
        scans = tuple(message for message in data if isinstance(message, RangeScan))
        track = _covering(given["track"], min((message.stamp_ns for message in data), default=tick.time_ns))
        seen = MapperInput(tick.time_ns, sweeps, scans, track, bool(given["clear"]))
        update = self.door.check(self.plugin.update(seen), seen)
        return [] if update is None else [("map", update)]


def _covering(poses: Track, since_ns: int) -> PoseTrack:
    """The end of a track, from a little before the oldest data on: a mapper has no use for the minutes before."""
    kept: list[PoseEstimate] = []
    for back in range(1, len(poses) + 1):
        kept.append(poses[-back])
        if kept[-1].stamp_ns <= since_ns - BEFORE_DATA_NS:
            break
    kept.reverse()
    return PoseTrack(
        np.array([pose.stamp_ns for pose in kept], dtype=np.int64),
        np.array([(p.pose.x, p.pose.y, p.pose.heading) for p in kept], dtype=np.float64).reshape(-1, 3),
    )


class PlannerNode:
    """The newest request to a path, or why there is none. `tolerance` is the goal's, m."""

    def __init__(self, plugin: Planner, tolerance: float) -> None:
        self.plugin = plugin
        self.door = PlannerDoor(plugin, tolerance)

    def step(self, tick: Tick, given: Inputs) -> Outputs:
        if given["map"] is None:
            return []
        seen = PlannerInput(given["plan"][-1], given["map"])
        answer = self.door.check(self.plugin.plan(seen), seen)
        return [("path" if isinstance(answer, Path) else "failure", answer)]


class ControllerNode:
    """The reference to a velocity."""

    def __init__(self, plugin: Controller) -> None:
        self.plugin = plugin
        self.door = TwistDoor(plugin, TrackingCommand)

    def step(self, tick: Tick, given: Inputs) -> Outputs:
        seen = ControllerInput(tick.time_ns, given["trajectory"], given["reference"], given["pose"])
        return [("command", self.door.check(self.plugin.control(seen)))]


class AvoiderNode:
    """Scans and the target to a velocity, and whether it is this one that drives.

    Args:
        plugin: The avoider.
        rule: Decides who drives.
        look_ahead: How far that is looked for along the way the robot itself takes next, m; 0 for not at all.
    """

    def __init__(self, plugin: Avoider, rule: HandOverRule, look_ahead: float) -> None:
        self.plugin = plugin
        self.door = TwistDoor(plugin, Avoidance)
        self.rule = rule
        self.look_ahead = look_ahead
        self.scans = _ScanReader()

    def step(self, tick: Tick, given: Inputs) -> Outputs:
        estimate, reference = given["pose"], given["reference"]
        scans = self.scans.read(given)
        ahead = max(0.0, reference.remaining - _distance(estimate.pose, reference.target))
        status = given.get("gate")  # an imported log has no gate
        seen = AvoiderInput(
            tick.time_ns,
            scans,
            estimate,
            reference.target,
            reference.corridor,
            given["desired"].twist,
            ahead,
            1.0 if status is None else status.share,
        )
        answer = self.door.check(self.plugin.avoid(seen))
        desired = given["desired"].twist
        own = own_way(estimate.pose, desired, self.look_ahead) if self.look_ahead > 0.0 else NOWHERE
        handover = self.rule.step(tick.time, scans, estimate.pose, reference.way, reference.corridor, own)
        return [
            ("command", Command(answer.twist)),
            ("status", AvoiderStatus(answer.status, answer.diagnostics)),
            ("handover", handover),
        ]


class RecoveryNode:
    """Called while the goal asks for it; one attempt ends with `done` or `failed`."""

    def __init__(self, plugin: Recovery) -> None:
        self.plugin = plugin
        self.door = TwistDoor(plugin, RecoveryStep)
        self.scans = _ScanReader()
        self._attempt: object = None
        self._is_over = True
        self._trail: deque[tuple[float, float, float]] = deque(maxlen=TRAIL_LENGTH)

    def step(self, tick: Tick, given: Inputs) -> Outputs:
        request = given["request"]
        scans = self.scans.read(given)
        self._follow(given["pose"])
        if request is None or not request.active or given["pose"] is None:
            return []
        starts = request is not self._attempt
        if starts:
            self._attempt, self._is_over = request, False
        if self._is_over:
            return []
        trail = np.array(self._trail).reshape(-1, 3)
        trail.flags.writeable = False
        seen = RecoveryInput(tick.time_ns, scans, given["pose"], request.attempt, request.reason, starts, trail)
        answer = self.door.check(self.plugin.recover(seen))
        self._is_over = answer.state != "running"
        return [("command", Command(answer.twist)), ("status", answer)]

    def _follow(self, estimate: PoseEstimate | None) -> None:
        """Keep where the robot has been."""
        if estimate is None:
            return
        pose = estimate.pose
        if not self._trail or math.dist((pose.x, pose.y), self._trail[-1][:2]) >= TRAIL_STEP:
            self._trail.append((pose.x, pose.y, pose.heading))


class _ScanReader:
    """Collects what a node's sensor ports hold, in order of time and then of port."""

    def __init__(self) -> None:
        self._names: tuple[str, ...] | None = None

    def read(self, given: Inputs) -> tuple[Any, ...]:
        if self._names is None:
            self._names = tuple(name for name in given if name.startswith("scan."))
        if len(self._names) == 1:
            return tuple(given[self._names[0]])
        found = [message for name in self._names for message in given[name]]
        return tuple(sorted(found, key=lambda message: message.stamp_ns))


def fault_text(error: BaseException, source: Node | type[Role]) -> str:
    """What a node or a plugin's class raised, with the innermost line of the plugin's own code for its author."""
    cls = source if isinstance(source, type) else type(getattr(source, "plugin", source))
    return raised_in(error, cls)


def _distance(pose: Any, point: Any) -> float:
    return float(((point.x - pose.x) ** 2 + (point.y - pose.y) ** 2) ** 0.5)


_NODES: dict[str, Callable[[Any], Node]] = {
    "platform": PlatformNode,
    "localizer": LocalizerNode,
    "mapper": MapperNode,
    "controller": ControllerNode,
    "recovery": RecoveryNode,
}


def role_node(plugin: Role, rule: HandOverRule | None = None, look_ahead: float = 0.0, tolerance: float = 0.0) -> Node:
    """The node for a plugin.

    Args:
        plugin: The plugin.
        rule, look_ahead: For an avoider: who drives, and how far that looks along the robot's own way, m.
        tolerance: For a planner: how near to its goal the robot must come, m.
    """
    if isinstance(plugin, Avoider):
        assert rule is not None
        return AvoiderNode(plugin, rule, look_ahead)
    if isinstance(plugin, Planner):
        return PlannerNode(plugin, tolerance)
    return _NODES[plugin.role](plugin)

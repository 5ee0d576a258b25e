"""The smallest plugin of each role, for tests of the framework that should not depend on real ones."""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from importlib.metadata import EntryPoint
from typing import Any

import numpy as np
from navloom import (
    ANYWHERE,
    Avoidance,
    Avoider,
    AvoiderDiagnostics,
    AvoiderInput,
    Contact,
    Context,
    Controller,
    ControllerInput,
    LocalizerInput,
    Mapper,
    MapperInput,
    MapUpdate,
    OccupancyGrid,
    Odometry,
    Params,
    Path,
    PlanFailure,
    Planner,
    PlannerInput,
    Platform,
    PlatformInput,
    PlatformOutput,
    Point2D,
    Pose2D,
    PoseEstimate,
    RangeScan,
    Recovery,
    RecoveryInput,
    RecoveryStep,
    Registry,
    TrackingCommand,
    Truth,
    Twist2D,
    hookimpl,
)
from navloom.config import Loaded, load_config
from navloom.engine.run_warnings import RunWarning
from navloom.navigation.dead_reckoning import OdometryLocalizer
from navloom.plugins import Discovery
from navloom.runs.episode import Episode
from pydantic import Field

QUIET = AvoiderDiagnostics(
    np.empty((0, 0), dtype=np.uint8), 0.0, 0.0, 0.0, np.empty(0), 0.0, np.empty((0, 2)), None, ""
)


class Robot(Platform):
    """A unicycle without inertia in an empty plane; its one sensor looks all round and gets no echo.

    The range limit of its scans is noisy.
    """

    name = "toy_robot"
    sensor_kinds = {"ear": RangeScan}
    is_simulated = True

    class Params(Params):
        noise: bool = True
        touches_at: float | None = Field(None, description="x at which a bump is felt, m")

    def __init__(self, params: Any, context: Context) -> None:
        super().__init__(params, context)
        self.pose = [0.0, 0.0, 0.0]
        self.time_ns = 0

    def advance(self, given: PlatformInput) -> PlatformOutput:
        period = (given.time_ns - self.time_ns) * 1e-9
        self.time_ns = given.time_ns
        twist = given.command
        self.pose[0] += twist.vx * period * math.cos(self.pose[2])
        self.pose[1] += twist.vx * period * math.sin(self.pose[2])
        self.pose[2] = math.remainder(self.pose[2] + twist.wz * period, math.tau)
        pose = Pose2D(*self.pose)
        start = self.context.start
        cos, sin = math.cos(start.heading), math.sin(start.heading)
        in_map = Pose2D(start.x + cos * pose.x - sin * pose.y, start.y + sin * pose.x + cos * pose.y, pose.heading)
        limit = self.params.touches_at
        touching = limit is not None and in_map.x >= limit
        scans = {spec.name: self._listen(spec.name) for spec in self.context.sensors}
        odometry = Odometry(given.time_ns, pose, twist)
        return PlatformOutput(odometry, scans, Contact(touching), Truth(in_map, twist, math.inf, "", touching))

    def _listen(self, name: str) -> RangeScan:
        jitter = float(self.context.stream(name).normal()) if self.params.noise else 0.0
        one = np.ones(1)
        return RangeScan(self.time_ns, np.zeros((1, 2)), 0 * one, np.pi * one, 0 * one, np.inf * one, 0.1, 4.0 + jitter)


class Blank(Mapper):
    """An empty map, once."""

    name = "toy_blank"
    accepts = (RangeScan,)

    class Params(Params):
        size: int = 40

    def __init__(self, params: Any, context: Context) -> None:
        super().__init__(params, context)
        self.given = False

    def update(self, given: MapperInput) -> MapUpdate | None:
        if self.given and not given.clear:
            return None
        self.given = True
        cells = np.zeros((self.params.size, self.params.size), dtype=np.int8)
        grid = OccupancyGrid(cells, 0.5, Pose2D(-5.0, -10.0, 0.0))
        return MapUpdate(given.stamp_ns, grid, np.empty((0, 4)), ())


class Straight(Planner):
    """Start and goal, and nothing between; goals beyond `reach` are outside the map."""

    name = "toy_straight"

    class Params(Params):
        reach: float = 50.0

    def plan(self, given: PlannerInput) -> Path | PlanFailure:
        start, goal = given.request.start, given.request.goal
        length = math.hypot(goal.x - start.x, goal.y - start.y)
        if length > self.params.reach:
            return PlanFailure(given.request.request_id, "outside_map", Point2D(goal.x, goal.y), "too far")
        return Path(given.request.request_id, np.array([(start.x, start.y), (goal.x, goal.y)]), length, None)


class Chaser(Controller):
    """Turns towards the reference and drives at its speed."""

    name = "toy_chaser"

    class Params(Params):
        gain: float = Field(1.0, gt=0.0, lt=10.0)
        fails_at_ns: int | None = None
        answers: str = ""

    def control(self, given: ControllerInput) -> TrackingCommand:
        if self.params.answers == "exit":
            raise SystemExit(3)
        if self.params.answers:
            return {"none": None, "twist": Twist2D(0.1, 0.0, 0.0)}[self.params.answers]  # type: ignore[return-value]
        if self.params.fails_at_ns is not None and given.stamp_ns >= self.params.fails_at_ns:
            raise RuntimeError("broke")
        reference, pose = given.reference, given.estimate.pose
        wanted = reference.pose.heading if reference.turn_to is None else reference.turn_to
        error = math.remainder(wanted - pose.heading, math.tau)
        speed = reference.speed if reference.turn_to is None else 0.0
        turn = self.params.gain * (error - reference.cross_track)
        if reference.turn_to is not None:
            turn = self.params.gain * error
        return TrackingCommand(Twist2D(speed, 0.0, turn), 0.0, -reference.cross_track, error)


class Bystander(Avoider):
    """Passes on the desired velocity, slower."""

    name = "toy_bystander"

    class Params(Params):
        share: float = 0.5

    def avoid(self, given: AvoiderInput) -> Avoidance:
        twist = Twist2D(given.desired.vx * self.params.share, 0.0, given.desired.wz)
        return Avoidance(twist, "clear", QUIET)


class Finder(OdometryLocalizer):
    """Follows the odometry from `at`, but says so only once the robot has turned, if it was not told its place."""

    name = "toy_finder"
    can_search = True

    class Params(Params):
        turn: float = Field(3.0, description="rad")
        at: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __init__(self, params: Any, context: Context) -> None:
        super().__init__(params, context)
        self.searches: list[tuple[Pose2D | None, tuple[float, float]]] = []
        self.left, self.heading = 0.0, 0.0
        if context.start_sigma is not None:
            is_guess = context.start_sigma != ANYWHERE
            self.search(context.start if is_guess else None, context.start_sigma)

    def search(self, near: Pose2D | None = None, sigma: tuple[float, float] = ANYWHERE) -> None:
        self.searches.append((near, sigma))
        self.left = self.params.turn
        super().place(Pose2D(*self.params.at))

    def localize(self, given: LocalizerInput) -> PoseEstimate:
        found, heading = super().localize(given), given.odometry.pose.heading
        self.left -= abs(math.remainder(heading - self.heading, math.tau))
        self.heading = heading
        return found if self.left <= 0.0 else replace(found, state="searching", reason="several places fit")


class Turner(Recovery):
    """Waits where it is stuck; turns on the spot while the localizer searches."""

    name = "toy_turner"
    looks_around = True

    def recover(self, given: RecoveryInput) -> RecoveryStep:
        looks = given.reason == "searching"
        return RecoveryStep(Twist2D(0.0, 0.0, 0.5 if looks else 0.0), "running" if looks else "done", False)


@hookimpl
def navloom_register(registry: Registry) -> None:
    for toy in (Robot, Blank, Straight, Chaser, Bystander, Finder, Turner):
        registry.add(toy)


NAMES = ["platform.toy_robot", "mapper.toy_blank", "planner.toy_straight", "controller.toy_chaser",
         "avoider.toy_bystander", "localizer.toy_finder", "recovery.toy_turner"]  # fmt: skip
TEXT = """
[run]
seed = 1
stop_after = 60.0
[robot]
footprint = { length = 0.8, width = 0.8 }
max_angular_deg = 60.0
[world]
ref = "empty"
[platform]
plugin = "toy_robot"
[[sensor]]
name = "ear"
kind = "ear"
[mapper]
plugin = "toy_blank"
[planner]
plugin = "toy_straight"
[controller]
plugin = "toy_chaser"
[avoider]
plugin = "toy_bystander"
[navigation]
start = { x = 0.0, y = 0.0, heading_deg = 0.0 }
goal = { x = 3.0, y = 0.0 }
"""


def discovery() -> Discovery:
    """The toys in addition to the installed plugins."""
    from importlib.metadata import entry_points

    sys.modules.setdefault("navloom_test_toys", sys.modules[__name__])
    toys = [EntryPoint(name, "navloom_test_toys", "navloom") for name in NAMES]
    return Discovery(found=[*entry_points(group="navloom"), *toys])


def blamed(episode: Episode) -> list[RunWarning]:
    """Warnings of an episode, but for steps that were late by the clock alone: other tests take the processor too."""
    return [warning for warning in episode.warnings if warning.kind != "late"]


def toy_config(folder: Any, *overrides: str, more: str = "") -> Loaded:
    """Config of a run of 3 m straight ahead, with changes."""
    path = folder / "toy.toml"
    path.write_text(TEXT + more, "utf-8")
    return load_config(str(path), overrides)

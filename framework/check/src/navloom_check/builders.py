"""Builders with defaults for unit tests: a plugin, and the input of its verb, in one line. `messages` builds messages.

A unit test of an avoider:

    from navloom.testing import avoider_input, make, scan, wall_ahead

    def test_it_stops_before_a_wall():
        avoider = make(MyAvoider, gain=2.0)
        answer = avoider.avoid(avoider_input(scan(wall_ahead(0.4))))
        assert answer.twist.vx <= 0.0

Everything is in SI units. A pose is given as (x, y) or (x, y, heading).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
from navloom.config.tables import RunTable
from navloom.engine.random_streams import stream_source
from navloom.geometry.footprints import rectangle
from navloom.geometry.moving_world import MovingWorld, moves
from navloom.geometry.world import World
from navloom.messages import (
    MapUpdate,
    Message,
    OccupancyGrid,
    Odometry,
    PlanRequest,
    Point2D,
    Pose2D,
    PoseTrack,
    RangeScan,
    Sweep,
    SweepRequest,
    Trajectory,
    Twist2D,
)
from navloom.messages import Reference as ReferenceMessage
from navloom.roles import (
    AvoiderInput,
    Context,
    ControllerInput,
    Disturbance,
    LocalizerInput,
    MapperInput,
    PlannerInput,
    PlatformInput,
    RecoveryInput,
    RobotSpec,
    Role,
    SensorSpec,
)
from navloom.roles.extra import NO_EXTRAS, Extra, Extras
from navloom.roles.readings import NO_READINGS, Readings

from navloom_check import messages
from navloom_check.messages import Place, estimate, map_update, ns, pose
from navloom_check.scenes import RESOLUTION

__all__ = ["avoider_input", "context", "controller_input", "extras", "localizer_input", "make", "mapper_input",
           "planner_input", "platform_input", "recovery_input", "robot"]  # fmt: skip

R = TypeVar("R", bound=Role)
AHEAD = (3.0, 0.0)
"""Default place of targets and goals, m."""


def robot(length: float = 0.5, width: float = 0.4, **changes: Any) -> RobotSpec:
    """A robot that drives at most 0.5 m/s and turns at most 1 rad/s; `changes` are other attributes of RobotSpec."""
    spec = {
        "footprint": rectangle(length, width), "height": 0.6, "wheel_radius": 0.05, "half_track": 0.2,
        "max_linear": 0.5, "max_angular": 1.0, "max_acceleration": 0.5, "max_deceleration": 1.0,
    }  # fmt: skip
    return RobotSpec(**{**spec, **changes})


def context(
    robot: RobotSpec | None = None,
    *,
    role: str = "",
    seed: int = 0,
    start: Place = (0.0, 0.0),
    period: float = RunTable().period,
    instance: str = "main",
    sensors: Sequence[SensorSpec] = (),
    world: World | None = None,
    map: OccupancyGrid | None = None,
    diagnostics_rate_hz: float = math.inf,
    disturbances: Sequence[Disturbance] = (),
) -> Context:
    """The context that the framework gives to a plugin; its random streams come from the seed."""
    spec = _robot() if robot is None else robot
    stream = stream_source(seed, role, instance)
    return Context(
        instance, period, spec, stream, pose(start), tuple(sensors), world, map, diagnostics_rate_hz,
        disturbances=tuple(disturbances),
    )  # fmt: skip


# `context` has an argument named robot, which hides the function.
_robot = robot


def make(plugin: type[R], within: Context | None = None, /, **params: Any) -> R:
    """An instance of a plugin with checked parameters. Its context is `context()` of its role unless one is given."""
    return plugin(plugin.Params(**params), context(role=plugin.role) if within is None else within)


def extras(**given: tuple[Extra[Any], Message | None]) -> Extras:
    """Extra inputs by any name: `extras(tracks=(MyAvoider.tracks, message))`."""
    return Extras(dict(given.values())) if given else NO_EXTRAS


def platform_input(
    command: tuple[float, float] = (0.0, 0.0),
    time: float = 0.0,
    sweep_request: int | None = None,
    world: World | None = None,
) -> PlatformInput:
    """A command (m/s, rad/s) to drive with until a time, s, the number of a requested sweep, and what moves in a world.

    The platform's context holds what stands in that world.
    """
    request = None if sweep_request is None else SweepRequest(sweep_request)
    bodies = MovingWorld(world, (), math.inf).advance(ns(time), ()) if world is not None and moves(world) else None
    return PlatformInput(Twist2D(command[0], 0.0, command[1]), request, ns(time), bodies)


def localizer_input(
    *scans: RangeScan,
    odometry: Place = (0.0, 0.0),
    moving: tuple[float, float] = (0.0, 0.0),
    map: MapUpdate | None = None,
    stamp: float = 0.0,
    readings: Readings = NO_READINGS,
    extra: Extras = NO_EXTRAS,
) -> LocalizerInput:
    """Odometry as a pose in its own frame, scans, and a mapper's map."""
    return LocalizerInput(
        Odometry(ns(stamp), pose(odometry), Twist2D(moving[0], 0.0, moving[1])), scans, map, _names(scans), readings,
        extra,
    )  # fmt: skip


def mapper_input(
    *data: RangeScan | Sweep,
    track: PoseTrack | None = None,
    clear: bool = False,
    stamp: float | None = None,
    readings: Readings = NO_READINGS,
    extra: Extras = NO_EXTRAS,
) -> MapperInput:
    """Scans and sweeps of a robot on a track, by default at the origin. The stamp is by default that of the newest."""
    scans = tuple(one for one in data if isinstance(one, RangeScan))
    sweeps = tuple(one for one in data if isinstance(one, Sweep))
    # A mapper's step never begins before the data that it is given.
    newest = max((one.stamp_ns for one in data), default=0)
    return MapperInput(
        newest if stamp is None else ns(stamp), sweeps, scans, messages.track() if track is None else track, clear,
        _names(scans), _names(sweeps), readings, extra,
    )  # fmt: skip


def planner_input(
    world: World | OccupancyGrid | MapUpdate,
    start: Place = (0.0, 0.0),
    goal: Place = AHEAD,
    *,
    request_id: int = 1,
    resolution: float = RESOLUTION,
    extra: Extras = NO_EXTRAS,
) -> PlannerInput:
    """A request, and the map of a world."""
    known = world if isinstance(world, MapUpdate) else map_update(world, resolution)
    return PlannerInput(PlanRequest(request_id, pose(start), pose(goal)), known, extra)


def controller_input(
    at: Place = (0.0, 0.0),
    moving: tuple[float, float] = (0.0, 0.0),
    *,
    trajectory: Trajectory | None = None,
    progress: float = 0.0,
    look_ahead: float = 1.0,
    corridor: float = 0.4,
    turn_to: float | None = None,
    stamp: float = 0.0,
    extra: Extras = NO_EXTRAS,
) -> ControllerInput:
    """A robot at a pose with a velocity (m/s, rad/s), and its reference on a trajectory; default: 5 m along x.

    Args:
        at, moving: Pose and velocity of the robot.
        trajectory: The trajectory to follow.
        progress: Arc length reached in the previous tick, m; the reference is searched near it.
        look_ahead: Distance from the reference point to the target, m.
        corridor: Half width of the strip to the target that must be free, m.
        turn_to: Heading to turn to at the end, rad.
        stamp: Run clock, s.
        extra: The plugin's own extra inputs.
    """
    # Here, since it takes numba, which takes longer to import than everything else: not every plugin needs it.
    from navloom.navigation.trajectory_projection import project, way_ahead

    followed = messages.trajectory() if trajectory is None else trajectory
    samples, base = followed.samples, pose(at)
    on = project(samples, base.x, base.y, base.heading, progress, look_ahead)
    reference = ReferenceMessage(
        followed.path_id, on.progress, float(samples[-1, 0]) - on.progress, Pose2D(on.x, on.y, on.heading), on.speed,
        on.turn_rate, on.cross_track, Point2D(on.target_x, on.target_y), way_ahead(samples, on.progress, look_ahead),
        corridor, turn_to,
    )  # fmt: skip
    return ControllerInput(ns(stamp), followed, reference, estimate(at, moving, stamp), extra)


def avoider_input(
    *scans: RangeScan,
    at: Place = (0.0, 0.0),
    moving: tuple[float, float] = (0.0, 0.0),
    target: Place = AHEAD,
    desired: tuple[float, float] = (0.3, 0.0),
    corridor: float = 0.4,
    remaining: float = 0.0,
    share: float = 1.0,
    stamp: float = 0.0,
    readings: Readings = NO_READINGS,
    extra: Extras = NO_EXTRAS,
) -> AvoiderInput:
    """Scans of a robot at a pose with a velocity (m/s, rad/s), a target in the map, and the controller's command."""
    return AvoiderInput(
        ns(stamp), scans, estimate(at, moving, stamp), Point2D(target[0], target[1]), corridor,
        Twist2D(desired[0], 0.0, desired[1]), remaining, share, _names(scans), readings, extra,
    )  # fmt: skip


def recovery_input(
    *scans: RangeScan,
    at: Place = (0.0, 0.0),
    moving: tuple[float, float] = (0.0, 0.0),
    attempt: int = 1,
    reason: str = "trapped",
    starts: bool = True,
    trail: Sequence[Place] = (),
    stamp: float = 0.0,
    readings: Readings = NO_READINGS,
    extra: Extras = NO_EXTRAS,
) -> RecoveryInput:
    """Scans of a stuck robot, and the poses of its track, oldest first."""
    rows = np.array([(one.x, one.y, one.heading) for one in map(pose, trail)], dtype=np.float64).reshape(-1, 3)
    # As the framework gives it: a plugin that writes into its inputs fails in its unit test already.
    rows.flags.writeable = False
    return RecoveryInput(
        ns(stamp), scans, estimate(at, moving, stamp), attempt, reason, starts, rows, _names(scans), readings, extra
    )


def _names(data: Sequence[Message]) -> tuple[str, ...]:
    """A sensor name for each message: `sensor0`, `sensor1`, …"""
    return tuple(f"sensor{k}" for k in range(len(data)))


def readings_of(given: Mapping[str, Sequence[Message]]) -> Readings:
    """Readings of sensors of other kinds, by the sensor's name."""
    return {name: tuple(messages) for name, messages in given.items()} if given else NO_READINGS

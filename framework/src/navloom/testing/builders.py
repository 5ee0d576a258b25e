"""Builders with defaults: a plugin, and what its verb is given, in a line each.

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
from numpy.typing import ArrayLike, NDArray

from navloom.engine.random_streams import stream_source
from navloom.geometry.footprints import rectangle
from navloom.geometry.frames import transform
from navloom.geometry.world import World
from navloom.messages import (
    AvoiderDiagnostics,
    MapUpdate,
    Message,
    OccupancyGrid,
    Odometry,
    PlanRequest,
    Point2D,
    Pose2D,
    PoseEstimate,
    PoseTrack,
    RangeScan,
    Sweep,
    SweepRequest,
    Trajectory,
    Twist2D,
)
from navloom.messages import Reference as ReferenceMessage
from navloom.navigation.projection import project, way_ahead
from navloom.roles import (
    AvoiderInput,
    Context,
    ControllerInput,
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
from navloom.testing.scenes import cast, grid

__all__ = ["avoider_input", "context", "controller_input", "empty_diagnostics", "estimate", "extras", "localizer_input",
           "make", "map_update", "mapper_input", "planner_input", "platform_input", "pose", "recovery_input", "robot",
           "scan", "sweep", "track", "trajectory"]  # fmt: skip

Floats = NDArray[np.float64]
Place = Sequence[float]
"""x, y, m, and, where it is a pose, heading, rad."""
R = TypeVar("R", bound=Role)
AHEAD = (3.0, 0.0)
"""Where targets and goals are unless a test says otherwise, m."""


def ns(seconds: float) -> int:
    """Seconds as a stamp."""
    return round(seconds * 1e9)


def pose(place: Place = (0.0, 0.0)) -> Pose2D:
    """A pose of (x, y) or (x, y, heading); the heading is wrapped."""
    x, y, heading = (*place, 0.0)[:3]
    return Pose2D(x, y, math.remainder(heading, math.tau))


def robot(length: float = 0.5, width: float = 0.4, **changes: Any) -> RobotSpec:
    """A robot of 0.5 x 0.4 m that drives 0.5 m/s and turns 1 rad/s; other attributes of RobotSpec by name."""
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
    period: float = 0.05,
    instance: str = "main",
    sensors: Sequence[SensorSpec] = (),
    world: World | None = None,
    map: OccupancyGrid | None = None,
    diagnostics_rate_hz: float = math.inf,
) -> Context:
    """What the framework hands to a plugin; its random streams come from the seed."""
    spec = _robot() if robot is None else robot
    stream = stream_source(seed, role, instance)
    return Context(instance, period, spec, stream, pose(start), tuple(sensors), world, map, diagnostics_rate_hz)


_robot = robot


def make(plugin: type[R], within: Context | None = None, /, **params: Any) -> R:
    """A plugin of checked parameters. The context is that of `context()`, of the plugin's role, unless it is given."""
    return plugin(plugin.Params(**params), context(role=plugin.role) if within is None else within)


def scan(
    seen: World | ArrayLike = math.inf,
    at: Place = (0.0, 0.0),
    *,
    beams: int = 181,
    field_of_view: float = math.radians(270.0),
    half_angle: float = 0.0,
    mount: Place = (0.0, 0.0, 0.0),
    height: float = 0.3,
    range_min: float = 0.05,
    range_max: float = 10.0,
    stamp: float = 0.0,
) -> RangeScan:
    """A planar scan.

    Args:
        seen: A world, seen from `at`; or ranges, m, of which a single number holds for each beam.
        at: Pose of base in the map.
        beams: How many; of ranges in a list, as many as there are.
        field_of_view: From the first beam to the last, rad, the middle straight ahead.
        half_angle: Half the opening of a beam, rad; 0 for a laser.
        mount: Pose of the sensor in the base frame.
        height: Of the scan plane, m.
        range_min, range_max: m. What is farther away gives no echo.
        stamp: Run clock, s.
    """
    given = None if isinstance(seen, World) else np.asarray(seen, dtype=np.float64)
    count = beams if given is None or given.ndim == 0 else len(given)
    placed = pose(mount)
    bearings = placed.heading + (np.linspace(-0.5, 0.5, count) * field_of_view if count > 1 else np.zeros(count))
    if isinstance(seen, World):
        base = pose(at)
        base_to_map = np.array([base.x, base.y, base.heading])
        origin = np.full((count, 3), height)
        origin[:, :2] = transform(base_to_map, np.array([placed.x, placed.y]))
        angles = bearings + base.heading
        ranges = cast(seen, origin, np.column_stack((np.cos(angles), np.sin(angles), np.zeros(count))))
        ranges = np.where(ranges > range_max, math.inf, np.maximum(ranges, range_min))
    else:
        assert given is not None
        ranges = np.full(count, given) if given.ndim == 0 else given
    return RangeScan(
        ns(stamp), np.full((count, 2), (placed.x, placed.y)), bearings, np.full(count, half_angle), np.zeros(count),
        ranges, range_min, range_max,
    )  # fmt: skip


def sweep(
    seen: World | ArrayLike = math.inf,
    at: Place = (0.0, 0.0),
    *,
    frames: int = 40,
    beams: int = 61,
    field_of_view: float = math.radians(100.0),
    pitches: tuple[float, float] = (math.radians(-25.0), math.radians(15.0)),
    height: float = 0.4,
    duration: float = 1.25,
    request_id: int = 1,
    range_min: float = 0.1,
    range_max: float = 30.0,
    stamp: float = 0.0,
) -> Sweep:
    """One movement of a planar laser that is pitched as a whole; of a robot that does not move.

    Args:
        seen: A world, seen from `at`; or ranges, m, (frames, beams) or one number for all.
        at: Pose of base in the map.
        frames, beams: How many.
        field_of_view: From the first beam to the last, rad.
        pitches: Of the first and the last frame, rad, up positive.
        height: Of the sensor above the floor, m.
        duration: Of the sweep, s.
        request_id: The request it answers; 0 for a continuous sweep.
        range_min, range_max: m.
        stamp: Run clock at which it begins, s.
    """
    if not isinstance(seen, World):
        given = np.asarray(seen, dtype=np.float64)
        frames, beams = given.shape if given.ndim == 2 else (frames, beams)
    bearings = np.linspace(-0.5, 0.5, beams) * field_of_view if beams > 1 else np.zeros(beams)
    tilts = np.linspace(*pitches, frames)
    if isinstance(seen, World):
        base = pose(at)
        ahead, left = np.cos(bearings)[None, :], np.broadcast_to(np.sin(bearings), (frames, beams))
        in_base = np.stack((ahead * np.cos(tilts)[:, None], left, ahead * np.sin(tilts)[:, None]), axis=2).reshape(
            -1, 3
        )
        ways = in_base.copy()
        ways[:, :2] = transform(np.array([0.0, 0.0, base.heading]), in_base[:, :2])
        ranges = cast(seen, np.full((len(ways), 3), (base.x, base.y, height)), ways, floor=True)
        ranges = np.where(ranges > range_max, math.inf, np.maximum(ranges, range_min)).reshape(frames, beams)
    else:
        ranges = np.full((frames, beams), given) if given.ndim == 0 else given
    times = np.linspace(0.0, duration, frames)
    return Sweep(ns(stamp), request_id, ranges, tilts, times, bearings, "rigid_pitch", 0.0, 0.0, height, range_min,
                 range_max)  # fmt: skip


def estimate(at: Place = (0.0, 0.0), moving: tuple[float, float] = (0.0, 0.0), stamp: float = 0.0) -> PoseEstimate:
    """A pose in the map, and the velocity (m/s, rad/s)."""
    return PoseEstimate(ns(stamp), pose(at), Twist2D(moving[0], 0.0, moving[1]), np.diag((1e-4, 1e-4, 1e-4)))


def track(poses: Sequence[Place] = ((0.0, 0.0, 0.0),), stamps: Sequence[float] | None = None) -> PoseTrack:
    """Poses over time; default: all at one place, from 1 s before 0 to 10 s after it."""
    if stamps is None:
        stamps = (-1.0, 10.0) if len(poses) == 1 else [0.05 * k for k in range(len(poses))]
    if len(poses) == 1:
        poses = [poses[0]] * len(stamps)
    rows = np.array([(one.x, one.y, one.heading) for one in map(pose, poses)], dtype=np.float64).reshape(-1, 3)
    return PoseTrack(np.array([ns(stamp) for stamp in stamps], dtype=np.int64), rows)


def map_update(world: World | OccupancyGrid, resolution: float = 0.05, stamp: float = 0.0) -> MapUpdate:
    """A mapper's map of a world, or of a raster as it is; without segments."""
    cells = world if isinstance(world, OccupancyGrid) else grid(world, resolution)
    return MapUpdate(ns(stamp), cells, np.empty((0, 4)), ())


def trajectory(length: float = 5.0, curvature: float = 0.0, speed: float = 0.3, path_id: int = 1) -> Trajectory:
    """What is followed, from the origin along the x axis: a line, or an arc of a curvature, 1/m, to the left."""
    s = np.linspace(0.0, length, max(2, round(length / 0.02) + 1))
    heading = np.remainder(curvature * s + math.pi, math.tau) - math.pi
    if curvature == 0.0:
        x, y = s, np.zeros_like(s)
    else:
        x, y = np.sin(curvature * s) / curvature, (1.0 - np.cos(curvature * s)) / curvature
    return Trajectory(path_id, np.column_stack((s, x, y, heading, np.full_like(s, curvature), np.full_like(s, speed))))


def empty_diagnostics(why: str = "") -> AvoiderDiagnostics:
    """Diagnostics of an avoider that has nothing to show, with one phrase for people."""
    return AvoiderDiagnostics(np.zeros((0, 0), np.uint8), 0.0, 0.0, 0.0, np.zeros(0), 0.0, np.zeros((0, 2)), None, why)


def extras(**given: tuple[Extra[Any], Message | None]) -> Extras:
    """Extra inputs by any name: `extras(tracks=(MyAvoider.tracks, message))`."""
    return Extras(dict(given.values())) if given else NO_EXTRAS


def platform_input(
    command: tuple[float, float] = (0.0, 0.0), time: float = 0.0, sweep_request: int | None = None
) -> PlatformInput:
    """A velocity (m/s, rad/s) to drive with until a time, s; and the number of a sweep to make."""
    request = None if sweep_request is None else SweepRequest(sweep_request)
    return PlatformInput(Twist2D(command[0], 0.0, command[1]), request, ns(time))


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
    """Scans and sweeps, taken where the track says; default: at the origin. The stamp is that of the newest data."""
    scans = tuple(one for one in data if isinstance(one, RangeScan))
    sweeps = tuple(one for one in data if isinstance(one, Sweep))
    newest = max((one.stamp_ns for one in data), default=0)
    return MapperInput(
        newest if stamp is None else ns(stamp), sweeps, scans, _track() if track is None else track, clear,
        _names(scans), _names(sweeps), readings, extra,
    )  # fmt: skip


_track = track


def planner_input(
    world: World | OccupancyGrid | MapUpdate,
    start: Place = (0.0, 0.0),
    goal: Place = AHEAD,
    *,
    request_id: int = 1,
    resolution: float = 0.05,
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
        at, moving: The robot.
        trajectory: What is followed.
        progress: Of the tick before, m of arc length: the reference is looked for near it.
        look_ahead: From the reference point to the target, m.
        corridor: Half width of the strip to the target that must be free, m.
        turn_to: Heading to turn to at the end, rad.
        stamp: Run clock, s.
        extra: The plugin's own extra inputs.
    """
    followed = _trajectory() if trajectory is None else trajectory
    samples, base = followed.samples, pose(at)
    on = project(samples, base.x, base.y, base.heading, progress, look_ahead)
    reference = ReferenceMessage(
        followed.path_id, on.progress, float(samples[-1, 0]) - on.progress, Pose2D(on.x, on.y, on.heading), on.speed,
        on.turn_rate, on.cross_track, Point2D(on.target_x, on.target_y), way_ahead(samples, on.progress, look_ahead),
        corridor, turn_to,
    )  # fmt: skip
    return ControllerInput(ns(stamp), followed, reference, estimate(at, moving, stamp), extra)


_trajectory = trajectory


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
    """Scans of a robot at a pose with a velocity (m/s, rad/s), a target in the map, and what the controller wants."""
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
    """Scans of a robot that is stuck, and the poses it came by, oldest first."""
    rows = np.array([(one.x, one.y, one.heading) for one in map(pose, trail)], dtype=np.float64).reshape(-1, 3)
    rows.flags.writeable = False
    return RecoveryInput(
        ns(stamp), scans, estimate(at, moving, stamp), attempt, reason, starts, rows, _names(scans), readings, extra
    )


def _names(data: Sequence[Message]) -> tuple[str, ...]:
    """A sensor's name for each message: `sensor0`, `sensor1`, …"""
    return tuple(f"sensor{k}" for k in range(len(data)))


def readings_of(given: Mapping[str, Sequence[Message]]) -> Readings:
    """Readings of sensors of other kinds, by the sensor's name."""
    return {name: tuple(messages) for name, messages in given.items()} if given else NO_READINGS

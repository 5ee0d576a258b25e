"""Whether the reports of a simulated platform agree with its world and with its own truth."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from navloom.geometry.echoes import poses_at
from navloom.geometry.frames import transform
from navloom.geometry.moving_world import standing
from navloom.geometry.world import Box, World
from navloom.messages import Pose2D, PoseTrack, RangeScan, Sweep
from navloom.roles import Context, Disturbance, Platform, PlatformOutput, SensorSpec
from numpy.typing import NDArray
from pydantic import ValidationError

from navloom_check import builders, scenes
from navloom_check.check_bench import Bench, alike
from navloom_check.check_scenes import PERIOD
from navloom_check.checks import check
from navloom_check.contract.parameter_bounds import values_of
from navloom_check.findings import Finding, NotRun
from navloom_check.messages import ns
from navloom_check.plugin_player import Fault, Player

__all__ = ["CHECKS", "START", "context_of", "expected_ranges", "has_defaults", "made_world", "outputs_of", "track_of"]

Floats = NDArray[np.float64]

START = (0.3, -0.2, 0.4)
"""Pose of the robot, m, m, rad: neither at the origin nor along an axis."""
LOOKS, TURNS, PUSHES, BACKS = 60, 50, 80, 40
"""Steps for which the robot is stopped, turns in place, drives against a wall, and backs up from it."""
STILL = (0.0, 0.0)
TURN = 0.7
"""Turn rate of the robot that turns, rad/s."""
AT = 0.3
"""Height of the rays that echoes are compared with, m; the girder is higher, and everything else is taller."""
NEAR, SHARE = 0.15, 0.05
"""Greatest error of an echo: a distance, m, plus a share of its range."""
RIGHT = 0.8
"""Share of the echoes that must be right."""
RAYS = 9
"""Rays that are cast across the width of a beam."""
AWAY = (0.3, -0.2, -2.4)
"""Pose of a robot with all walls behind it, m, m, rad."""
CLEAR = 1.2
"""A beam meets nothing if the next object is farther than this many times its range plus 0.5 m."""
FEWEST = 5
"""Fewest beams of a sensor that are judged."""
HEARD = 0.2
"""Greatest share of the beams that meet nothing and have an echo: sensors have false ones."""
PUT, SLIP = (2.8, 0.2, -1.0), 0.5
"""Place to which a robot is displaced, m, m, rad, and the way that its wheels report without driving, m."""
CLOSE = 0.01
"""Greatest error of these, m and rad."""
APART = 3
"""Steps for which contact and truth may differ: a bumper has a delay."""


def made_world() -> World:
    """Walls to the left and ahead, a box to the right, a girder above the robot, and nothing behind it."""
    walls = (
        Box("left wall", (-1.0, 4.2), (1.4, 1.6), (0.0, 2.4)), Box("front wall", (4.0, 4.2), (-3.0, 1.6), (0.0, 2.4)),
        Box("box", (1.0, 1.6), (-1.6, -0.9), (0.0, 2.4)), Box("girder", (2.0, 2.2), (-1.0, 1.0), (1.5, 2.4)),
    )  # fmt: skip
    return World("a wall to the left", walls, bounds=(-5.0, -5.0, 5.0, 5.0))


def context_of(
    bench: Bench,
    sensors: tuple[SensorSpec, ...],
    start: tuple[float, float, float] = START,
    world: World | None = None,
) -> Context:
    """Context of the platform in a world, by default `made_world()`. Raises NotRun if it does not simulate it."""
    cls: type[Platform] = bench.subject.thing
    if not cls.is_simulated or cls.own_world(bench.subject.params) is not None:
        raise NotRun("it does not simulate the world that it is given")
    bench.sound()
    stands = standing(world or made_world())
    return builders.context(role="platform", start=start, period=PERIOD, sensors=sensors, world=stands)


def outputs_of(
    bench: Bench,
    context: Context,
    twist: tuple[float, float],
    steps: int,
    seed: int = 0,
    back: int = 0,
    world: World | None = None,
) -> list[PlatformOutput]:
    """Outputs of the platform while it is commanded a speed, m/s, and a turn rate, rad/s, in the run of a seed.

    In `back` further steps, it is commanded the opposite. What moves in a world is told to it in each step.
    """
    commands = [(0.0, 0.0), *[twist] * (steps - 1), *[(-twist[0], -twist[1])] * back]
    with alike():
        player = Player(bench.subject, context, bench.seed + seed)
        return [
            player.step(builders.platform_input(command, k * PERIOD, 1 if k == 3 else None, world))
            for k, command in enumerate(commands)
        ]


@check("contract", {"platform"}, "Echoes of range sensors lie on objects of the world.")
def echoes(bench: Bench) -> Iterator[Finding]:
    """For a stopped simulated robot. Wrong bearings, frames and units, and echoes of nothing, show here."""
    cls: type[Platform] = bench.subject.thing
    kinds = [kind for kind, message in cls.sensor_kinds.items() if issubclass(message, RangeScan | Sweep)]
    specs = tuple(SensorSpec(kind, kind) for kind in kinds if has_defaults(cls, kind))
    if not specs:
        raise NotRun("it has no range sensor that works without settings")
    context = context_of(bench, specs)
    for twist, steps, does in ((STILL, LOOKS, "stands"), ((0.0, TURN), TURNS, "turns")):
        right: dict[str, list[bool]] = {}
        outputs = outputs_of(bench, context, twist, steps)
        track = track_of(context, outputs)
        for out in outputs:
            for name, seen in out.scans.items():
                if isinstance(seen, RangeScan):
                    right.setdefault(name, []).extend(_right(seen, track, made_world()))
                elif isinstance(seen, Sweep) and twist == STILL:
                    right.setdefault(name, []).extend(_right_in_sweep(seen, track, made_world()))
        for name, found in right.items():
            if found and sum(found) < RIGHT * len(found):
                yield Finding(
                    f"gives echoes of the sensor {name!r} of which {1.0 - np.mean(found):.0%} lie where nothing is",
                    "origins and bearings in the base frame, rad, counter-clockwise, ranges in m, +inf for no echo, "
                    "and as stamp the time at which they were taken",
                    given=f"a robot that {does} at {START[:2]} m heading {START[2]} rad, walls to the left and ahead, "
                    "and a box",
                )  # fmt: skip
                return
        if any(out.truth is None for out in outputs):
            return  # without truth, the pose of a turning robot is unknown


def track_of(context: Context, outputs: list[PlatformOutput]) -> PoseTrack:
    """Where the robot was, by its truth; where there is none, at its start."""
    poses = [context.start if out.truth is None else out.truth.pose for out in outputs]
    stamps = np.array([out.odometry.stamp_ns for out in outputs])
    return PoseTrack(stamps, np.array([(pose.x, pose.y, pose.heading) for pose in poses]))


def has_defaults(cls: type[Platform], kind: str) -> bool:
    model = cls.sensor_settings.get(kind)
    return model is None or not any(field.is_required() for field in model.model_fields.values())


def _right(scan: RangeScan, track: PoseTrack, world: World) -> list[bool]:
    """Whether an object of the world is where each echo lies, seen from where the robot was at the beam's time."""
    ranges = scan.ranges[np.isfinite(scan.ranges)]
    off = np.abs(ranges - expected_ranges(scan, track, world))
    found: list[bool] = (off <= NEAR + SHARE * ranges).tolist()
    return found


def _right_in_sweep(sweep: Sweep, track: PoseTrack, world: World) -> list[bool]:
    """As `_right`, for the sweep of a robot that is stopped; the floor counts."""
    ranges = sweep.ranges.ravel()
    heard = np.isfinite(ranges)
    off = np.abs(ranges[heard] - _to_nearest(sweep, Pose2D(*track.poses[-1].tolist()), world)[heard])
    found: list[bool] = (off <= NEAR + SHARE * ranges[heard]).tolist()
    return found


def expected_ranges(
    scan: RangeScan,
    track: PoseTrack,
    world: World,
    *,
    later_ns: int = 0,
    turned: float = 0.0,
    moved: tuple[float, float] = (0.0, 0.0),
    rays: int = RAYS,
) -> Floats:
    """What each beam that has an echo should read, m: the nearest of the rays across its width.

    Args:
        scan: The scan.
        track: Where the robot was.
        world: The obstacles around it.
        later_ns, turned, moved: Changes of the scan that are tried: of its stamp, ns; of all bearings, rad; and of all
            origins, m, base frame.
        rays: Rays that are cast for each beam.
    """
    heard = np.isfinite(scan.ranges)
    poses = poses_at(track, scan.stamp_ns + later_ns + 1e9 * scan.time_offsets[heard])
    count = int(heard.sum())
    spread = np.linspace(-1.0, 1.0, rays)[None, :] * scan.half_angles[heard][:, None] if rays > 1 else 0.0
    ways = (scan.bearings[heard][:, None] + turned + spread + poses[:, 2:]).ravel()
    places = np.repeat(transform(poses, (scan.origins[heard] + moved)[:, None])[:, 0], rays, axis=0)
    level = np.zeros(count * rays)
    lengths = scenes.cast(
        world, np.column_stack([places, level + AT]), np.column_stack([np.cos(ways), np.sin(ways), level])
    )
    found: Floats = np.clip(lengths.reshape(count, rays).min(axis=1), scan.range_min, None)
    return found


@check("contract", {"platform"}, "A beam that meets nothing within its range gives +inf.")
def no_echo(bench: Bench) -> Iterator[Finding]:
    """For a simulated robot with all walls behind it."""
    cls: type[Platform] = bench.subject.thing
    specs = tuple(SensorSpec(kind, kind) for kind in cls.sensor_kinds if has_defaults(cls, kind))
    context = context_of(bench, specs, AWAY)
    free: dict[str, list[Floats]] = {}
    for out in outputs_of(bench, context, STILL, LOOKS):
        pose = context.start if out.truth is None else out.truth.pose
        for name, seen in out.scans.items():
            if isinstance(seen, RangeScan | Sweep):
                free.setdefault(name, []).append(_of_free_beams(seen, pose, made_world()) / seen.range_max)
    for name, found in free.items():
        shares = np.concatenate(found)
        heard = shares[np.isfinite(shares)]
        if len(shares) >= FEWEST and len(heard) > HEARD * len(shares):
            yield Finding(
                f"gives echoes for {len(heard) / len(shares):.0%} of the beams of the sensor {name!r} that meet "
                f"nothing, at {np.median(heard):.2f} times its range_max", "+inf, which means no echo; range_max would "
                "be an obstacle there", given=f"a robot at {AWAY[:2]} m heading {AWAY[2]} rad, with walls behind it",
            )  # fmt: skip
            return


def _of_free_beams(seen: RangeScan | Sweep, pose: Pose2D, world: World) -> Floats:
    """(n,) ranges of the beams that meet nothing in their range and well beyond it, m."""
    free: Floats = seen.ranges.ravel()[_to_nearest(seen, pose, world) > CLEAR * seen.range_max + 0.5]
    return free


def _to_nearest(seen: RangeScan | Sweep, pose: Pose2D, world: World) -> Floats:
    """(n,) distance from the start of each beam to the nearest thing in its width, or the floor, m."""
    places, ways = _beams(seen)
    cos, sin = np.cos(pose.heading), np.sin(pose.heading)
    turn = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    lengths = scenes.cast(
        world, (places @ turn + (pose.x, pose.y, 0.0)).reshape(-1, 3), (ways @ turn).reshape(-1, 3), floor=True
    )
    nearest: Floats = lengths.reshape(len(ways), -1).min(axis=1)
    return nearest


def _beams(seen: RangeScan | Sweep) -> tuple[Floats, Floats]:
    """Starts (n, k, 3), m, and directions (n, k, 3) of the rays of each beam, base frame."""
    if isinstance(seen, RangeScan):
        turns = seen.bearings[:, None] + np.linspace(-1.0, 1.0, RAYS) * seen.half_angles[:, None]
        places = np.column_stack([seen.origins, np.full(len(seen.origins), AT)])
        ways = np.stack([np.cos(turns), np.sin(turns), np.zeros_like(turns)], axis=-1)
        return np.broadcast_to(places[:, None, :], ways.shape), ways
    up, left = np.meshgrid(seen.pitches, seen.bearings, indexing="ij")
    if seen.geometry == "paper":
        axes = (np.cos(up) * np.cos(left), np.cos(up) * np.sin(left), np.sin(up))
    else:
        axes = (np.cos(left) * np.cos(up), np.sin(left), np.cos(left) * np.sin(up))
    ways = np.stack(axes, axis=-1).reshape(-1, 1, 3)
    return np.broadcast_to((seen.x, seen.y, seen.z), ways.shape), ways


@check("contract", {"platform"}, "The noise of its sensors differs between runs with different seeds.")
def own_noise(bench: Bench) -> Iterator[Finding]:
    """For a stopped simulated robot. With the same noise in each run, the episodes of a study would be equal."""
    cls: type[Platform] = bench.subject.thing
    specs = tuple(SensorSpec(kind, kind) for kind in cls.sensor_kinds if has_defaults(cls, kind))
    context = context_of(bench, specs)
    one, other = (_ranges_of(outputs_of(bench, context, STILL, LOOKS, seed)) for seed in (0, 1))
    for name, ranges in one.items():
        is_noisy = any(not np.array_equal(ranges[0], later) for later in ranges[1:])
        if is_noisy and all(np.array_equal(*both) for both in zip(ranges, other.get(name, []), strict=False)):
            yield Finding(
                f"gives the same noise of the sensor {name!r} in runs of two seeds", "random numbers from "
                "context.stream(name)", given=f"a stopped robot at {START[:2]} m",
            )  # fmt: skip
            return


def _ranges_of(outputs: list[PlatformOutput]) -> dict[str, list[Floats]]:
    """Ranges of all readings of each range sensor, m."""
    found: dict[str, list[Floats]] = {}
    for out in outputs:
        for name, seen in out.scans.items():
            if isinstance(seen, RangeScan | Sweep):
                found.setdefault(name, []).append(seen.ranges)
    return found


@check("contract", {"platform"}, "Contact and truth agree on whether the robot touches something.")
def contact(bench: Bench) -> Iterator[Finding]:
    """For a simulated robot that drives against a wall and backs up."""
    apart = 0
    outputs = outputs_of(bench, context_of(bench, (), (3.0, 0.0, 0.0)), (0.3, 0.0), PUSHES, back=BACKS)
    for step, out in enumerate(outputs):
        if out.truth is None:
            raise NotRun("it gives no truth")
        is_apart = out.contact.touching != out.truth.touching
        apart = apart + 1 if is_apart else 0
        if apart > APART:
            yield Finding(
                f"gives contact.touching = {out.contact.touching}, and truth.touching = {out.truth.touching}",
                "the same in both", given=f"a robot that drives against a wall, step {step}",
            )  # fmt: skip
            return
        if out.truth.touching and out.truth.clearance > NEAR:
            yield Finding(
                f"gives truth.touching = True with a clearance of {out.truth.clearance:.2f} m",
                "a clearance of 0 in contact", given=f"a robot that drives against a wall, step {step}",
            )  # fmt: skip
            return


@check("contract", {"platform"}, "A displacement moves the true robot alone, and a slip its odometry alone.")
def disturbed(bench: Bench) -> Iterator[Finding]:
    """For a stopped robot of a simulator that `takes_disturbances`."""
    if not bench.subject.thing.takes_disturbances:
        raise NotRun("it takes no disturbances")
    context = context_of(bench, ())
    events = (Disturbance("displace", ns(PERIOD), to=PUT), Disturbance("slip", ns(2.0 * PERIOD), by=(SLIP, 0.0, 0.0)))
    before, moved, slipped = outputs_of(bench, replace(context, disturbances=events), STILL, 3)
    for what, out, driven in (("displaced", moved, 0.0), ("displaced, and slipped after that", slipped, SLIP)):
        if out.truth is None:
            raise NotRun("it gives no truth")
        at, said = out.truth.pose, _way(before.odometry.pose, out.odometry.pose)
        given = f"a stopped robot, {what}"
        if max(abs(at.x - PUT[0]), abs(at.y - PUT[1]), abs(at.heading - PUT[2])) > CLOSE:
            found = f"gives truth.pose ({at.x:.2f}, {at.y:.2f}, {at.heading:.2f} rad)"
            yield Finding(found, f"{PUT}, by Context.disturbances", given=given)
            return
        if abs(said - driven) > CLOSE:
            yield Finding(f"gives odometry that moved by {said:.2f} m", f"{driven:g} m", given=given)
            return


def _way(begin: Pose2D, end: Pose2D) -> float:
    return math.hypot(end.x - begin.x, end.y - begin.y)


@check("contract", {"platform"}, "Every value that a sensor's settings allow works, with the others at their defaults.")
def sensor_extremes(bench: Bench) -> Iterator[Finding]:
    """As `extremes`, for the settings in the tables [[sensor]]."""
    cls: type[Platform] = bench.subject.thing
    for kind in cls.sensor_kinds:
        model = cls.sensor_settings.get(kind)
        if model is None or not has_defaults(cls, kind):
            continue
        for name, field in model.model_fields.items():
            for value in values_of(field, field.get_default(call_default_factory=True)):
                try:
                    model.model_validate({name: value})
                except ValidationError:  # the model refuses this value together with the other defaults
                    continue
                try:
                    spec = SensorSpec("sensor", kind, {name: value})
                    outputs_of(bench, context_of(bench, (spec,)), STILL, 5)
                except Fault as fault:
                    if not fault.is_refusal:
                        yield Finding(fault.problem, f"an answer, or bounds of {name} that exclude {value!r}",
                                      fault.place, f"a sensor {kind!r} with {name} = {value!r}")  # fmt: skip
                        return


CHECKS = (echoes, no_echo, own_noise, contact, disturbed, sensor_extremes)

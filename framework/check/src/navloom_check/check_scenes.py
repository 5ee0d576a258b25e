"""Scenes for checks: the inputs of each role, step by step. They depend only on the plugin's class and a seed."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from navloom.geometry.world import Box, World
from navloom.messages import Message, OccupancyGrid, RangeScan, Sweep, Trajectory
from navloom.plugins.registry import NODE
from navloom.roles import ROLES, Context, Platform, SensorSpec
from navloom.roles.extra import NO_EXTRAS, Extras, extras_of
from navloom.roles.readings import NO_READINGS, Readings

from navloom_check import builders, messages, scenes
from navloom_check.checked_plugin import Subject
from navloom_check.drive_streams import straight_way
from navloom_check.messages import Place
from navloom_check.node_player import node_inputs, sensor_kinds
from navloom_check.role_inputs import role_inputs
from navloom_check.samples import PERIOD, again, message_in_drive, odd_scans, sample, walk

__all__ = ["PERIOD", "PlayedScene", "made_scenes"]

STEPS = 40
SIGMA = 0.01
"""Standard deviation of the ranges in scenes, m."""
IMPOSSIBLE = "impossible"
SLOW = builders.robot(max_linear=0.15, max_angular=0.4)
"""A robot with lower limits than that of most scenes."""


@dataclass(frozen=True)
class PlayedScene:
    """A short episode that a plugin is played through.

    Attributes:
        name: Name, as in findings.
        topic: "usual" for inputs of every drive; else what is unusual, as "empty", "infinite" or "impossible".
        context: Context that the plugin is made with.
        inputs: One input for each call of its verb.
        world: Obstacles around the robot; None if there is nothing to draw.
        is_gentle: The scene is easy: a sound method commands hardly more than the robot can do.
    """

    name: str
    topic: str
    context: Context
    inputs: tuple[Any, ...]
    world: World | None = None
    is_gentle: bool = False


def made_scenes(subject: Subject, seed: int) -> tuple[PlayedScene, ...]:
    """The scenes of a plugin's role; a role that has none of its own is given what a drive through a room brings."""
    makers: Mapping[str, Callable[[_Maker], Iterator[PlayedScene]]] = {
        "avoider": _avoider, "controller": _controller, "planner": _planner, "mapper": _mapper,
        "localizer": _localizer, "recovery": _recovery, "platform": _platform, NODE: _node,
    }  # fmt: skip
    maker = makers.get(subject.kind, _role if subject.kind in ROLES else None)
    return tuple(maker(_Maker(subject, seed))) if maker is not None else ()


class _Maker:
    """What the scenes of one plugin have in common: noise, its sensors, its extra inputs."""

    def __init__(self, subject: Subject, seed: int) -> None:
        self.subject = subject
        self.cls = subject.thing
        self.seed = seed
        self.rng = np.random.default_rng([seed, 2013])
        self.takes_scans = any(issubclass(RangeScan, kind) for kind in self.cls.accepts)
        self.takes_sweeps = any(issubclass(Sweep, kind) for kind in self.cls.accepts)

    def context(self, start: Place = (0.0, 0.0), world: World | None = None, **given: Any) -> Context:
        """A context of the plugin's role, with a map if the plugin needs one, and with the world for a platform."""
        if self.cls.needs_map and self.subject.kind in ROLES and self.cls.facts.sees_map:
            given.setdefault("map", scenes.grid(world or scenes.room()))
        simulated = world if self.subject.kind == "platform" else None
        return builders.context(role=self.subject.kind, start=start, period=PERIOD, world=simulated, **given)

    def scan(self, world: World, at: Place, stamp: float, **given: Any) -> RangeScan:
        """A scan with noise."""
        seen = messages.scan(world, at, stamp=stamp, **given)
        noisy = seen.ranges + SIGMA * self.rng.standard_normal(len(seen.ranges))
        return RangeScan(
            seen.stamp_ns, seen.origins, seen.bearings, seen.half_angles, seen.time_offsets,
            np.clip(noisy, seen.range_min, math.inf), seen.range_min, seen.range_max,
        )  # fmt: skip

    def scans(self, world: World, at: Place, stamp: float) -> tuple[RangeScan, ...]:
        """The scan of a laser, if the plugin takes scans; else none."""
        return (self.scan(world, at, stamp),) if self.takes_scans else ()

    def readings(self, stamp: float) -> Readings:
        """Messages of the other sensors that it accepts."""
        others = [kind for kind in self.cls.accepts if kind not in (RangeScan, Sweep, Message)]
        if not others:
            return NO_READINGS
        return {kind.__name__.lower(): (sample(kind, self.rng, messages.ns(stamp)),) for kind in others}

    def extra(self, stamp: float, at: Place = (0.0, 0.0), followed: Trajectory | None = None) -> Extras:
        """Messages of its extra inputs; optional ones are missing at times.

        Args:
            stamp: Run clock, s.
            at: Pose of the robot.
            followed: The trajectory; by default a line of 5 m along the x axis.
        """
        declared, stamp_ns = extras_of(self.cls).values(), messages.ns(stamp)
        if not declared:
            return NO_EXTRAS
        samples = (followed or messages.trajectory()).samples
        return Extras({
            one: None
            if one.optional and self.rng.random() < 0.25
            else message_in_drive(one.carries, self.rng, stamp_ns, at, samples)
            for one in declared
        })  # fmt: skip

    def more(self, stamp: float, at: Place = (0.0, 0.0), target: Place | None = None) -> dict[str, Any]:
        """Readings and extra inputs, as arguments of the builders."""
        way = None if target is None else Trajectory(1, straight_way((at[0], at[1]), (target[0], target[1])))
        return {"readings": self.readings(stamp), "extra": self.extra(stamp, at, way)}


def _avoider(maker: _Maker) -> Iterator[PlayedScene]:
    ways: list[tuple[World, Place, tuple[float, float], float]] = [
        (scenes.open_floor(), (0.0, 0.0, 0.0), (4.0, 0.0), 0.0),
        (scenes.corridor(), (0.0, 0.1, 0.0), (8.0, 0.0), 0.0),
        (scenes.wall_ahead(1.5), (0.0, 0.0, 0.0), (4.0, 0.0), 0.0),
        (scenes.box(1.6, 0.1), (0.0, 0.0, 0.0), (4.0, 0.5), 0.0),
        (scenes.door(1.2, 2.0, 0.6), (0.0, 0.0, 0.2), (4.0, 1.0), 0.0),
        (scenes.closed(), (0.0, 0.0, 0.0), (3.0, 0.0), 0.0),
        (scenes.room(), (-1.0, -0.5, 0.4), (5.0, 1.0), -0.2),
        (scenes.open_floor(), (0.0, 0.0, 2.8), (4.0, 0.0), 0.5),
        (scenes.wall_ahead(2.0), (0.0, 0.0, 0.0), (0.0, 3.0), 0.0),
    ]
    for number, (world, start, target, turn) in enumerate(ways):
        speed = 0.0 if world.name == "closed" else 0.25
        name = world.name
        if number > 6:
            # After a recovery, a robot still rolls back, or its target is behind it.
            speed, name = -0.15, f"{name}, rolling back, the target {'behind' if turn else 'beside'} it"
        poses = walk(start, speed, turn)
        inputs = [
            builders.avoider_input(
                *maker.scans(world, at, k * PERIOD), at=at, moving=(speed, turn), target=target,
                desired=(0.3, 0.2 * math.sin(0.3 * k)), remaining=1.0, stamp=k * PERIOD,
                **maker.more(k * PERIOD, at, target),
            )
            for k, at in enumerate(poses)
        ]  # fmt: skip
        yield PlayedScene(name, "usual", maker.context(start), tuple(inputs), world, True)
    world = scenes.box(1.6, 0.1)
    inputs = [
        builders.avoider_input(
            *maker.scans(world, at, k * PERIOD), at=at, moving=(0.1, 0.0), target=(4.0, 0.5), desired=(0.1, 0.1),
            remaining=1.0, stamp=k * PERIOD, **maker.more(k * PERIOD, at, (4.0, 0.5)),
        )
        for k, at in enumerate(walk((0.0, 0.0), 0.1, 0.0))
    ]  # fmt: skip
    yield PlayedScene("a slow robot", "usual", maker.context(robot=SLOW), tuple(inputs), world, True)
    if not maker.takes_scans:
        return
    for name, topic, scans in odd_scans():
        inputs = [
            builders.avoider_input(*again(scans, k * PERIOD), stamp=k * PERIOD, **maker.more(k * PERIOD))
            for k in range(10)
        ]
        yield PlayedScene(name, topic, maker.context(), tuple(inputs))
    inputs = [
        builders.avoider_input(target=(0.0, 0.0), desired=(0.0, 0.0), stamp=k * PERIOD, **maker.more(k * PERIOD))
        for k in range(5)
    ]
    yield PlayedScene("the robot is at its target", "at_goal", maker.context(), tuple(inputs))


def _controller(maker: _Maker) -> Iterator[PlayedScene]:
    for name, curvature, off, heading in (
        ("a line", 0.0, 0.02, 0.03),
        ("an arc to the left", 0.5, -0.02, 0.0),
        ("an arc to the right", -0.5, 0.03, -0.03),
        ("a bend to the left", 1.0, 0.0, 0.03),
        ("a bend to the right", -1.0, 0.0, -0.03),
        ("a tight bend to the left", 2.5, 0.01, 0.0),
        ("a tight bend to the right", -2.5, -0.01, 0.0),
        ("a line, rolling back", 0.0, 0.0, 0.03),
    ):
        # Slower in bends, as the reference is: its turn rate stays within the robot's limit.
        speed = min(0.3, 0.5 / max(abs(curvature), 1.0))
        followed = messages.trajectory(curvature=curvature, speed=speed)
        driven = -0.1 if "back" in name else speed
        poses = walk((1.0 if driven < 0.0 else 0.0, off, heading), driven, driven * curvature, 60)
        inputs = tuple(_followed(maker, followed, poses, driven))
        yield PlayedScene(name, "usual", maker.context(), inputs, is_gentle=True)
    slowly = messages.trajectory(curvature=0.5, speed=0.1)
    given = tuple(_followed(maker, slowly, walk((0.0, 0.02, 0.0), 0.1, 0.05)))
    yield PlayedScene("a slow robot", "usual", maker.context(robot=SLOW), given, is_gentle=True)
    followed = messages.trajectory(length=2.0, path_id=2)
    poses = walk((0.0, -0.8, 1.2), 0.3, -0.3, 60)
    yield PlayedScene("far beside a line", "usual", maker.context(), tuple(_followed(maker, followed, poses)))
    turns = tuple(
        builders.controller_input(at, trajectory=followed, progress=2.0, turn_to=0.15, stamp=k * PERIOD,
                                  extra=maker.extra(k * PERIOD, at, followed))
        for k, at in enumerate(walk((2.0, 0.0, 0.0), 0.0, 0.1, 20))
    )  # fmt: skip
    yield PlayedScene("a small turn in place", "usual", maker.context(), turns, is_gentle=True)
    end = [(2.0, 0.0, 0.02 * k) for k in range(20)]
    inputs = tuple(
        builders.controller_input(at, trajectory=followed, progress=2.0, turn_to=1.0, stamp=k * PERIOD,
                                  extra=maker.extra(k * PERIOD, at, followed))
        for k, at in enumerate(end)
    )  # fmt: skip
    yield PlayedScene("a turn in place at the end", "at_goal", maker.context(), inputs)
    for name, beyond in (("the end of a line", 0.0), ("beyond the end of a line", 0.1)):
        inputs = tuple(
            builders.controller_input((2.0 + beyond, 0.0, 0.0), trajectory=followed, progress=2.0, stamp=k * PERIOD,
                                      extra=maker.extra(k * PERIOD, (2.0 + beyond, 0.0), followed))
            for k in range(5)
        )  # fmt: skip
        yield PlayedScene(name, "at_goal", maker.context(), inputs)


def _followed(maker: _Maker, followed: Any, poses: Sequence[Place], speed: float = 0.3) -> Iterator[Any]:
    progress = poses[0][0]
    for k, at in enumerate(poses):
        given = builders.controller_input(
            at, (speed, 0.0), trajectory=followed, progress=progress, stamp=k * PERIOD,
            extra=maker.extra(k * PERIOD, at, followed),
        )  # fmt: skip
        progress = given.reference.progress
        yield given


def _planner(maker: _Maker) -> Iterator[PlayedScene]:
    room = messages.map_update(scenes.room())
    pairs: list[tuple[Place, Place]] = [
        ((0.0, 0.0), (6.0, 1.0)), ((-1.0, 1.5, 1.0), (6.5, -1.5)), ((6.0, -1.0), (0.0, 0.0)), ((0.0, 0.0), (0.0, 0.0)),
        ((0.0, 0.0), (6.0, 1.0)),
    ]  # fmt: skip
    numbers = (1, 2, 7, 300, 2**40)
    inputs = tuple(
        builders.planner_input(room, start, goal, request_id=number, extra=maker.extra(0.0))
        for number, (start, goal) in zip(numbers, pairs, strict=True)
    )
    yield PlayedScene("a room", "usual", maker.context(), inputs, scenes.room())
    for world in (scenes.open_floor(), scenes.door(), scenes.corridor()):
        known = messages.map_update(world, 0.1)
        inputs = tuple(
            builders.planner_input(known, (0.0, 0.0), (4.0, 0.3 * k), request_id=11 - k, extra=maker.extra(0.0))
            for k in range(3)
        )
        yield PlayedScene(world.name, "usual", maker.context(), inputs, world)
    block = World("a block", (Box("block", (2.0, 5.0), (-1.5, 1.5)),), bounds=(-5.0, -5.0, 15.0, 5.0))
    for name, world, goal in (
        ("the goal is in a block", block, (3.5, 0.0)), ("walls round the start", scenes.closed(), (3.0, 0.0)),
    ):  # fmt: skip
        given = builders.planner_input(world, (0.0, 0.0), goal, request_id=5, resolution=0.1, extra=maker.extra(0.0))
        yield PlayedScene(name, IMPOSSIBLE, maker.context(), (given,), world)
    given = builders.planner_input(block, (3.5, 0.0), (0.0, 0.0), request_id=6, resolution=0.1, extra=maker.extra(0.0))
    yield PlayedScene("the start is in a block", "odd_request", maker.context(), (given,), block)
    given = builders.planner_input(
        block, (0.0, 0.0), (400.0, 0.0), request_id=8, resolution=0.1, extra=maker.extra(0.0)
    )
    yield PlayedScene("the goal is outside the map", "odd_request", maker.context(), (given,), block)
    for name, cells in (("a map of one free cell", 0), ("a map of one unknown cell", -1)):
        given = builders.planner_input(
            _one_cell(cells), (0.02, 0.02), (0.03, 0.03), request_id=9, extra=maker.extra(0.0)
        )
        yield PlayedScene(name, "odd_request", maker.context(), (given,))


def _one_cell(value: int) -> OccupancyGrid:
    return OccupancyGrid(np.full((1, 1), value, np.int8), 0.05, messages.pose())


def _mapper(maker: _Maker) -> Iterator[PlayedScene]:
    world = scenes.room()
    for name, speed in (("a walk through a room", 0.3), ("a drive back through a room", -0.3)):
        poses = walk((0.0, 0.0, 0.3), speed, 0.2, 80)
        track = messages.track(poses, [j * PERIOD for j in range(len(poses))])
        inputs = []
        for k, at in enumerate(poses[:STEPS]):  # the track is longer, since a sweep ends 1.25 s after its stamp
            stamp = k * PERIOD
            data: list[Any] = list(maker.scans(world, at, stamp)) if k % 2 == 0 else []
            if maker.takes_sweeps and k % 10 == 0:
                data.append(messages.sweep(world, at, request_id=k // 10 + 1, stamp=stamp))
            more = maker.more(stamp)
            inputs.append(builders.mapper_input(*data, track=track, clear=k == 30, stamp=stamp + 1.5, **more))
        yield PlayedScene(name, "usual", maker.context(world=world), tuple(inputs), world)
    if maker.takes_scans:
        for name, topic, scans in odd_scans():
            given = (builders.mapper_input(*again(scans, 0.1 * k), **maker.more(0.1 * k)) for k in range(4))
            yield PlayedScene(name, topic, maker.context(), tuple(given))
    if maker.takes_sweeps:
        odd = {
            ("no return in the whole sweep", "infinite"): messages.sweep(math.inf),
            ("a sweep without frames", "empty"): messages.sweep(np.empty((0, 0))),
            ("a sweep of one beam", "single_beam"): messages.sweep(np.full((1, 1), 2.0)),
            ("every beam reads 0 m", "nearest"): messages.sweep(0.0),
        }
        for (name, topic), one in odd.items():
            yield PlayedScene(name, topic, maker.context(), (builders.mapper_input(one, stamp=2.0, **maker.more(0.0)),))
    nothing = tuple(builders.mapper_input(stamp=0.05 * k, clear=k == 2, **maker.more(0.05 * k)) for k in range(5))
    yield PlayedScene("no data at all", "empty", maker.context(), nothing)


def _localizer(maker: _Maker) -> Iterator[PlayedScene]:
    world = scenes.room()
    known = messages.map_update(world)
    start = (0.5, 0.3, 0.2)
    for name, speed, turn in (
        ("a walk through a room", 0.3, 0.2), ("a drive back through a room", -0.3, 0.2), ("turns in a room", 0.0, -0.8),
    ):  # fmt: skip
        poses, odometry = walk(start, speed, turn, 60), walk((0.0, 0.0, 0.0), speed * 1.002, turn, 60)
        inputs = tuple(
            builders.localizer_input(
                *maker.scans(world, at, k * PERIOD), odometry=dead, moving=(speed, turn), map=known if k >= 5 else None,
                stamp=k * PERIOD, **maker.more(k * PERIOD),
            )
            for k, (at, dead) in enumerate(zip(poses, odometry, strict=True))
        )  # fmt: skip
        yield PlayedScene(name, "usual", maker.context(start, world), inputs, world)
    if maker.takes_scans:
        for name, topic, scans in odd_scans():
            given = tuple(
                builders.localizer_input(*again(scans, k * PERIOD), map=known, stamp=k * PERIOD, **maker.more(0.0))
                for k in range(10)
            )
            yield PlayedScene(name, topic, maker.context(start, world), given)


def _recovery(maker: _Maker) -> Iterator[PlayedScene]:
    trail = walk((-1.5, 0.0, 0.0), 1.0, 0.0, 30)
    for world, speed, turn in (
        (scenes.wall_ahead(0.5), 0.0, 0.0), (scenes.box(0.7), 0.0, 0.0), (scenes.closed(), 0.0, 0.0),
        (scenes.open_floor(), 0.0, 0.0), (scenes.wall_ahead(0.6), -0.1, 0.0), (scenes.open_floor(), 0.0, 0.5),
    ):  # fmt: skip
        inputs = tuple(
            builders.recovery_input(
                *maker.scans(world, at, k * PERIOD), at=at, moving=(speed, turn), starts=k in (0, 30),
                attempt=1 + (k >= 30), trail=trail, stamp=k * PERIOD, **maker.more(k * PERIOD),
            )
            for k, at in enumerate(walk((0.0, 0.0), speed, turn, 60))
        )  # fmt: skip
        name = world.name + (", backing up" if speed else ", turning" if turn else "")
        yield PlayedScene(name, "usual", maker.context(), inputs, world, True)
    if maker.takes_scans:
        for name, topic, scans in odd_scans():
            given = tuple(
                builders.recovery_input(*again(scans, k * PERIOD), starts=k == 0, stamp=k * PERIOD, **maker.more(0.0))
                for k in range(5)
            )
            yield PlayedScene(name, topic, maker.context(), given)
    given = (builders.recovery_input(*maker.scans(scenes.open_floor(), (0.0, 0.0), 0.0), **maker.more(0.0)),)
    yield PlayedScene("a robot that has no trail", "empty", maker.context(), given)


def _platform(maker: _Maker) -> Iterator[PlayedScene]:
    cls: type[Platform] = maker.cls
    specs = [SensorSpec(f"sensor{k}", kind) for k, kind in enumerate(cls.sensor_kinds) if _needs_nothing(cls, kind)]
    for name, sensors in (("a drive in a room", specs), ("a drive without sensors", [])):
        world = scenes.room()
        commands = [(0.3, 0.2)] * 20 + [(0.0, -0.5)] * 10 + [(0.3, 0.0)] * 10 + [(-0.2, 0.3)] * 10
        inputs = tuple(
            builders.platform_input(command, k * PERIOD, 1 if k == 3 else None)
            for k, command in enumerate([(0.0, 0.0), *commands])
        )
        yield PlayedScene(name, "usual", maker.context((0.0, 0.0, 0.3), sensors=sensors, world=world), inputs, world)


def _role(maker: _Maker) -> Iterator[PlayedScene]:
    for name, topic, is_early in (("a drive", "usual", False), ("before the first messages", "empty", True)):
        inputs = tuple(role_inputs(maker.subject.kind, maker.rng, maker.more, is_early=is_early, steps=STEPS))
        yield PlayedScene(name, topic, maker.context(), inputs)


def _node(maker: _Maker) -> Iterator[PlayedScene]:
    for name, topic, is_early in (("a drive", "usual", False), ("before the first messages", "empty", True)):
        inputs = tuple(node_inputs(maker.cls, maker.seed, is_early=is_early))
        yield PlayedScene(name, topic, maker.context(), inputs)
    if RangeScan in sensor_kinds(maker.cls):
        for name, topic, scans in odd_scans():
            if scans:
                inputs = tuple(node_inputs(maker.cls, maker.seed, scans=scans[0], steps=10))
                yield PlayedScene(name, topic, maker.context(), inputs)


def _needs_nothing(cls: type[Platform], kind: str) -> bool:
    """Whether a sensor of a kind can be made without settings."""
    model = cls.sensor_settings.get(kind)
    return model is None or not any(field.is_required() for field in model.model_fields.values())

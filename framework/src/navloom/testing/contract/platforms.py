"""Whether the reports of a simulated platform agree with its world and with its own truth."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from navloom.geometry.frames import transform
from navloom.geometry.world import Box, World
from navloom.messages import Pose2D, RangeScan
from navloom.roles import Context, Platform, PlatformOutput, SensorSpec
from navloom.testing import builders, scenes
from navloom.testing.bench import Bench, alike
from navloom.testing.checks import check
from navloom.testing.contract.parameters import values_of
from navloom.testing.findings import Finding, NotRun
from navloom.testing.inputs import PERIOD
from navloom.testing.player import Fault

__all__ = ["CHECKS"]

Floats = NDArray[np.float64]

START = (0.3, -0.2, 0.4)
"""Pose of the robot, m, m, rad: neither at the origin nor along an axis."""
LOOKS, PUSHES = 25, 80
"""Steps for which the robot is stopped, and for which it drives against a wall."""
AT = 0.3
"""Height of the rays that echoes are compared with, m; everything in the world is taller."""
NEAR, SHARE = 0.15, 0.05
"""Greatest error of an echo: a distance, m, plus a share of its range."""
RIGHT = 0.8
"""Share of the echoes that must be right."""
RAYS = 9
"""Rays that are cast across the width of a beam."""
APART = 3
"""Steps for which contact and truth may differ: a bumper has a delay."""


def _world() -> World:
    """Walls to the left and ahead, a box to the right, and nothing behind the robot."""
    walls = (
        Box("left wall", (-1.0, 4.2), (1.4, 1.6), (0.0, 2.4)), Box("front wall", (4.0, 4.2), (-3.0, 1.6), (0.0, 2.4)),
        Box("box", (1.0, 1.6), (-1.6, -0.9), (0.0, 2.4)),
    )  # fmt: skip
    return World("a wall to the left", walls, bounds=(-5.0, -5.0, 5.0, 5.0))


def _context(bench: Bench, sensors: tuple[SensorSpec, ...], start: tuple[float, float, float] = START) -> Context:
    cls: type[Platform] = bench.subject.thing
    if not cls.is_simulated or cls.own_world(bench.subject.params) is not None:
        raise NotRun("it does not simulate the world that it is given")
    bench.sound()
    return builders.context(role="platform", start=start, period=PERIOD, sensors=sensors, world=_world())


def _outputs(bench: Bench, context: Context, speed: float, steps: int) -> list[PlatformOutput]:
    """Outputs of the platform while it is commanded to drive straight ahead at `speed`, m/s."""
    usual = bench.sound()[0]
    with alike():
        player = bench.player(replace(usual, context=context))
        return [
            player.step(builders.platform_input((speed if k else 0.0, 0.0), k * PERIOD, 1 if k == 3 else None))
            for k in range(steps)
        ]


@check("contract", {"platform"}, "Echoes of range sensors lie on objects of the world.")
def echoes(bench: Bench) -> Iterator[Finding]:
    """For a stopped simulated robot. Wrong bearings, frames and units, and echoes of nothing, show here."""
    cls: type[Platform] = bench.subject.thing
    kinds = [kind for kind, message in cls.sensor_kinds.items() if issubclass(message, RangeScan)]
    specs = tuple(SensorSpec(kind, kind) for kind in kinds if _has_defaults(cls, kind))
    if not specs:
        raise NotRun("it has no range sensor that works without settings")
    context = _context(bench, specs)
    right: dict[str, list[bool]] = {}
    for out in _outputs(bench, context, 0.0, LOOKS):
        pose = context.start if out.truth is None else out.truth.pose
        for name, scan in out.scans.items():
            right.setdefault(name, []).extend(_right(scan, pose, _world()) if isinstance(scan, RangeScan) else ())
    for name, found in right.items():
        if found and sum(found) < RIGHT * len(found):
            yield Finding(
                f"gives echoes of the sensor {name!r} of which {1.0 - np.mean(found):.0%} lie where there is nothing",
                "origins and bearings in the base frame, rad, counter-clockwise, ranges in m, and +inf for no echo",
                given=f"a robot at {START[:2]} m heading {START[2]} rad, walls to the left and ahead, and a box",
            )  # fmt: skip
            return


def _has_defaults(cls: type[Platform], kind: str) -> bool:
    model = cls.sensor_settings.get(kind)
    return model is None or not any(field.is_required() for field in model.model_fields.values())


def _right(scan: RangeScan, pose: Pose2D, world: World) -> list[bool]:
    """Whether an object of the world is where each echo of a scan lies."""
    heard = np.isfinite(scan.ranges)
    base = np.array([pose.x, pose.y, pose.heading])
    count = int(heard.sum())
    spread = np.linspace(-1.0, 1.0, RAYS)[None, :] * scan.half_angles[heard][:, None]
    ways = (scan.bearings[heard][:, None] + spread).ravel() + pose.heading
    places = np.repeat(transform(base, scan.origins[heard]), RAYS, axis=0)
    level = np.zeros(count * RAYS)
    rays = scenes.cast(
        world, np.column_stack([places, level + AT]), np.column_stack([np.cos(ways), np.sin(ways), level])
    ).reshape(count, RAYS)
    ranges = scan.ranges[heard]
    near = rays.min(axis=1)
    slack = NEAR + SHARE * ranges
    is_near = np.abs(ranges - np.clip(near, scan.range_min, None)) <= slack
    found: list[bool] = is_near.tolist()
    return found


@check("contract", {"platform"}, "Contact and truth agree on whether the robot touches something.")
def contact(bench: Bench) -> Iterator[Finding]:
    """For a simulated robot that drives against a wall."""
    apart = 0
    for step, out in enumerate(_outputs(bench, _context(bench, (), (3.0, 0.0, 0.0)), 0.3, PUSHES)):
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


@check("contract", {"platform"}, "Every value that a sensor's settings allow works, with the others at their defaults.")
def sensor_extremes(bench: Bench) -> Iterator[Finding]:
    """As `extremes`, for the settings in the tables [[sensor]]."""
    cls: type[Platform] = bench.subject.thing
    for kind in cls.sensor_kinds:
        model = cls.sensor_settings.get(kind)
        if model is None or not _has_defaults(cls, kind):
            continue
        for name, field in model.model_fields.items():
            for value in values_of(field, field.get_default(call_default_factory=True)):
                try:
                    model.model_validate({name: value})
                except ValidationError:  # the model refuses this value together with the other defaults
                    continue
                try:
                    spec = SensorSpec("sensor", kind, {name: value})
                    _outputs(bench, _context(bench, (spec,)), 0.0, 5)
                except Fault as fault:
                    if not fault.is_refusal:
                        yield Finding(fault.problem, f"an answer, or bounds of {name} that exclude {value!r}",
                                      fault.place, f"a sensor {kind!r} with {name} = {value!r}")  # fmt: skip
                        return


CHECKS = (echoes, contact, sensor_extremes)

"""The side to which an avoider steers, and the status that goes with it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from navloom.geometry.world import World
from navloom.messages import Avoidance, RangeScan

from navloom_check import builders, messages, scenes
from navloom_check.check_bench import Bench, alike
from navloom_check.check_scenes import PERIOD
from navloom_check.checks import check
from navloom_check.findings import Finding, NotRun

__all__ = ["CHECKS"]

See = Callable[[World, float], RangeScan]
"""What a sensor of a robot at the origin reads in a world at a run clock, s."""

PLACES = ((0.9, 0.45), (1.1, 0.4), (1.3, 0.5))
"""Places of a box that is ahead of the robot and beside its way: x and distance to the side, m, base frame."""
LOOKS = 15
"""Steps for which a stopped robot is shown each scene."""
IN_THE_WAY = ((0.8, 0.05), (0.9, -0.1), (1.0, 0.1))
"""Places of a box that the robot would drive into: x and y, m, base frame."""
STEERS = 0.3
"""Change of the turn rate from which an avoider steers round something, as a share of the robot's limit."""
SONARS, HALF_ANGLE, RAYS = 16, math.radians(15.0), 721
"""Sonars all round, half the opening of each cone, rad, and rays over the full turn from which ranges are read."""
TOWARDS = 0.05
"""Least change of the turn rate that counts, as a share of the robot's limit."""


@check("contract", {"avoider"}, "It does not turn towards obstacles on its left as well as on its right.")
def turns_away(bench: Bench) -> Iterator[Finding]:
    """Turn rates are compared with that on an open floor.

    An avoider that prefers a side turns towards boxes on that side only, so turning towards boxes on both is a fault.
    """
    _refuse_blind(bench)
    for sensor, see in (("laser", _laser), ("ring of sonars", _sonars)):
        most = min(_towards(bench, see, side) for side in (1.0, -1.0))
        if most > TOWARDS * builders.robot().max_angular:
            yield Finding(
                f"turns towards a box to its left, and towards one to its right, by {most:.2f} rad/s",
                "bearings counter-clockwise, left positive",
                given=f"a stopped robot with a {sensor} and a box at {PLACES[0]} m, base frame",
            )
            return


def _towards(bench: Bench, see: See, side: float) -> float:
    """Greatest turn rate towards a box on a side (1 left, -1 right), beyond that on an open floor, rad/s.

    0 if it turns away at any place of the box. At some places it may do nothing, since the box is out of its way.
    """
    free = _answer(bench, scenes.open_floor(), see).twist.wz
    changes = [side * (_answer(bench, scenes.box(x, side * y), see).twist.wz - free) for x, y in PLACES]
    return 0.0 if min(changes) < -TOWARDS * builders.robot().max_angular else max(changes)


@check("contract", {"avoider"}, "Its status is not `clear` while it steers round something in its way.")
def status(bench: Bench) -> Iterator[Finding]:
    """The viewer, recoveries and metrics read the status. Turn rates are compared with that on an open floor."""
    _refuse_blind(bench)
    free = _answer(bench, scenes.open_floor()).twist.wz
    answers = [_answer(bench, scenes.box(x, y)) for x, y in IN_THE_WAY]
    least = STEERS * builders.robot().max_angular
    if all(answer.status == "clear" and abs(answer.twist.wz - free) > least for answer in answers):
        yield Finding(
            f"says 'clear' while it turns by {answers[0].twist.wz:.2f} rad/s for a box in its way",
            "the status 'steering' while it steers round something, and 'trapped' where there is no way ahead",
            given=f"a stopped robot and a box at {IN_THE_WAY[0]} m, base frame",
        )  # fmt: skip


def _refuse_blind(bench: Bench) -> None:
    if not any(issubclass(RangeScan, kind) for kind in bench.subject.thing.accepts):
        raise NotRun("it reads no range sensor")
    bench.steady()


def _laser(world: World, stamp: float) -> RangeScan:
    return messages.scan(world, stamp=stamp)


def _sonars(world: World, stamp: float) -> RangeScan:
    """Scan of a ring of sonars round the middle of the robot, each of which reads the nearest thing in its cone."""
    rays = messages.scan(world, beams=RAYS, field_of_view=math.tau, stamp=stamp)
    bearings = (np.arange(SONARS) + 0.5) * math.tau / SONARS - math.pi
    off = np.abs(np.remainder(rays.bearings - bearings[:, None] + math.pi, math.tau) - math.pi)
    ranges = np.where(off <= HALF_ANGLE, rays.ranges, np.inf).min(axis=1)
    none = np.zeros(SONARS)
    origins = np.zeros((SONARS, 2))
    return RangeScan(rays.stamp_ns, origins, bearings, none + HALF_ANGLE, none, ranges, rays.range_min, rays.range_max)


def _answer(bench: Bench, world: World, see: See = _laser) -> Avoidance:
    """The avoider's answer to a stopped robot after some steps; the target is straight ahead."""
    first = bench.sound()[0]
    scene = replace(first, context=builders.context(role="avoider", period=PERIOD))
    with alike():
        player = bench.player(scene)
        for step in range(LOOKS):
            stamp = step * PERIOD
            seen = see(world, stamp)
            answer: Avoidance = player.step(builders.avoider_input(
                seen, target=(3.0, 0.0), stamp=stamp, readings=first.inputs[0].readings, extra=first.inputs[0].extra
            ))  # fmt: skip
    return answer


CHECKS = (turns_away, status)

"""Beams of a scan come in any order, and from any place on the robot: sensors, drivers and simulators differ."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from navloom.messages import Avoidance, Message, RangeScan

from navloom_check.check_bench import Bench, alike
from navloom_check.check_scenes import PlayedScene
from navloom_check.checks import check
from navloom_check.findings import Finding, NotRun, Remark
from navloom_check.plugin_player import rebuilt

__all__ = ["CHECKS", "mounts"]

MOST_OFF = 0.1
"""Greatest difference of two commands that count as equal, as a share of the robot's limits."""
OFTEN = 0.35
"""Share of the answers in a scene from which a difference counts."""
CORNER = (0.2, 0.15)
"""Place of a laser at the front left corner of the robot, m, base frame."""
MANY = 0.35
"""Share of the scenes with obstacles in which it must show: in one alone, a tie may be decided otherwise for good."""


@check("contract", {"avoider"}, "The answer does not depend on the order of a scan's beams.")
def beam_order(bench: Bench) -> Iterator[Finding]:
    """Each scan's beams are shuffled: origins, bearings, ranges and all that belongs to a beam."""
    yield from _differing(
        bench, _shuffled, "when the beams of each scan are shuffled",
        "bearings[k] and origins[k] of beam k, which come in any order; sort by bearing where order matters",
    )  # fmt: skip


@check("behaviour", {"avoider"}, "Shows whether the answer depends on where on the robot the laser is that sees the "
       "same echoes.")  # fmt: skip
def mounts(bench: Bench) -> Iterator[Remark]:
    """The same echoes, described as those of a laser at a corner: with other origins, bearings and ranges.

    A simple avoider may look at ranges alone, which is right where all lasers are in the middle of the robot.
    """
    for finding in _differing(bench, _from_corner, f"when a laser at {CORNER} m sees the same echoes", ""):
        yield Remark(f"{finding.problem} ({finding.given}): look whether the code uses the origins of the beams")


def _differing(bench: Bench, change: Callable[[RangeScan], RangeScan], when: str, expected: str) -> Iterator[Finding]:
    """A finding if answers to changed scans differ in many scenes with obstacles."""
    if not any(issubclass(RangeScan, kind) for kind in bench.subject.thing.accepts):
        raise NotRun("it reads no scans")
    scenes = [scene for scene in bench.steady() if scene.world is None or scene.world.obstacles]
    found = [one for scene in scenes if (one := _finding(bench, scene, change, when, expected)) is not None]
    if len(found) >= max(1.0, MANY * len(scenes)):
        yield found[0]


def _finding(
    bench: Bench, scene: PlayedScene, change: Callable[[RangeScan], RangeScan], when: str, expected: str
) -> Finding | None:
    """A finding if many answers differ in a scene."""
    plain = _answers(bench, scene, lambda scan: scan)
    mixed = _answers(bench, scene, change)
    others = [step for step, (one, other) in enumerate(zip(plain, mixed, strict=True)) if _differ(scene, one, other)]
    count = len(plain)
    if len(others) <= OFTEN * count:
        return None
    return Finding(
        f"gives another answer {when}, in {len(others)} of {count} answers", expected,
        given=bench.at(scene, others[0]), scene=scene.name,
    )  # fmt: skip


def _answers(bench: Bench, scene: PlayedScene, change: Callable[[RangeScan], RangeScan]) -> list[Avoidance]:
    def leaf(message: Message) -> Message:
        return change(message) if isinstance(message, RangeScan) else message

    with alike():
        player = bench.player(scene)
        return [player.step(rebuilt(given, leaf, lambda array: array)) for given in scene.inputs]


def _shuffled(scan: RangeScan) -> RangeScan:
    order = np.random.default_rng(len(scan.ranges)).permutation(len(scan.ranges))
    return RangeScan(
        scan.stamp_ns, scan.origins[order], scan.bearings[order], scan.half_angles[order], scan.time_offsets[order],
        scan.ranges[order], scan.range_min, scan.range_max,
    )  # fmt: skip


def _from_corner(scan: RangeScan) -> RangeScan:
    """The same echoes, described from a corner of the robot; beams without echo keep their bearings."""
    heard = np.isfinite(scan.ranges)
    ways = np.column_stack([np.cos(scan.bearings), np.sin(scan.bearings)])
    to = scan.origins + np.where(heard, scan.ranges, 0.0)[:, None] * ways - CORNER
    bearings = np.where(heard, np.arctan2(to[:, 1], to[:, 0]), scan.bearings)
    ranges = np.where(heard, np.hypot(to[:, 0], to[:, 1]), np.inf)
    return replace(scan, origins=np.tile(CORNER, (len(bearings), 1)), bearings=bearings, ranges=ranges)


def _differ(scene: PlayedScene, avoidance: Avoidance, other: Avoidance) -> bool:
    """Whether two commands differ by more than rounding and ties explain."""
    robot = scene.context.robot
    v, w = abs(avoidance.twist.vx - other.twist.vx), abs(avoidance.twist.wz - other.twist.wz)
    return v > MOST_OFF * robot.max_linear or w > MOST_OFF * robot.max_angular


CHECKS = (beam_order,)

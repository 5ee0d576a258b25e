"""Beams of a scan come in any order: sensors differ, and so do drivers and simulators."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navloom.messages import Avoidance, MapUpdate, Message, PoseEstimate, RangeScan
from navloom.testing.bench import Bench, alike
from navloom.testing.checks import check
from navloom.testing.findings import Finding, NotRun
from navloom.testing.inputs import PlayedScene
from navloom.testing.player import rebuilt

__all__ = ["CHECKS"]

MOST_OFF = 0.1
"""Greatest difference of two commands that count as equal, as a share of the robot's limits."""
FAR, TURNED = 0.1, 0.1
"""Greatest difference of two poses that count as equal, m and rad."""
OTHER_CELLS = 0.25
"""Greatest share of the occupied cells that may differ."""
OCCUPIED = 65
OFTEN = 0.35
"""Share of the answers in a scene from which a difference counts."""
MANY = 0.4
"""Share of the scenes with obstacles in which it must show: in one alone, a tie may be decided otherwise for good."""


@check("contract", {"avoider", "mapper", "localizer"}, "The answer does not depend on the order of a scan's beams.")
def beam_order(bench: Bench) -> Iterator[Finding]:
    """Each scan's beams are shuffled: origins, bearings, ranges and all that belongs to a beam."""
    if not any(issubclass(RangeScan, kind) for kind in bench.subject.thing.accepts):
        raise NotRun("it reads no scans")
    scenes = [scene for scene in bench.steady() if scene.world is None or scene.world.obstacles]
    found = [finding for scene in scenes if (finding := _finding(bench, scene)) is not None]
    if len(found) >= max(1.0, MANY * len(scenes)):
        yield found[0]


def _finding(bench: Bench, scene: PlayedScene) -> Finding | None:
    """A finding if many answers differ in a scene."""
    plain = _answers(bench, scene, lambda scan: scan)
    mixed = _answers(bench, scene, _shuffled)
    others = [step for step, (one, other) in enumerate(zip(plain, mixed, strict=True)) if _differ(scene, one, other)]
    count = sum(one is not None for one in plain)
    if len(others) <= OFTEN * count:
        return None
    return Finding(
        f"gives another answer when the beams of each scan are shuffled, in {len(others)} of {count} answers",
        "bearings[k] and origins[k] of beam k, which come in any order; sort by bearing where order matters",
        given=bench.at(scene, others[0]), scene=scene.name,
    )  # fmt: skip


def _answers(bench: Bench, scene: PlayedScene, change: Callable[[RangeScan], RangeScan]) -> list[Any]:
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


def _differ(scene: PlayedScene, one: Any, other: Any) -> bool:
    """Whether two answers differ by more than rounding and ties explain."""
    if type(one) is not type(other):
        return True
    judges: Mapping[type, Callable[[PlayedScene, Any, Any], bool]] = {
        Avoidance: _other_command, PoseEstimate: _other_pose, MapUpdate: _other_map,
    }  # fmt: skip
    return type(one) in judges and judges[type(one)](scene, one, other)


def _other_command(scene: PlayedScene, one: Avoidance, other: Avoidance) -> bool:
    robot = scene.context.robot
    v, w = abs(one.twist.vx - other.twist.vx), abs(one.twist.wz - other.twist.wz)
    return v > MOST_OFF * robot.max_linear or w > MOST_OFF * robot.max_angular


def _other_pose(scene: PlayedScene, one: PoseEstimate, other: PoseEstimate) -> bool:
    turn = np.remainder(one.pose.heading - other.pose.heading + np.pi, 2.0 * np.pi) - np.pi
    return bool(np.hypot(one.pose.x - other.pose.x, one.pose.y - other.pose.y) > FAR or abs(turn) > TURNED)


def _other_map(scene: PlayedScene, one: MapUpdate, other: MapUpdate) -> bool:
    here, there = _occupied(one), _occupied(other)
    return len(here ^ there) > OTHER_CELLS * len(here | there)


def _occupied(update: MapUpdate) -> set[tuple[int, int]]:
    """Places of the occupied cells in the raster's axes, in cells from the map's origin."""
    grid = update.grid
    found: NDArray[np.int64] = np.argwhere(grid.cells >= OCCUPIED)
    shift = round(grid.origin.y / grid.resolution), round(grid.origin.x / grid.resolution)
    return {(row + shift[0], column + shift[1]) for row, column in found.tolist()}


CHECKS = (beam_order,)

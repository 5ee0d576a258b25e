"""The side to which an avoider steers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from navloom.geometry.world import World
from navloom.messages import RangeScan
from navloom.testing import builders, messages, scenes
from navloom.testing.bench import Bench, alike
from navloom.testing.checks import check
from navloom.testing.findings import Finding, NotRun
from navloom.testing.inputs import PERIOD

__all__ = ["CHECKS"]

PLACES = ((0.9, 0.45), (1.1, 0.4), (1.3, 0.5))
"""Places of a box that is ahead of the robot and beside its way: x and distance to the side, m, base frame."""
LOOKS = 15
"""Steps for which a stopped robot is shown each scene."""
TOWARDS = 0.05
"""Least change of the turn rate towards the box that counts, as a share of the robot's limit."""


@check("contract", {"avoider"}, "It does not turn towards obstacles on its left as well as on its right.")
def turns_away(bench: Bench) -> Iterator[Finding]:
    """Turn rates are compared with that on an open floor.

    An avoider that prefers a side turns towards boxes on that side only, so turning towards boxes on both is a fault.
    """
    if not any(issubclass(RangeScan, kind) for kind in bench.subject.thing.accepts):
        raise NotRun("it reads no range sensor")
    bench.steady()
    free = _turn_rate(bench, scenes.open_floor())
    least = TOWARDS * builders.robot().max_angular
    for side in (1.0, -1.0):
        changes = [side * (_turn_rate(bench, scenes.box(x, side * y)) - free) for x, y in PLACES]
        if min(changes) <= least:
            return
    yield Finding(
        f"turns towards a box to its left, and towards one to its right, by at least {min(changes):.2f} rad/s",
        "bearings counter-clockwise, left positive", given=f"a stopped robot and a box at {PLACES[0]} m, base frame",
    )  # fmt: skip


def _turn_rate(bench: Bench, world: World) -> float:
    """Turn rate that the avoider commands a stopped robot after some steps, rad/s; the target is straight ahead."""
    scene = replace(bench.sound()[0], context=builders.context(role="avoider", period=PERIOD))
    turn = 0.0
    with alike():
        player = bench.player(scene)
        for step in range(LOOKS):
            stamp = step * PERIOD
            seen = messages.scan(world, (0.0, 0.0, 0.0), stamp=stamp)
            turn = player.step(builders.avoider_input(seen, target=(3.0, 0.0), stamp=stamp)).twist.wz
    return turn


CHECKS = (turns_away,)

"""How a controller uses its reference: the speed that it asks for, and the signs of the errors that it reports."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from navloom.messages import TrackingCommand, Trajectory

from navloom_check import builders, messages
from navloom_check.check_bench import Bench, alike
from navloom_check.check_scenes import PERIOD
from navloom_check.checks import check
from navloom_check.findings import Finding
from navloom_check.messages import Place

__all__ = ["CHECKS"]

LENGTH = 10.0
"""Length of the trajectory, m."""
SLOW, FAST = 0.15, 0.35
"""Speeds of the first and of the second half of the trajectory, m/s."""
BEFORE, AFTER = 2.0, 7.0
"""Places in the two halves, m along the trajectory."""
RISE = 1.2
"""Least ratio of the speeds at these places that follows the reference."""
LOOKS = 3
"""Steps for which the controller is shown the same situation."""
ASIDE, TURNED = 0.2, 0.3
"""Distance of the robot from the trajectory, m, and angle between them, rad."""
CLEAR = 0.1
"""Least share of such an error that has a sign."""


def _answer(bench: Bench, at: Place, followed: Trajectory, speed: float) -> TrackingCommand:
    """The answer of a new object after some steps at a place of a trajectory."""
    scene = bench.sound()[0]
    with alike():
        player = bench.player(scene)
        for step in range(LOOKS):
            answer: TrackingCommand = player.step(builders.controller_input(
                at, (speed, 0.0), trajectory=followed, progress=at[0], stamp=step * PERIOD, extra=scene.inputs[0].extra
            ))  # fmt: skip
    return answer


@check("contract", {"controller"}, "On the trajectory, it drives faster where the reference is faster.")
def reference_speed(bench: Bench) -> Iterator[Finding]:
    """A straight trajectory whose second half is faster; the robot is on it, with the reference's speed and heading."""
    samples = np.array(messages.trajectory(LENGTH).samples)
    samples[:, 5] = np.interp(samples[:, 0], (0.45 * LENGTH, 0.55 * LENGTH), (SLOW, FAST))
    followed = Trajectory(1, samples)
    slow, fast = (
        _answer(bench, (along, 0.0, 0.0), followed, speed).twist.vx for along, speed in ((BEFORE, SLOW), (AFTER, FAST))
    )
    if fast < RISE * slow:
        yield Finding(
            f"commands {slow:.3f} m/s where the reference has {SLOW} m/s, and {fast:.3f} m/s where it has {FAST} m/s",
            "the speed of the reference where the robot is: given.reference.speed",
            given=f"a robot on a straight trajectory, {BEFORE:g} m and {AFTER:g} m along it",
        )  # fmt: skip


@check("contract", {"controller"}, "The errors e2 and e3 that it reports have the signs of their definition.")
def error_signs(bench: Bench) -> Iterator[Finding]:
    """The robot is beside a straight trajectory, or turned to it. Zero, for an error that it does not use, is sound."""
    followed = messages.trajectory(LENGTH)
    aside = [_answer(bench, (BEFORE, side * ASIDE, 0.0), followed, 0.3).e2 * side for side in (1.0, -1.0)]
    turned = [_answer(bench, (BEFORE, 0.0, side * TURNED), followed, 0.3).e3 * side for side in (1.0, -1.0)]
    for name, found, error, what in (
        ("e2", aside, ASIDE, f"{ASIDE:g} m to the left of"),
        ("e3", turned, TURNED, f"turned {math.degrees(TURNED):.0f}° to the left of"),
    ):
        if min(found) > CLEAR * error:
            yield Finding(
                f"reports {name} = {found[0]:.2f}", f"{name} = {-error:g}: how far the reference is ahead, to the left "
                "and turned to the left of the robot", given=f"a robot {what} its trajectory",
            )  # fmt: skip
            return


CHECKS = (reference_speed, error_signs)

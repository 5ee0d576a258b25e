"""The attempts of a recovery: each one starts anew, and goes on until the robot has moved."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from navloom.geometry.frames import compose
from navloom.messages import RangeScan
from navloom.roles import RecoveryInput
from navloom.testing.behaviour.bodies import stuck_scene
from navloom.testing.behaviour.driving import Pose, drive, estimate_at
from navloom.testing.behaviour.measured import PERIOD, PERIOD_NS, Maker, Unfit, full_scan
from navloom.testing.bench import Bench, alike
from navloom.testing.checks import check
from navloom.testing.findings import Finding, NotRun

__all__ = ["CHECKS"]

LONGEST = 60.0
"""Longest attempt, s."""
MOVES, STANDS = 0.05, 0.01
"""Ways from which, and up to which, a robot counts as moved: m, and rad of turns."""
COMMANDS = 0.02
"""Commanded speed or turn rate from which a recovery tries to move the robot, m/s or rad/s."""
GIVEN = "a robot 0.45 m from a wall, which drove there from 1.2 m behind"


@dataclass
class _Attempt:
    """What a recovery did in one attempt: way of the robot, m or rad, greatest command, steps, and last state."""

    way: float = 0.0
    most: float = 0.0
    steps: int = 0
    state: str = "running"


def _attempt(recovery: Any, make: Maker, number: int, begin_ns: int) -> _Attempt:
    """Let a recovery drive a robot that stands in front of a wall, with room behind it."""
    scene = stuck_scene(0)
    start = np.array([scene.start.x, scene.start.y, scene.start.heading])
    trail = compose(start, np.stack([np.linspace(-scene.came, 0.0, 25), np.zeros(25), np.zeros(25)], axis=1))
    sees, extra, found = make.sees(RangeScan), make.extra, _Attempt()

    def step(now_ns: int, pose: Pose, twist: tuple[float, float]) -> tuple[float, float] | str:
        if found.state != "running":
            return found.state
        stamp_ns = begin_ns + now_ns
        answer = recovery.recover(RecoveryInput(
            stamp_ns, (full_scan(scene, pose, stamp_ns),) * sees, estimate_at(stamp_ns, pose, twist), number,
            "no progress", found.steps == 0, trail, sensors=("laser",) * sees, extra=extra,
        ))  # fmt: skip
        found.state, found.steps = answer.state, found.steps + 1
        found.most = max(found.most, abs(answer.twist.vx), abs(answer.twist.wz))
        return answer.twist.vx, answer.twist.wz

    poses = drive(scene, LONGEST, step, may_stand=True).poses
    turned = np.abs(np.diff(np.unwrap(poses[:, 2]))).sum() if len(poses) > 1 else 0.0
    found.way = float(np.hypot(*np.diff(poses[:, :2], axis=0).T).sum() + turned)
    return found


def _refuse_unfit(bench: Bench) -> Maker:
    bench.sound()
    make = Maker(bench.subject.thing, bench.subject.params, bench.seed)
    try:
        make.extra  # noqa: B018  (it raises if the plugin waits for inputs that no scene has)
    except Unfit as error:
        raise NotRun(str(error)) from None
    return make


@check("contract", {"recovery"}, "An attempt that commands a velocity is not done before the robot has moved.")
def attempt_moves(bench: Bench) -> Iterator[Finding]:
    """There is room behind the robot. A recovery that only waits, or that fails, is sound."""
    make = _refuse_unfit(bench)
    with alike():
        seen = _attempt(make(stuck_scene(0)), make, 1, 0)
    if seen.state == "done" and seen.most >= COMMANDS and seen.way < STANDS:
        yield Finding(
            f"is done after {seen.steps} steps ({seen.steps * PERIOD:g} s) in which the robot moved {seen.way:.3f} m, "
            f"with commands of up to {seen.most:.2f} m/s or rad/s", "running until it has moved, or failed if it "
            "cannot; stamps are in ns", given=GIVEN,
        )  # fmt: skip


@check("contract", {"recovery"}, "An attempt after another acts as one of a new object, or says that it failed.")
def attempts_anew(bench: Bench) -> Iterator[Finding]:
    """The robot is stuck at the same place again, 100 s later, and `starts` is true in the first step."""
    make = _refuse_unfit(bench)
    again_ns = math.ceil(100.0 / PERIOD) * PERIOD_NS
    with alike():
        recovery = make(stuck_scene(0))
        first = _attempt(recovery, make, 1, 0)
        for number in (2, 1):
            second = _attempt(recovery, make, number, again_ns)
            new = _attempt(make(stuck_scene(0)), make, number, again_ns)
            is_idle = second.state == "done" and second.way < STANDS
            if first.state != "running" and is_idle and new.way > MOVES:
                yield Finding(
                    f"is done in attempt {number} after {second.steps} steps, and the robot has not moved; without an "
                    f"earlier attempt, it moves {new.way:.2f} m or rad", "a new attempt where given.starts is true: "
                    "place and time of the start are those of this step", given=GIVEN,
                )  # fmt: skip
                return
            again_ns += again_ns


CHECKS = (attempt_moves, attempts_anew)

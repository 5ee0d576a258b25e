"""Attempts of a recovery: each starts from a clean state and lasts until the robot has moved."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from navloom.geometry.frames import compose
from navloom.messages import RangeScan
from navloom.roles import RecoveryInput

from navloom_check.behaviour.avoider_scenes import place_in_map
from navloom_check.behaviour.measurements import PERIOD, PERIOD_NS, Maker, Unfit, full_scan
from navloom_check.behaviour.platform_scenes import stuck_scene
from navloom_check.behaviour.scene_drives import Pose, drive, estimate_at
from navloom_check.check_bench import Bench, alike
from navloom_check.checks import check
from navloom_check.findings import Finding, NotRun

__all__ = ["CHECKS"]

LONGEST = 60.0
"""Longest attempt, s."""
MOVES, STANDS = 0.05, 0.01
"""Ways from which, and up to which, a robot counts as moved: m, and rad of turns."""
COMMANDS = 0.02
"""Commanded speed or turn rate from which a recovery tries to move the robot, m/s or rad/s."""
PLACES = (1, 2, 3)
"""Seeds of other places in the map."""
RATIO, FEW = 1.5, 0.1
"""Greatest ratio of times and ways that count as equal, and a difference of times that does not matter, s."""
GIVEN = "a robot 0.45 m from a wall, which drove there from 1.2 m behind"


@dataclass
class _Attempt:
    """What a recovery did in one attempt: way of the robot, m or rad, greatest command, steps, and last state."""

    way: float = 0.0
    most: float = 0.0
    steps: int = 0
    state: str = "running"


def _attempt(recovery: Any, make: Maker, number: int, begin_ns: int, *, seed: int = 0, calls: int = 1) -> _Attempt:
    """Let a recovery drive a robot that stands in front of a wall, with room behind it.

    Args:
        recovery: The object.
        make: What made it.
        number: Number of the attempt.
        begin_ns: Run clock of its first step.
        seed: Of the place of robot and wall in the map.
        calls: Steps of the recovery in 0.05 s.
    """
    scene = stuck_scene(0).moved(place_in_map(seed))
    start = np.array([scene.start.x, scene.start.y, scene.start.heading])
    trail = compose(start, np.stack([np.linspace(-scene.came, 0.0, 25), np.zeros(25), np.zeros(25)], axis=1))
    sees, found = make.sees(RangeScan), _Attempt()

    def step(now_ns: int, pose: Pose, twist: tuple[float, float]) -> tuple[float, float] | str:
        for call in range(calls):
            if found.state != "running":
                return found.state
            stamp_ns = begin_ns + now_ns + call * (PERIOD_NS // calls)
            answer = recovery.recover(RecoveryInput(
                stamp_ns, (full_scan(scene, pose, stamp_ns),) * sees, estimate_at(stamp_ns, pose, twist), number,
                "no progress", found.steps == 0, trail, sensors=("laser",) * sees,
                extra=make.extra(scene, stamp_ns, pose, twist),
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
        make.extra(stuck_scene(0), 0, (0.0, 0.0, 0.0))
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


@check("contract", {"recovery"}, "An attempt takes the same time and way with ticks half as long, and wherever the "
       "robot is turned to.")  # fmt: skip
def attempt_ways(bench: Bench) -> Iterator[Finding]:
    """The same situation, stepped twice as often, and with robot and wall elsewhere in the map."""
    make = _refuse_unfit(bench)
    fast = replace(make, period=0.5 * PERIOD)
    with alike():
        usual = _attempt(make(stuck_scene(0)), make, 1, 0)
        often = _attempt(fast(stuck_scene(0)), fast, 1, 0, calls=2)
        moved = [_attempt(make(stuck_scene(0)), make, 1, 0, seed=seed) for seed in PLACES]
        other = replace(make, seed=make.seed + 1)
        drawn = _attempt(other(stuck_scene(0)), other, 1, 0)
    if (drawn.steps, drawn.way) != (usual.steps, usual.way):
        raise NotRun("its attempts depend on its random streams")
    if usual.state == "running":
        return
    seconds, others = usual.steps * PERIOD, 0.5 * often.steps * PERIOD
    if not seconds / RATIO - FEW < others < RATIO * seconds + FEW:
        yield Finding(
            f"ends an attempt after {seconds:.2f} s, and after {others:.2f} s with ticks half as long",
            "times from stamps, not from the number of calls", given=GIVEN,
        )  # fmt: skip
    ways = [one.way for one in moved]
    if max(*ways, usual.way) > RATIO * min(*ways, usual.way) + MOVES:
        yield Finding(
            f"moves the robot {min(*ways, usual.way):.2f} to {max(*ways, usual.way):.2f} m and rad in the same "
            "situation at other places of the map", "distances and angles from the pose at the start of the attempt",
            given=GIVEN,
        )  # fmt: skip


CHECKS = (attempt_moves, attempts_anew, attempt_ways)

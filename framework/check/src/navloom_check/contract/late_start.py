"""Whether the run clock may begin late: a plugin is started, swapped or restarted on a robot that has run for long."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
from navloom.messages import Message

from navloom_check.check_bench import Bench, alike
from navloom_check.check_scenes import PERIOD, PlayedScene
from navloom_check.checks import PLAYED, check
from navloom_check.findings import Finding
from navloom_check.plugin_player import Fault
from navloom_check.shifted_inputs import restamped

__all__ = ["CHECKS"]

LATER = 2_592_000.0
"""Run time before the first step, s: 30 days, more than 32 bits count in ms."""
HIGHER = round(LATER / PERIOD / 1000.0)
"""Requests of that time, of which `restamped` takes one for 1000 ticks."""
EQUAL = 1e-3
"""Greatest difference of equal numbers, absolute and relative: times in s lose digits."""
OFTEN = 0.35
"""Share of the answers of a scene from which a difference counts: a tie may be decided otherwise for a while."""
BEGIN = 5
"""First steps of a scene that count without the others, if all of them differ: ties are rare there."""


@check("contract", PLAYED - {"platform"}, "Answers do not depend on how long the robot has already run.")
def later_start(bench: Bench) -> Iterator[Finding]:
    """Each scene is played with all stamps 30 days later."""
    for scene in bench.steady():
        if finding := _finding(bench, scene):
            yield finding
            return


def _finding(bench: Bench, scene: PlayedScene) -> Finding | None:
    late: list[int] = []
    with alike():
        first, second = bench.player(scene), bench.player(scene)
        for step, given in enumerate(scene.inputs):
            answer = first.step(given)
            try:
                other = second.step(restamped(given, LATER, HIGHER))
            except Fault as fault:
                return bench.finding(fault, f"{bench.at(scene, step)}, {LATER:g} s later", scene.name)
            if not _are_alike(answer, other):
                late.append(step)
    if len(late) <= OFTEN * len(scene.inputs) and late[:BEGIN] != list(range(BEGIN)):
        return None
    return Finding(
        f"gives another answer after {LATER:g} s of run time, in {len(late)} of {len(scene.inputs)} answers",
        "differences of stamps, in ns as int64; a run may begin at any stamp", given=bench.at(scene, late[0]),
        scene=scene.name,
    )  # fmt: skip


def _are_alike(one: Any, other: Any) -> bool:
    """Whether two answers are equal apart from stamps, request numbers and rounding."""
    if type(one) is not type(other):
        return False
    if isinstance(one, Message):
        return all(
            kind.rule == "stamp" or name == "request_id" or _are_alike(getattr(one, name), getattr(other, name))
            for name, kind in one.kinds.items()
        )
    if isinstance(one, np.ndarray):
        return one.shape == other.shape and bool(np.allclose(one, other, rtol=EQUAL, atol=EQUAL, equal_nan=True))
    if isinstance(one, float):
        return bool(np.isclose(one, other, rtol=EQUAL, atol=EQUAL, equal_nan=True))
    if isinstance(one, (tuple, list)):
        return len(one) == len(other) and all(map(_are_alike, one, other))
    if is_dataclass(one) and not isinstance(one, type):
        return all(_are_alike(getattr(one, field.name), getattr(other, field.name)) for field in fields(one))
    return bool(one == other)


CHECKS = (later_start,)

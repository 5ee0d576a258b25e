"""What a plugin answers: types, ranges, odd readings, typed failures."""

from __future__ import annotations

import math
from collections.abc import Iterator

from navloom.messages import PlanFailure

from navloom_check.check_bench import USUAL, Bench
from navloom_check.check_scenes import IMPOSSIBLE
from navloom_check.checks import PLAYED, check
from navloom_check.findings import Finding, NotRun

__all__ = ["CHECKS"]

ASIDE = 1.0
"""Greatest distance of the place of a failure from the start or goal that is occupied, m."""


@check("contract", PLAYED, "Its process survives every call: it does not exit, crash or get killed.")
def survives(bench: Bench) -> Iterator[Finding]:
    """Play every scene once. The runner reports a process that ended."""
    bench.of_topic()
    yield from ()


@check("contract", PLAYED, "Every call returns; none hangs.")
def returns(bench: Bench) -> Iterator[Finding]:
    """Play every scene, as `survives` does. A timer ends a process that hangs, and the runner reports it."""
    yield from survives.run(bench)  # type: ignore[misc]


@check("contract", PLAYED, "In every usual scene, each answer has its type, with values in their ranges.")
def answers(bench: Bench) -> Iterator[Finding]:
    """Answers must pass the checks of the door and those of their message class."""
    yield from _faults(bench, (USUAL, "at_goal"))


@check("contract", PLAYED, "Empty scans, scans without echo, single beams and readings of 0 m give an answer "
       "without NaN, or InputError.")  # fmt: skip
def odd_readings(bench: Bench) -> Iterator[Finding]:
    """Sensors give such readings now and then."""
    topics = ("empty", "infinite", "single_beam", "nearest")
    if not bench.of_topic(*topics):
        raise NotRun("it reads no range sensor")
    yield from _faults(bench, topics, may_refuse=True)


@check("contract", {"planner"}, "A goal that cannot be reached gives a PlanFailure, never an exception or a path.")
def typed_failures(bench: Bench) -> Iterator[Finding]:
    """Goals in a wall and behind walls, and requests that may be answered by a path or by a failure."""
    yield from _faults(bench, ("odd_request", IMPOSSIBLE))
    for scene in bench.of_topic(IMPOSSIBLE):
        if not isinstance(bench.base(scene), list):
            continue
        answer = bench.player(scene).step(scene.inputs[0])
        if not isinstance(answer, PlanFailure):
            yield Finding(
                "gives a path where there is none", "PlanFailure(request_id, 'goal_occupied' or 'no_path', place, why)",
                given=bench.at(scene, 0), scene=scene.name,
            )  # fmt: skip
            continue
        request = scene.inputs[0].request
        end = {"goal_occupied": request.goal, "start_occupied": request.start}.get(answer.kind)
        if end is not None and math.dist((end.x, end.y), (answer.place.x, answer.place.y)) > ASIDE:
            yield Finding(
                f"says {answer.kind} at ({answer.place.x:.2f}, {answer.place.y:.2f}) m, and was asked for "
                f"({end.x:.2f}, {end.y:.2f}) m", "the occupied place, m, map frame", given=bench.at(scene, 0),
                scene=scene.name,
            )  # fmt: skip


def _faults(bench: Bench, topics: tuple[str, ...], may_refuse: bool = False) -> Iterator[Finding]:
    """The faults in the first plays of scenes, each text once."""
    told: set[str] = set()
    for scene in bench.of_topic(*topics):
        base = bench.base(scene)
        if isinstance(base, list):
            continue
        fault, step = base
        if may_refuse and fault.is_refusal:
            continue
        if fault.problem not in told:
            told.add(fault.problem)
            yield bench.finding(fault, bench.at(scene, step), scene.name)


CHECKS = (survives, returns, answers, odd_readings, typed_failures)

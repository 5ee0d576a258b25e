"""What shows in a long drive only, and what becomes of answers that were given."""

from __future__ import annotations

from collections.abc import Iterator
from time import thread_time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navloom.testing.bench import Bench, alike
from navloom.testing.checks import check
from navloom.testing.contract.conduct import COMMANDING, beyond
from navloom.testing.contract.kinds import PLAYED
from navloom.testing.findings import Finding
from navloom.testing.inputs import PERIOD, Scene
from navloom.testing.player import Fault, digest
from navloom.testing.restamped import restamped

__all__ = ["CHECKS"]

LONG = 3.0
"""Time for which steps are played, s."""
FEWEST, MOST = 240, 2000
"""Steps that are played; of a robot that is asked for each tick, 12 s to 100 s."""
SEAM = 5
"""Steps after a scene begins again, and the robot with it, that are not judged."""
IN_A_ROW = 3
"""Commands beyond the limits, one after the other, that are a fault."""
EVER_LONGER = 3.0
"""Ratio of the last steps' times to those of the first that is a fault, where it still grows."""
WORTH = 0.1
"""Share of the tick below which a step's time does not matter."""


@check("contract", PLAYED, "A long drive brings answers as its beginning does: none fails, is beyond the limits, or "
       "takes ever longer.")  # fmt: skip
def goes_on(bench: Bench) -> Iterator[Finding]:
    """A scene is played on and on, with fresh inputs and rising stamps."""
    scenes = bench.sound()
    scene = next((one for one in scenes[1:] if one.is_gentle), scenes[0])
    spent: list[float] = []
    too_much = 0
    with alike():
        try:
            player = bench.player(scene)
            for step, given in enumerate(_on_and_on(scene)):
                before = thread_time()
                answer = player.step(given)
                spent.append(thread_time() - before)
                is_judged = scene.is_gentle and step % len(scene.inputs) >= SEAM
                over = beyond(answer.twist, scene.context.robot) if is_judged and _commands(bench) else None
                too_much = too_much + 1 if over is not None else 0
                if over is not None and too_much == IN_A_ROW:
                    yield Finding(*over, given=_at(scene, step), scene=scene.name)
                    return
                if len(spent) >= FEWEST and sum(spent) > LONG:
                    break
        except Fault as fault:
            if not fault.is_refusal:
                yield bench.finding(fault, _at(scene, len(spent)), scene.name)
            return
    yield from _slowing(np.array(spent), scene)


def _on_and_on(scene: Scene) -> Iterator[Any]:
    """The inputs of a scene, again and again."""
    for step in range(MOST):
        lap, place = divmod(step, len(scene.inputs))
        yield restamped(scene.inputs[place], lap * len(scene.inputs) * PERIOD, lap * 1000)


def _commands(bench: Bench) -> bool:
    return bench.subject.kind in COMMANDING


def _at(scene: Scene, step: int) -> str:
    return f"scene {scene.name!r} again and again, step {step}"


def _slowing(spent: NDArray[np.float64], scene: Scene) -> Iterator[Finding]:
    """What to say of steps that take longer and longer, s."""
    laps = len(spent) // len(scene.inputs)
    quarter = laps // 4 * len(scene.inputs)
    if not quarter:
        return
    first, second, third, last = (
        float(np.median(spent[k * quarter : (k + 1) * quarter].reshape(-1, len(scene.inputs)).min(axis=0)))
        for k in range(4)
    )
    is_growing = second < third < last and last - third > 0.5 * (second - first)
    if is_growing and last > EVER_LONGER * first and last > WORTH * PERIOD:
        yield Finding(
            f"takes ever longer for a step: {1000.0 * first:.1f} ms at first, {1000.0 * last:.1f} ms after "
            f"{len(spent)} steps", "a step whose work does not grow with the drive",
            given=_at(scene, len(spent)), scene=scene.name,
        )  # fmt: skip


@check("contract", PLAYED, "An answer that was given stays as it is.")
def answers_stay(bench: Bench) -> Iterator[Finding]:
    """Others still read it, and recordings keep it: an array that is filled anew in each step changes it."""
    for scene in bench.sound():
        given: list[tuple[Any, bytes]] = []
        with alike():
            player = bench.player(scene)
            for one in scene.inputs:
                answer = player.step(one)
                given.append((answer, digest(answer)))
        for step, (answer, before) in enumerate(given):
            if digest(answer) != before:
                yield Finding("changes an answer that it gave before", "an array of its own for each answer: a copy, "
                              "or no read-only view of one that is written to", given=bench.at(scene, step),
                              scene=scene.name)  # fmt: skip
                return


CHECKS = (goes_on, answers_stay)

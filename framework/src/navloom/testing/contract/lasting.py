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
from navloom.testing.inputs import PERIOD, PlayedScene
from navloom.testing.player import Fault, digest
from navloom.testing.restamped import restamped

__all__ = ["CHECKS"]

LONG = 3.0
"""Time for which steps are played, s."""
FEWEST, MOST = 240, 2000
"""Steps that are played; of a robot that is asked for each tick, 12 s to 100 s."""
FEW = 3
"""Scenes of a long drive."""
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
    """Scenes are played on and on, with fresh inputs and rising stamps."""
    drive = _drive(bench.sound())
    spent: list[float] = []
    too_much = 0
    with alike():
        try:
            player = bench.player(drive[0][0])
            for step in range(MOST):
                lap, place = divmod(step, len(drive))
                scene, number, later = drive[place]
                given = restamped(scene.inputs[number], later + lap * len(drive) * PERIOD, lap * 1000)
                before = thread_time()
                answer = player.step(given)
                spent.append(thread_time() - before)
                is_judged = scene.is_gentle and number >= SEAM and bench.subject.kind in COMMANDING
                over = beyond(answer.twist, scene.context.robot) if is_judged else None
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
    yield from _slowing(np.array(spent), len(drive), drive[0][0])


def _drive(scenes: list[PlayedScene]) -> list[tuple[PlayedScene, int, float]]:
    """One round of a long drive of one robot: of each step its scene, its number there, and how much later it is, s."""
    robot = scenes[0].context.robot
    gentle = [one for one in scenes if one.is_gentle and one.context.robot.max_linear == robot.max_linear]
    found: list[tuple[PlayedScene, int, float]] = []
    for scene in gentle[-FEW:] or scenes[:1]:
        later = len(found) * PERIOD
        found += [(scene, number, later) for number in range(len(scene.inputs))]
    return found


def _at(scene: PlayedScene, step: int) -> str:
    return f"step {step} of a long drive, in scene {scene.name!r}"


def _slowing(spent: NDArray[np.float64], lap: int, scene: PlayedScene) -> Iterator[Finding]:
    """What to say of steps that take longer and longer, s; `lap` is how many are a round."""
    laps = len(spent) // lap
    if laps < 4:
        return
    rounds = np.median(spent[: laps * lap].reshape(laps, lap), axis=1)
    first, second, third, last = (float(part.min()) for part in np.array_split(rounds, 4))
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

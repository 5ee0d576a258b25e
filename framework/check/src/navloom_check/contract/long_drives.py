"""Faults that appear only in a long drive, and answers that change after they were given."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from time import thread_time
from typing import Any

import numpy as np
from navloom.geometry.cells import places_of
from navloom.geometry.world import Box
from navloom.messages import MapUpdate, RangeScan, Sweep
from numpy.typing import NDArray

from navloom_check import builders, messages, scenes
from navloom_check.check_bench import Bench, alike
from navloom_check.check_scenes import PERIOD, PlayedScene
from navloom_check.checks import PLAYED, check
from navloom_check.contract.resource_use import COMMANDING, beyond
from navloom_check.findings import Finding, NotRun
from navloom_check.plugin_player import Fault, digest
from navloom_check.shifted_inputs import restamped

__all__ = ["CHECKS"]

LONG = 4.0
"""Processor time after which a long drive ends, s, once the fewest steps were played."""
FEWEST, MOST = 240, 6_400
"""Fewest and most steps of a long drive: 12 s and over 5 min of robot time where each step is a tick."""
FEW = 3
"""Most scenes that one round of a long drive joins."""
SEAM = 5
"""First steps of each scene that are not judged, since the robot jumps to the scene's start."""
IN_A_ROW = 3
"""Consecutive commands beyond the limits that are a fault."""
EVER_LONGER = 3.0
"""Ratio of the last step times to the first that is a fault, if step times still grow."""
LOOKS, SETTLED = 600, 20
"""Readings of the same scene, more than twice what a byte counts, and the first of them whose map is judged."""
SECOND = 0.6
"""Time from one reading to the next, s: a map may be published less often than it is updated."""
LONG_LOOK = 8.0
"""Processor time after which the readings end, s."""
LASTS = 0.8
"""Least share of the occupied cells that must stay."""
OCCUPIED = 65
"""Occupancy, percent, from which a cell counts as occupied."""
WITH, WITHOUT = 20, 6
"""Readings of a room with a box, and without it from the one with which the map is cleared."""
BOX = Box("box", (1.2, 1.8), (-0.3, 0.3), (0.0, 2.4))
"""A box ahead of the robot."""
FEWEST_CELLS, STAY = 2, 0.5
"""Fewest occupied cells of the box, and the greatest share of them that may stay."""
WORTH = 0.1
"""Step time below which growth does not matter, as a share of the tick."""


@check("contract", PLAYED, "A long drive goes on as it began: no step fails, exceeds the limits or takes longer and "
       "longer.")  # fmt: skip
def goes_on(bench: Bench) -> Iterator[Finding]:
    """Scenes are repeated, with new input objects and rising stamps."""
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
    """One round of a long drive with one robot: the scene of each step, its number there, and its shift in time, s."""
    robot = scenes[0].context.robot
    # One player has one robot, whose limits its commands are judged by.
    gentle = [
        played_scene
        for played_scene in scenes
        if played_scene.is_gentle and played_scene.context.robot.max_linear == robot.max_linear
    ]
    found: list[tuple[PlayedScene, int, float]] = []
    for scene in gentle[-FEW:] or scenes[:1]:
        later = len(found) * PERIOD
        found += [(scene, number, later) for number in range(len(scene.inputs))]
    return found


def _at(scene: PlayedScene, step: int) -> str:
    return f"step {step} of a long drive, in scene {scene.name!r}"


def _slowing(spent: NDArray[np.float64], lap: int, scene: PlayedScene) -> Iterator[Finding]:
    """A finding if the times of the steps, `spent`, s, keep growing; `lap` is the number of steps in a round."""
    laps = len(spent) // lap
    # Four quarters are compared below.
    if laps < 4:
        return
    # Median, and below the least: other programs make single steps slower, never faster.
    rounds = np.median(spent[: laps * lap].reshape(laps, lap), axis=1)
    first, second, third, last = (float(part.min()) for part in np.array_split(rounds, 4))
    is_growing = second < third < last and last - third > 0.5 * (second - first)
    if is_growing and last > EVER_LONGER * first and last > WORTH * PERIOD:
        yield Finding(
            f"takes longer and longer for a step: {1000.0 * first:.1f} ms at first, {1000.0 * last:.1f} ms after "
            f"{len(spent)} steps", "a step whose work does not grow with the drive",
            given=_at(scene, len(spent)), scene=scene.name,
        )  # fmt: skip


@check("contract", PLAYED, "An answer does not change after it was given.")
def answers_stay(bench: Bench) -> Iterator[Finding]:
    """Other nodes still read it, and recordings keep it. Reusing one array for every answer changes earlier answers."""
    for scene in bench.sound():
        given: list[tuple[Any, bytes]] = []
        with alike():
            player = bench.player(scene)
            for one in scene.inputs:
                answer = player.step(one)
                given.append((answer, digest(answer)))
        for step, (answer, before) in enumerate(given):
            if digest(answer) != before:
                yield Finding("changes an answer that it gave in an earlier step", "a new array in each answer: a "
                              "copy, not a view of an array that the plugin writes to again",
                              given=bench.at(scene, step), scene=scene.name)  # fmt: skip
                return


@check("contract", {"mapper"}, "A map of a room stays the same while a stopped robot looks at it.")
def map_lasts(bench: Bench) -> Iterator[Finding]:
    """The same readings again and again, as many as a byte counts and more."""
    scene = bench.sound()[0]
    given = next(
        (one for one in scene.inputs if not one.clear and one.scans and (one.sweeps or not _takes_sweeps(bench))), None
    )
    given = given or next((one for one in scene.inputs if not one.clear and (one.sweeps or one.scans)), None)
    if given is None:
        raise NotRun("no scene has readings for it")
    first: frozenset[tuple[float, ...]] = frozenset()
    spent = 0.0
    with alike():
        player = bench.player(scene)
        for number in range(LOOKS):
            before = thread_time()
            answer = player.step(restamped(given, number * SECOND))
            spent += thread_time() - before
            if isinstance(answer, MapUpdate) and number >= SETTLED:
                occupied = _occupied_places(answer)
                first = first or occupied
                if len(first & occupied) < LASTS * len(first):
                    yield Finding(
                        f"loses {1.0 - len(first & occupied) / len(first):.0%} of its occupied cells, though nothing "
                        "moved", "counters that stop at their greatest value, or that have room for a long drive",
                        given=f"reading {number} of the same readings in scene {scene.name!r}", scene=scene.name,
                    )  # fmt: skip
                    return
            if spent > LONG_LOOK:
                return


def _takes_sweeps(bench: Bench) -> bool:
    return any(issubclass(Sweep, kind) for kind in bench.subject.thing.accepts)


def _occupied_places(update: MapUpdate) -> frozenset[tuple[float, ...]]:
    """Middles of the occupied cells, in mm, map frame."""
    places = places_of(update.grid, np.argwhere(update.grid.cells >= OCCUPIED))
    return frozenset(map(tuple, np.round(1000.0 * places).tolist()))


@check("contract", {"mapper"}, "After clear, what the newest data show to be gone goes from the map.")
def clears(bench: Bench) -> Iterator[Finding]:
    """A box stands in a room for 20 readings, and is gone when the map is cleared."""
    cls = bench.subject.thing
    if cls.needs_map or not any(issubclass(one, kind) for kind in cls.accepts for one in (RangeScan, Sweep)):
        raise NotRun("it draws no map of readings")
    before, after = _at_box(bench, is_there=True)
    never_before, never_after = _at_box(bench, is_there=False)
    # Compared with a room that never had the box, since a mapper may draw something there anyway.
    drawn, kept = before - never_before, after - never_after
    if drawn < FEWEST_CELLS:
        raise NotRun(f"it does not draw a box that it sees {WITH} times")
    if kept > STAY * drawn:
        yield Finding(
            f"keeps {kept} of the {drawn} occupied cells of a box that is gone when the map is cleared",
            "with given.clear, to forget what the newest data or the next can show again",
            given="a stopped robot in a room, and a box 1.2 m ahead that is taken away", scene=bench.sound()[0].name,
        )  # fmt: skip


def _at_box(bench: Bench, *, is_there: bool) -> tuple[int, int]:
    """Occupied cells of a map at the place of a box, before the map is cleared and at the end.

    Args:
        bench: The mapper.
        is_there: The box stands there before the map is cleared.
    """
    room, scene = scenes.room(), bench.sound()[0]
    full = replace(room, obstacles=(*room.obstacles, BOX))
    sees = [any(issubclass(message, kind) for kind in bench.subject.thing.accepts) for message in (RangeScan, Sweep)]
    # 4 more: the track must reach the last step, which is 1.5 s after its reading.
    stamps = [k * SECOND for k in range(WITH + WITHOUT + 4)]
    track = messages.track([(0.0, 0.0, 0.0)] * len(stamps), stamps)
    occupied = [0, 0]
    with alike():
        player = bench.player(scene)
        for k, stamp in enumerate(stamps[: WITH + WITHOUT]):
            world = full if k < WITH and is_there else room
            scans = [messages.scan(world, stamp=stamp)] * sees[0]
            sweeps = [messages.sweep(world, request_id=k + 1, stamp=stamp)] * sees[1]
            answer = player.step(builders.mapper_input(
                *scans, *sweeps, track=track, clear=k == WITH, stamp=stamp + 1.5, extra=scene.inputs[0].extra
            ))  # fmt: skip
            if isinstance(answer, MapUpdate):
                occupied[k >= WITH] = _near(answer, BOX)
    return occupied[0], occupied[1]


def _near(update: MapUpdate, box: Box) -> int:
    """Number of occupied cells at a box."""
    places = places_of(update.grid, np.argwhere(update.grid.cells >= OCCUPIED))
    low, high = np.array([box.x[0], box.y[0]]) - 0.1, np.array([box.x[1], box.y[1]]) + 0.1
    return int(((places >= low) & (places <= high)).all(axis=1).sum())


CHECKS = (goes_on, answers_stay, map_lasts, clears)

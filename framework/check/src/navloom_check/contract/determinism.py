"""The same inputs give the same answers in any process, with any clock, global seeds and earlier episodes."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from navloom_check.check_bench import Bench, alike
from navloom_check.check_scenes import PlayedScene, made_scenes
from navloom_check.checks import PLAYED, check
from navloom_check.findings import Finding, NotRun
from navloom_check.plugin_player import Fault, digest, first_difference, loosened, through_codec
from navloom_check.worker_process import digests_of

__all__ = ["CHECKS"]

HASH_SEEDS = (4242, 99)
"""PYTHONHASHSEED of the fresh processes; with a single one, a small set of strings may keep its order by chance."""
ORDERED_BY_HASH = frozenset({"set", "frozenset", "hash", "id"})
FEW = 5
"""Steps of the short episode between two resets."""
STREAM = "random numbers only from self.context.stream('name')"
IN_SELF = "state only in self: no module or class variable that a call changes"


@check("contract", PLAYED, "Two new objects give the same answers to the same inputs.")
def repeats(bench: Bench) -> Iterator[Finding]:
    """Nothing is varied, so random numbers without a seed show here. `episodes` reports state outside the object."""
    found = bench.unrepeated
    if found is not None and not _is_state(bench):
        yield replace(found, expected=STREAM)


@check("contract", PLAYED, "An episode does not affect later objects of the plugin.")
def episodes(bench: Bench) -> Iterator[Finding]:
    """Every scene was played once already; each is played twice more."""
    if bench.unrepeated is not None:
        if not _is_state(bench):
            raise NotRun("answers to the same inputs differ anyway: see the check `repeats`")
        yield replace(bench.unrepeated, expected=IN_SELF)
        return
    found = bench.first_that_differs(
        (scene for scene in bench.steady() for _ in range(2)), bench.play, "scene {} after other episodes",
        "after other episodes in the same process", IN_SELF,
    )  # fmt: skip
    if found is not None:
        yield found


def _is_state(bench: Bench) -> bool:
    """Whether plays differ because earlier plays left state: a fresh process then repeats the very first play."""
    first = bench.sound()[0]
    theirs = digests_of(bench.request, 0, {first.name: len(first.inputs)}, alike=True)
    return first_difference(bench.answers(first), theirs.get(first.name, [])) is None


def _refuse_unrepeated(bench: Bench) -> None:
    if bench.unrepeated is not None:
        raise NotRun("answers to the same inputs differ anyway: see the checks `repeats` and `episodes`")


@check("contract", PLAYED, "Answers do not depend on the global random seeds.")
def global_random(bench: Bench) -> Iterator[Finding]:
    """The global generators of `random` and `numpy.random` get other seeds."""
    _refuse_unrepeated(bench)
    if bench.led_by_seeds is not None:
        yield replace(bench.led_by_seeds, expected=STREAM)


@check("contract", PLAYED, "Answers do not depend on the wall clock.")
def wall_clock(bench: Bench) -> Iterator[Finding]:
    """The plugin sees a different clock, which moves in jumps."""
    _refuse_unrepeated(bench)
    if bench.led_by_clock is not None:
        yield replace(bench.led_by_clock, expected="time only from the stamps of the input")


@check("contract", PLAYED, "A fresh process with another PYTHONHASHSEED, clock and seeds gives the same answers.")
def fresh_process(bench: Bench) -> Iterator[Finding]:
    """Finds what one process cannot show: order of sets, addresses, seeds that a library draws on import."""
    scenes = bench.steady()
    steps = {scene.name: len(scene.inputs) for scene in scenes}
    for hash_seed in HASH_SEEDS if _has_sets(bench) else HASH_SEEDS[:1]:
        theirs = digests_of(bench.request, hash_seed, steps)
        for scene in scenes:
            step = first_difference(bench.answers(scene), theirs.get(scene.name, []))
            if step is not None:
                given = bench.at(scene, step)
                if _is_by_order(bench, scene, hash_seed):
                    what = "gives another answer in a process in which other scenes were played before"
                    yield Finding(what, IN_SELF, given=given, scene=scene.name)
                else:
                    what = "gives another answer in a fresh process with another PYTHONHASHSEED"
                    expected = "answers that do not depend on the order of sets, on hash() or id()"
                    yield Finding(what, expected, given=given, scene=scene.name)
                return


def _has_sets(bench: Bench) -> bool:
    """Whether the plugin has sets of more than one, or calls hash() or id(): each seed takes a process."""
    files = [str(getattr(module, "__file__", None)) for name, module in list(sys.modules.items())
             if bench.subject.is_own(name)]  # fmt: skip
    if not files or not all(file.endswith(".py") for file in files):
        return True  # its code cannot be read
    nodes = [node for file in files for node in ast.walk(ast.parse(Path(file).read_bytes()))]
    return any(
        isinstance(node, ast.SetComp) or (isinstance(node, ast.Set) and len(node.elts) > 1)
        or (isinstance(node, ast.Name) and node.id in ORDERED_BY_HASH)
        for node in nodes
    )  # fmt: skip


def _is_by_order(bench: Bench, scene: PlayedScene, hash_seed: int) -> bool:
    """Whether earlier scenes made a scene's answers differ: played alone, it gives the same with any hash seed."""
    alone = [digests_of(bench.request, seed, {scene.name: len(scene.inputs)}) for seed in (hash_seed, 0)]
    return alone[0] == alone[1]


@check("contract", PLAYED, "reset() gives the state of a new object.")
def reset_as_new(bench: Bench) -> Iterator[Finding]:
    """Play a scene and reset the object; play a few steps and reset again; then play the scene again."""

    def again(scene: PlayedScene) -> list[bytes]:
        with alike():
            player = bench.player(scene)
            player.play(scene.inputs)
            player.reset()
            player.play(scene.inputs[:FEW])
        with alike():
            player.reset()
            return player.play(scene.inputs)

    found = bench.first_that_differs(
        bench.steady(), again, "reset() after scene {}, and the scene again", "after reset() than a new object does",
        "reset() that forgets everything learnt since construction",
    )  # fmt: skip
    if found is not None:
        yield found


@check("contract", PLAYED, "It does not change its inputs.")
def inputs_untouched(bench: Bench) -> Iterator[Finding]:
    """The plugin gets writable inputs, which are compared afterwards.

    The scenes are generated again, since a plugin that writes to its inputs has already changed those of earlier plays.
    """
    for scene in made_scenes(bench.subject, bench.seed):
        try:
            with alike():
                player = bench.player(scene)
                for step, given in enumerate(scene.inputs):
                    loose = loosened(given)
                    before = digest(loose)
                    player.step(loose)
                    if digest(loose) != before:
                        yield Finding("changes its inputs", "a copy, np.array(…), before it writes",
                                      given=bench.at(scene, step), scene=scene.name)  # fmt: skip
                        return
        except Fault:
            continue


@check("contract", PLAYED, "Answers are the same if the inputs were encoded and decoded, as between processes.")
def through_the_codec(bench: Bench) -> Iterator[Finding]:
    """Decoding makes new objects, which shows comparisons by identity."""

    def again(scene: PlayedScene) -> list[bytes]:
        with alike():
            return bench.player(scene).play(through_codec(given) for given in scene.inputs)

    found = bench.first_that_differs(
        bench.steady(), again, "scene {}, with decoded messages", "to the same inputs from another process",
        "answers that depend on contents, not on the identity of messages",
    )  # fmt: skip
    if found is not None:
        yield found


CHECKS = (
    repeats, episodes, global_random, wall_clock, fresh_process, reset_as_new, inputs_untouched, through_the_codec,
)  # fmt: skip

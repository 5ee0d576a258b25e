"""What a check works with: the plugin, its scenes, and plays of them under known conditions."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from time import perf_counter, thread_time

import numpy as np
from navloom.plugins.registry import NODE

from navloom_check.check_scenes import PlayedScene, made_scenes
from navloom_check.checked_plugin import CheckRequest, Subject
from navloom_check.findings import Finding, NotRun
from navloom_check.node_player import NodePlayer
from navloom_check.plugin_player import Fault, Player, first_difference
from navloom_check.side_effects import GUARD, Deed

__all__ = ["CLOCK", "OTHER_CLOCK", "OTHER_SEEDS", "USUAL", "Bench", "alike"]

USUAL = "usual"
CLOCK = (1_700_000_000.0, 0.001)
"""Start of the clock that plugins see, s, and its advance with each reading, s; the same in every play."""
# In jumps of seconds: a plugin that compares two readings then sees a duration that no run has.
OTHER_CLOCK = (1_900_000_000.0, 7.3)
OTHER_SEEDS = 4711
PLAY_TIME = 2.0
"""Longest play of all scenes, s: scenes of slower plugins are cut to fewer steps."""
STEPS_OF_SLOW = 10
"""Steps of each remaining scene once the plays of the others have taken that long."""
FEWEST_STEPS = 4


class Bench:
    """One plugin with its scenes.

    Attributes:
        subject: The plugin.
        request: The request for its checks.
        seed: Seed of everything random.
        out: Folder for pictures; None if none are wanted.
        first_step: Processor time of the first step in this process, s.
    """

    def __init__(self, subject: Subject, request: CheckRequest, out: Path | None = None) -> None:
        self.subject, self.request, self.seed, self.out = subject, request, request.seed, out
        self._scenes = made_scenes(subject, self.seed)
        self._plays: dict[str, list[bytes] | tuple[Fault, int]] = {}
        # Of a process, not an object: kernels compile once, in the first step of all.
        self.first_step = 0.0

    @property
    def scenes(self) -> tuple[PlayedScene, ...]:
        """Every scene of the plugin's kind, each already played once. Scenes of slow plugins are cut short."""
        if not self._plays:
            begun = perf_counter()
            kept = []
            for scene in self._scenes:
                is_late = perf_counter() - begun > PLAY_TIME
                kept.append(replace(scene, inputs=scene.inputs[:STEPS_OF_SLOW]) if is_late else scene)
                self._plays[scene.name] = self._first_play(kept[-1])
            self._scenes = tuple(kept)
            # Every check plays the scenes again, so those of a slow plugin are cut.
            self._cut_to(PLAY_TIME / (perf_counter() - begun))
        return self._scenes

    def player(self, scene: PlayedScene, params: object = None) -> Player:
        """A new object of the plugin for a scene. Raises Fault."""
        kind = NodePlayer if self.subject.kind == NODE else Player
        return kind(self.subject, scene.context, self.seed, params)

    def play(
        self, scene: PlayedScene, params: object = None, *, seeds: int = 1, clock: tuple[float, float] = CLOCK
    ) -> list[bytes]:
        """Hashes of the answers of a new object to a scene, under the usual conditions or others. Raises Fault."""
        with alike(seeds, clock):
            return self.player(scene, params).play(scene.inputs)

    def base(self, scene: PlayedScene) -> list[bytes] | tuple[Fault, int]:
        """Hashes of the answers in the first play of a scene; or its fault, and the step at which it occurred."""
        return self._plays[scene.name]

    def answers(self, scene: PlayedScene) -> list[bytes]:
        """Hashes of the answers in the first play of a sound scene."""
        base = self.base(scene)
        # `sound` has sorted out the scenes with a fault.
        assert isinstance(base, list)
        return base

    def of_topic(self, *topics: str) -> list[PlayedScene]:
        """Scenes of some topics."""
        return [scene for scene in self.scenes if scene.topic in topics]

    def sound(self, *topics: str) -> list[PlayedScene]:
        """Scenes of some topics, by default the usual ones, that the plugin plays to their end.

        Raises:
            NotRun: There is none.
        """
        scenes = [scene for scene in self.of_topic(*(topics or (USUAL,))) if isinstance(self.base(scene), list)]
        if not scenes:
            raise NotRun("it plays no scene to its end: see the check `answers`")
        return scenes

    def steady(self) -> list[PlayedScene]:
        """Sound scenes, for checks that compare plays.

        Raises:
            NotRun: There is none, or answers differ between plays even without the cause that the check varies.
        """
        scenes = self.sound()
        for name, found in (
            ("repeats", self.unrepeated), ("global_random", self.led_by_seeds), ("wall_clock", self.led_by_clock),
        ):  # fmt: skip
            if found is not None:
                # Otherwise every check that compares plays would fail too, and hide the cause.
                raise NotRun(f"answers to the same inputs differ anyway: see the check `{name}`")
        return scenes

    @cached_property
    def unrepeated(self) -> Finding | None:
        """The first scene whose second play differs from the first."""
        return self._difference("in a second play of the same inputs", 1, CLOCK)

    @cached_property
    def led_by_seeds(self) -> Finding | None:
        """The first scene whose answers change with the global random seeds."""
        when = "when random and numpy.random are seeded differently"
        return self._difference(when, OTHER_SEEDS, CLOCK)

    @cached_property
    def led_by_clock(self) -> Finding | None:
        """The first scene whose answers change with the clock, which then moves in jumps."""
        # The guard counts for the whole process, earlier plays included.
        GUARD.deeds.clear()
        found = self._difference("when the wall clock shows another time", 1, OTHER_CLOCK)
        reading = next((deed for deed in GUARD.deeds if deed.kind == "clock"), None)
        return replace(found, place=reading.place) if found is not None and reading is not None else found

    @cached_property
    def deeds(self) -> dict[str, tuple[Deed, PlayedScene]]:
        """Side effects of the plugin: the first of each kind in a play of all scenes, and its scene."""
        found: dict[str, tuple[Deed, PlayedScene]] = {}
        for scene in self.scenes:
            GUARD.deeds.clear()
            # A fault is the finding of another check; what the plugin did until then still counts.
            with suppress(Fault):
                self.play(scene)
            for deed in GUARD.deeds:
                found.setdefault(deed.kind, (deed, scene))
        return found

    def differs(
        self, scene: PlayedScene, given: Sequence[bytes], when: str, expected: str, place: str = ""
    ) -> Finding | None:
        """A finding if a play of a scene differs from its first play."""
        step = first_difference(self.answers(scene), list(given))
        if step is None:
            return None
        return Finding(f"gives another answer {when}", expected, place, self.at(scene, step), scene.name)

    def first_that_differs(
        self,
        scenes: Iterable[PlayedScene],
        play: Callable[[PlayedScene], list[bytes]],
        given: str,
        when: str,
        expected: str,
    ) -> Finding | None:
        """A finding for the first scene whose play differs from its first play or has a fault; None if there is none.

        Args:
            scenes: Sound scenes.
            play: The answers of another play; may raise Fault.
            given: What the plugin was given when it failed, with {} for the scene's name.
            when, expected: As of `differs`.
        """
        for scene in scenes:
            try:
                again = play(scene)
            except Fault as fault:
                return self.finding(fault, given.format(repr(scene.name)), scene.name)
            found = self.differs(scene, again, when, expected)
            if found is not None:
                return found
        return None

    def at(self, scene: PlayedScene, step: int) -> str:
        """A step of a scene, in words."""
        return f"scene {scene.name!r}, step {step} of {len(scene.inputs)}"

    def finding(self, fault: Fault, given: str, scene: str = "") -> Finding:
        """The finding for a fault."""
        return Finding(fault.problem, fault.expected, fault.place, given, scene)

    def _difference(self, when: str, seeds: int, clock: tuple[float, float]) -> Finding | None:
        return self.first_that_differs(
            self.sound(), lambda scene: self.play(scene, seeds=seeds, clock=clock), f"scene {{}}, {when}", when,
            "the same answer",
        )  # fmt: skip

    def _first_play(self, scene: PlayedScene) -> list[bytes] | tuple[Fault, int]:
        answers: list[bytes] = []
        with alike():
            try:
                player = self.player(scene)
                for given in scene.inputs:
                    before = thread_time()
                    answers += player.play([given])
                    # Processor time: other processes of the machine do not count against the plugin.
                    self.first_step = self.first_step or thread_time() - before
            except Fault as fault:
                return fault, len(answers)
        return answers

    def _cut_to(self, share: float) -> None:
        """Cut the sound scenes to a share of their steps, if it is below 1."""
        if share >= 1.0:
            return
        cut = []
        for scene in self._scenes:
            base = self._plays[scene.name]
            if isinstance(base, list):
                steps = max(FEWEST_STEPS, int(share * len(scene.inputs)))
                self._plays[scene.name], scene = base[:steps], replace(scene, inputs=scene.inputs[:steps])
            cut.append(scene)
        self._scenes = tuple(cut)


@contextmanager
def alike(seeds: int = 1, clock: tuple[float, float] = CLOCK) -> Iterator[None]:
    """Conditions that are the same in every play: the global random seeds, and the clock that a plugin sees."""
    random.seed(seeds)
    np.random.seed(seeds)  # noqa: NPY002  (a plugin must not use it; the seed makes its use show)
    with GUARD.clock(*clock):
        yield

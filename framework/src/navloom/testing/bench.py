"""What a check works with: the plugin, its scenes, and plays of them under known conditions."""

from __future__ import annotations

import random
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path

import numpy as np

from navloom.testing.findings import Finding, NotRun
from navloom.testing.guard import GUARD
from navloom.testing.inputs import Scene, made_scenes
from navloom.testing.player import Fault, Player, first_difference
from navloom.testing.subject import Request, Subject

__all__ = ["CLOCK", "USUAL", "Bench", "alike"]

USUAL = "usual"
CLOCK = (1_700_000_000.0, 0.001)
"""Where the clock that plugins see begins, s, and how it moves with each look at it: alike in every play."""


class Bench:
    """One plugin on the bench.

    Attributes:
        subject: The plugin.
        request: How it was asked for.
        seed: Of everything random.
        out: Folder for pictures; None where none are wanted.
    """

    def __init__(self, subject: Subject, request: Request, out: Path | None = None) -> None:
        self.subject, self.request, self.seed, self.out = subject, request, request.seed, out
        self._plays: dict[str, list[bytes] | tuple[Fault, int]] = {}

    @cached_property
    def scenes(self) -> tuple[Scene, ...]:
        """Every scene of the plugin's kind."""
        return made_scenes(self.subject, self.seed)

    def player(self, scene: Scene, params: object = None) -> Player:
        """A new object of the plugin for a scene. Raises Fault."""
        return Player(self.subject, scene.context, self.seed, params)

    def play(self, scene: Scene, params: object = None) -> list[bytes]:
        """The answers of a new object to a scene, under the conditions of every play. Raises Fault."""
        with alike():
            return self.player(scene, params).play(scene.inputs)

    def base(self, scene: Scene) -> list[bytes] | tuple[Fault, int]:
        """The answers of the first object that played a scene; or the fault, and the step at which it showed."""
        if scene.name not in self._plays:
            self._plays[scene.name] = self._first_play(scene)
        return self._plays[scene.name]

    def answers(self, scene: Scene) -> list[bytes]:
        """The answers of the first play of a scene that went well."""
        base = self.base(scene)
        assert isinstance(base, list)
        return base

    def of_topic(self, *topics: str) -> list[Scene]:
        """Scenes of some topics."""
        return [scene for scene in self.scenes if scene.topic in topics]

    def sound(self, *topics: str) -> list[Scene]:
        """Scenes of some topics, default the usual, that the plugin plays to their end.

        Raises:
            NotRun: There is none.
        """
        scenes = [scene for scene in self.of_topic(*(topics or (USUAL,))) if isinstance(self.base(scene), list)]
        if not scenes:
            raise NotRun("it plays no scene to its end: see the check `answers`")
        return scenes

    def differs(
        self, scene: Scene, given: Sequence[bytes], when: str, expected: str, place: str = ""
    ) -> Finding | None:
        """What to say where a play differs from the first one; None where it does not."""
        step = first_difference(self.answers(scene), list(given))
        if step is None:
            return None
        return Finding(f"gives another answer {when}", expected, place, self.at(scene, step), scene.name)

    def at(self, scene: Scene, step: int) -> str:
        """A place in a scene, in words."""
        return f"scene {scene.name!r}, step {step} of {len(scene.inputs)}"

    def finding(self, fault: Fault, given: str, scene: str = "") -> Finding:
        """What to say of a fault."""
        return Finding(fault.problem, fault.expected, fault.place, given, scene)

    def _first_play(self, scene: Scene) -> list[bytes] | tuple[Fault, int]:
        answers: list[bytes] = []
        with alike():
            try:
                player = self.player(scene)
                for given in scene.inputs:
                    answers += player.play([given])
            except Fault as fault:
                return fault, len(answers)
        return answers


@contextmanager
def alike(seeds: int = 1, clock: tuple[float, float] = CLOCK) -> Iterator[None]:
    """Conditions that are the same in every play: the global random seeds, and the clock that a plugin sees."""
    random.seed(seeds)
    np.random.seed(seeds)  # noqa: NPY002  (what a plugin must not use is put where it shows)
    with GUARD.clock(*clock):
        yield

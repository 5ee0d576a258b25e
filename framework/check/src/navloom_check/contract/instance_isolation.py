"""A plugin keeps its state in its object alone, so that instances and threads do not affect each other."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import PurePath
from threading import Thread
from types import FrameType
from typing import Any

from navloom_check.check_bench import Bench, alike
from navloom_check.check_scenes import PlayedScene
from navloom_check.checks import PLAYED, check
from navloom_check.contract.determinism import IN_SELF
from navloom_check.findings import Finding
from navloom_check.plugin_player import Fault, Player, digest, first_difference

__all__ = ["CHECKS"]

MOST_SWITCHES = 150
"""Most lines of a plugin's code at which another instance makes a step."""
TRACED_STEPS = 3
LOCKED = 0.5
"""Longest wait for a step of the other instance, s; a step that takes longer is taken to wait for a lock."""
SWITCH_INTERVAL = 1e-5
"""Interval between thread switches, s."""

_Line = tuple[str, int]
"""File and line number."""


@check("contract", PLAYED, "Two instances that step in turn do not affect each other.")
def two_instances(bench: Bench) -> Iterator[Finding]:
    """An active instance and its shadow step in this way."""
    scenes = bench.steady()
    for scene, other in zip(scenes, [*scenes[1:], scenes[0]], strict=True):
        mine: list[bytes] = []
        with alike():
            try:
                first, second = bench.player(scene), bench.player(other)
                for step, given in enumerate(scene.inputs):
                    mine.append(digest(first.step(given)))
                    if step < len(other.inputs):
                        second.step(other.inputs[step])
            except Fault as fault:
                yield bench.finding(fault, f"scenes {scene.name!r} and {other.name!r} in turn", scene.name)
                return
        found = bench.differs(scene, mine, "when another instance steps in turn", IN_SELF)
        if found:
            yield found
            return


@check("contract", PLAYED, "Two instances can step at the same time, in two threads.")
def threads(bench: Bench) -> Iterator[Finding]:
    """First another instance steps at each line of a step, then both run freely."""
    scenes = bench.steady()
    one, other = scenes[0], scenes[-1]
    yield from _switched(bench, one, other)
    yield from _free(bench, one, other)


def _switched(bench: Bench, played_scene: PlayedScene, other: PlayedScene) -> Iterator[Finding]:
    """Step one instance; at each line of its code, step another in a separate thread."""
    between = _Between(bench, played_scene, other)
    found = between.differs(None)
    if found is not None:
        guilty = next((line for line in sorted(between.seen) if between.differs(line) is not None), None)
        yield found if guilty is None else replace(found, place=f"{PurePath(guilty[0]).name}:{guilty[1]}")


class _Between:
    """Steps a second instance while the first is at a given line of its code, or at each new line."""

    def __init__(self, bench: Bench, played_scene: PlayedScene, other: PlayedScene) -> None:
        self.bench, self.one, self.other = bench, played_scene, other
        self.seen: set[_Line] = set()
        self._at: _Line | None = None
        self._passed: set[_Line] = set()
        self._second: Player
        self._stepped = 0

    def differs(self, at: _Line | None) -> Finding | None:
        """A finding if steps of the second instance change the first answers of the first one.

        Args:
            at: The line at which the second instance steps; None for each new line.
        """
        self._at, self._passed, self._stepped = at, set(), 0
        answers: list[bytes] = []
        with alike():
            try:
                first, self._second = self.bench.player(self.one), self.bench.player(self.other)
                for given in self.one.inputs[:TRACED_STEPS]:
                    answers.append(digest(self._traced(first, given)))
            except Fault as fault:
                given = f"scene {self.one.name!r}, while another instance steps"
                return self.bench.finding(fault, given, self.one.name)
        step = first_difference(self.bench.answers(self.one)[: len(answers)], answers)
        if step is None:
            return None
        problem = "gives another answer when another instance steps in the middle of its step"
        return Finding(problem, IN_SELF, "", self.bench.at(self.one, step), self.one.name)

    def _traced(self, player: Player, given: Any) -> Any:
        before = sys.gettrace()
        sys.settrace(self._trace)
        try:
            return player.step(given)
        finally:
            sys.settrace(before)

    def _trace(self, frame: FrameType, event: str, given: Any) -> Callable[..., Any] | None:
        if not self.bench.subject.is_own(str(frame.f_globals.get("__name__", ""))):
            return None
        line = (frame.f_code.co_filename, frame.f_lineno)
        is_due = line == self._at if self._at is not None else len(self.seen) < MOST_SWITCHES
        if event == "line" and is_due and line not in self._passed:
            self._passed.add(line)
            self.seen.add(line)
            thread = Thread(target=self._step, daemon=True)
            thread.start()
            thread.join(LOCKED)
        return self._trace

    def _step(self) -> None:
        given = self.other.inputs[self._stepped % len(self.other.inputs)]
        self._stepped += 1
        with suppress(Fault):
            self._second.step(given)


def _free(bench: Bench, played_scene: PlayedScene, other: PlayedScene) -> Iterator[Finding]:
    """Play two instances at the same time, each in its own thread."""
    answers: dict[str, list[bytes] | Fault] = {}

    def play(name: str, scene: PlayedScene) -> None:
        try:
            answers[name] = bench.player(scene).play(scene.inputs)
        except Fault as fault:
            answers[name] = fault

    before = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_INTERVAL)
    try:
        with alike():
            both = [Thread(target=play, args=pair, daemon=True) for pair in (("one", played_scene), ("other", other))]
            for thread in both:
                thread.start()
            for thread in both:
                thread.join()
    finally:
        sys.setswitchinterval(before)
    for name, scene in (("one", played_scene), ("other", other)):
        got = answers[name]
        if isinstance(got, Fault):
            yield bench.finding(got, f"scene {scene.name!r}, while another thread plays another instance", scene.name)
            return
        found = bench.differs(scene, got, "while another thread plays another instance", IN_SELF)
        if found:
            yield found
            return


CHECKS = (two_instances, threads)

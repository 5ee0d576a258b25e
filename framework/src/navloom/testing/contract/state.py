"""Where a plugin keeps its state: in its object alone, so that episodes, instances and threads do not meet."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import PurePath
from threading import Thread
from types import FrameType
from typing import Any

from navloom.testing.bench import Bench, alike
from navloom.testing.checks import check
from navloom.testing.contract.kinds import PLAYED
from navloom.testing.findings import Finding
from navloom.testing.inputs import Scene
from navloom.testing.player import Fault, Player, bytes_of, first_difference

__all__ = ["CHECKS"]

IN_SELF = "state in self alone: no module or class variable that a call changes"
MOST_SWITCHES = 150
"""Lines of a plugin's code at most at which another instance steps in between."""
LOCKED = 0.5
"""How long another instance may take for a step, s, before it counts as waiting for a lock."""
SWITCH_INTERVAL = 1e-5
"""Between two switches of threads, s."""


@check("contract", PLAYED, "An episode leaves nothing behind that a later object of the plugin sees.")
def episodes(bench: Bench) -> Iterator[Finding]:
    """The first scene is played again after all others, each of which ran twice."""
    scenes = bench.sound()
    for scene in scenes:
        try:
            with alike():
                bench.player(scene).play(scene.inputs)
        except Fault as fault:
            yield bench.finding(fault, f"a second episode of scene {scene.name!r}", scene.name)
            return
    for scene in scenes:
        try:
            again = bench.play(scene)
        except Fault as fault:
            yield bench.finding(fault, f"scene {scene.name!r} after {2 * len(scenes)} other episodes", scene.name)
            return
        found = bench.differs(scene, again, "after other episodes in the same process", IN_SELF)
        if found:
            yield found
            return


@check("contract", PLAYED, "Two instances that step in turn do not see each other.")
def two_instances(bench: Bench) -> Iterator[Finding]:
    """As an active instance and a shadow do."""
    scenes = bench.sound()
    for one, other in zip(scenes, [*scenes[1:], scenes[0]], strict=True):
        mine: list[bytes] = []
        with alike():
            try:
                first, second = bench.player(one), bench.player(other)
                for step, given in enumerate(one.inputs):
                    mine.append(bytes_of(first.step(given)))
                    if step < len(other.inputs):
                        second.step(other.inputs[step])
            except Fault as fault:
                yield bench.finding(fault, f"scenes {one.name!r} and {other.name!r} in turn", one.name)
                return
        found = bench.differs(one, mine, "when another instance steps in turn", IN_SELF)
        if found:
            yield found
            return


@check("contract", PLAYED, "Two instances can step at the same time, in two threads.")
def threads(bench: Bench) -> Iterator[Finding]:
    """Another instance steps at each line of a step; then both run freely."""
    scenes = bench.sound()
    one, other = scenes[0], scenes[-1]
    yield from _switched(bench, one, other)
    yield from _free(bench, one, other)


def _switched(bench: Bench, one: Scene, other: Scene) -> Iterator[Finding]:
    """Steps of one instance, at the lines of which another makes a step in a thread of its own."""
    with alike():
        first, second = bench.player(one), bench.player(other)
    between = _Between(bench, second, other)
    mine: list[bytes] = []
    for given in one.inputs[:5]:
        with alike():
            try:
                mine.append(bytes_of(between.traced(first, given)))
            except Fault as fault:
                yield bench.finding(fault, f"scene {one.name!r}, while another instance steps", one.name)
                return
    step = first_difference(bench.answers(one)[: len(mine)], mine)
    if step is not None:
        yield Finding(
            "gives another answer when another instance steps in the middle of its step", IN_SELF,
            between.last_place, bench.at(one, step), one.name,
        )  # fmt: skip


class _Between:
    """Has an instance make a step at each new line that another runs through."""

    def __init__(self, bench: Bench, player: Player, scene: Scene) -> None:
        self.bench, self.player, self.scene = bench, player, scene
        self.seen: set[tuple[str, int]] = set()
        self.stepped = 0
        self.last_place = ""

    def traced(self, player: Player, given: Any) -> Any:
        """A step of a player, with steps of the other between its lines."""
        before = sys.gettrace()
        sys.settrace(self._trace)
        try:
            return player.step(given)
        finally:
            sys.settrace(before)

    def _trace(self, frame: FrameType, event: str, given: Any) -> Callable[..., Any] | None:
        if not self.bench.subject.is_own(str(frame.f_globals.get("__name__", ""))):
            return None
        place = (frame.f_code.co_filename, frame.f_lineno)
        if event == "line" and place not in self.seen and len(self.seen) < MOST_SWITCHES:
            self.seen.add(place)
            self.last_place = f"{PurePath(place[0]).name}:{place[1]}"
            thread = Thread(target=self._step, daemon=True)
            thread.start()
            thread.join(LOCKED)
        return self._trace

    def _step(self) -> None:
        given = self.scene.inputs[self.stepped % len(self.scene.inputs)]
        self.stepped += 1
        try:
            self.player.step(given)
        except Fault:
            return


def _free(bench: Bench, one: Scene, other: Scene) -> Iterator[Finding]:
    """Two threads, each with an instance of its own, that play at the same time."""
    answers: dict[str, list[bytes] | Fault] = {}

    def play(name: str, scene: Scene) -> None:
        try:
            answers[name] = bench.player(scene).play(scene.inputs)
        except Fault as fault:
            answers[name] = fault

    before = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_INTERVAL)
    try:
        with alike():
            both = [Thread(target=play, args=pair, daemon=True) for pair in (("one", one), ("other", other))]
            for thread in both:
                thread.start()
            for thread in both:
                thread.join()
    finally:
        sys.setswitchinterval(before)
    for name, scene in (("one", one), ("other", other)):
        got = answers[name]
        if isinstance(got, Fault):
            yield bench.finding(got, f"scene {scene.name!r}, while another thread plays another instance", scene.name)
            return
        found = bench.differs(scene, got, "while another thread plays another instance", IN_SELF)
        if found:
            yield found
            return


CHECKS = (episodes, two_instances, threads)

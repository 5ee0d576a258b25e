"""The same inputs give the same answers: whatever the process, the clock, the global seeds and the episodes before."""

from __future__ import annotations

from collections.abc import Iterator
from hashlib import sha256

from navloom.testing.bench import CLOCK, Bench, alike
from navloom.testing.checks import check
from navloom.testing.contract.kinds import PLAYED
from navloom.testing.findings import Finding, NotRun
from navloom.testing.guard import GUARD
from navloom.testing.inputs import Scene
from navloom.testing.player import Fault, bytes_of, first_difference, loosened, through_codec
from navloom.testing.process import digests_of

__all__ = ["CHECKS"]

STREAM = "random numbers from self.context.stream('name') alone"


@check("contract", PLAYED, "Two new objects give the same answers to the same inputs.")
def repeats(bench: Bench) -> Iterator[Finding]:
    """Nothing is varied: unseeded random numbers show, and so does state outside the object."""
    for scene in bench.sound():
        yield from _compared(
            bench, scene, "in a second play of the same inputs", f"the same answer: {STREAM}, no state outside self"
        )


@check("contract", PLAYED, "Answers do not depend on the global random seeds.")
def global_random(bench: Bench) -> Iterator[Finding]:
    """`random` and legacy `numpy.random` are seeded differently."""
    for scene in bench.sound():
        yield from _compared(bench, scene, "when random and numpy.random are seeded differently", STREAM, seeds=4711)


@check("contract", PLAYED, "Answers do not depend on the wall clock.")
def wall_clock(bench: Bench) -> Iterator[Finding]:
    """The plugin sees another time, that moves in leaps."""
    for scene in bench.sound():
        GUARD.deeds.clear()
        found = list(
            _compared(bench, scene, "when the wall clock shows another time", "time from the input's stamps alone",
                      clock=(1_900_000_000.0, 7.3))
        )  # fmt: skip
        reading = next((deed for deed in GUARD.deeds if deed.kind == "clock"), None)
        for one in found:
            place = reading.place if reading is not None else one.place
            yield Finding(one.problem, one.expected, place, one.given, one.scene)


@check(
    "contract", PLAYED, "A fresh process with another PYTHONHASHSEED, clock and global seeds gives the same answers."
)
def fresh_process(bench: Bench) -> Iterator[Finding]:
    """Run after the checks that vary one thing each, so what they find is not told twice."""
    scenes = bench.sound()
    if any(True for one in (repeats, global_random, wall_clock) for _ in one.run(bench)):
        raise NotRun("answers differ within one process already: see repeats, global_random and wall_clock")
    theirs = digests_of(bench.request, 4242)
    for scene in scenes:
        ours = [sha256(one).hexdigest() for one in bench.answers(scene)]
        step = first_difference(ours, theirs.get(scene.name, []))
        if step is not None:
            yield Finding(
                "gives another answer in a fresh process with another PYTHONHASHSEED",
                "answers that do not depend on the order of sets, on hash() or id()", given=bench.at(scene, step),
                scene=scene.name,
            )  # fmt: skip
            return


@check("contract", PLAYED, "reset() gives the state of a new object.")
def reset_as_new(bench: Bench) -> Iterator[Finding]:
    """A scene is played, the object reset, and the scene played again."""
    for scene in bench.sound():
        with alike():
            player = bench.player(scene)
            player.play(scene.inputs)
        try:
            with alike():
                player.reset()
                again = player.play(scene.inputs)
        except Fault as fault:
            yield bench.finding(fault, f"reset() after scene {scene.name!r}, and the scene again", scene.name)
            return
        found = bench.differs(scene, again, "after reset() than a new object does",
                              "reset() that forgets everything learnt since construction")  # fmt: skip
        if found:
            yield found
            return


@check("contract", PLAYED, "What it is given is not changed.")
def inputs_untouched(bench: Bench) -> Iterator[Finding]:
    """It is handed inputs that can be written to, and they are compared afterwards."""
    for scene in bench.scenes:
        with alike():
            player = bench.player(scene)
            for step, given in enumerate(scene.inputs):
                loose = loosened(given)
                before = bytes_of(loose)
                try:
                    player.step(loose)
                except Fault:
                    break
                if bytes_of(loose) != before:
                    yield Finding("changes what it was given", "a copy of its own: np.array(…) before writing",
                                  given=bench.at(scene, step), scene=scene.name)  # fmt: skip
                    return


@check("contract", PLAYED, "Answers are the same when the inputs went through the codec, as between processes.")
def through_the_codec(bench: Bench) -> Iterator[Finding]:
    """What is compared by identity, or kept from step to step, is another object then."""
    for scene in bench.sound():
        with alike():
            try:
                again = bench.player(scene).play(through_codec(given) for given in scene.inputs)
            except Fault as fault:
                yield bench.finding(fault, f"scene {scene.name!r}, with decoded messages", scene.name)
                return
        found = bench.differs(scene, again, "to the same inputs from another process",
                              "answers that depend on contents, not on the identity of messages")  # fmt: skip
        if found:
            yield found
            return


def _compared(
    bench: Bench, scene: Scene, when: str, expected: str, seeds: int = 1, clock: tuple[float, float] = CLOCK
) -> Iterator[Finding]:
    """One more play under other conditions, against the first."""
    with alike(seeds, clock):
        try:
            again = bench.player(scene).play(scene.inputs)
        except Fault as fault:
            yield bench.finding(fault, f"scene {scene.name!r}, {when}", scene.name)
            return
    found = bench.differs(scene, again, when, expected)
    if found:
        yield found


CHECKS = (repeats, global_random, wall_clock, fresh_process, reset_as_new, inputs_untouched, through_the_codec)

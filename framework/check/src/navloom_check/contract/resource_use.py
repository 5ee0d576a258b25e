"""What a plugin does besides answering: time, memory, output, threads, files."""

from __future__ import annotations

import gc
import itertools
import os
import threading
import tracemalloc
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path, PurePath
from time import perf_counter, process_time
from typing import Any

import numpy as np
from navloom.messages import Message, Twist2D
from navloom.roles import ROLES, PlatformOutput, RobotSpec

from navloom_check.captured_output import PRINTED
from navloom_check.check_bench import Bench, alike
from navloom_check.check_scenes import PERIOD, PlayedScene
from navloom_check.checks import PLAYED, check
from navloom_check.findings import Finding, NotRun
from navloom_check.plugin_player import Fault, size_of
from navloom_check.shifted_inputs import nudged, restamped

__all__ = ["CHECKS", "COMMANDING", "beyond"]

PLAYS = 3
"""Plays of each scene; the fastest time of each step counts, since the machine may be busy."""
MOST_LINES = 0.5
"""Most lines on standard error per step."""
COMMANDING = {role for role, cls in ROLES.items() if cls.facts.commands}
BEYOND = 1.5
SIDEWAYS = 1e-6
"""Speed to the side, m/s, above which a command is for another kind of robot."""
LONGEST_FIRST = 0.5
"""Longest first step, s; for a patient role, this share of the longest step."""
PATIENT = 1.0
"""Longest step of a patient role, s: its class says `is_patient`, since no motor waits for it."""
LARGEST, LARGEST_OF_PATIENT = 4 * 2**20, 16 * 2**20
"""Largest answer of a role that answers in each tick, and of a patient role, bytes."""
MEMORY_TIME = 3.0
"""Approximate duration of the memory check, s."""
FEWEST, FEW, MOST = 160, 1000, 4000
"""Fewest and most steps of the memory check, and those that are enough where nothing grows."""
GROWTH, GROWTH_OF_FEW = 48.0, 2048.0
"""Growth that is a leak, bytes a step: from 1000 steps on, and in fewer, when a bounded memory may still be filling."""
NATIVE_GROWTH = 8192.0
"""Growth of the process that is a leak in compiled code, bytes a step."""


@check("contract", PLAYED, "A step takes less than the control tick, or than 1 s for mappers, planners and recoveries.")
def step_time(bench: Bench) -> Iterator[Finding]:
    """Limit the 99th percentile of all steps after the first, each at its fastest of several plays, and the first."""
    limit = PATIENT if _is_patient(bench) else PERIOD
    scenes = bench.sound()
    first = bench.first_step
    for scene in scenes:
        begin, worst = _slowest(bench, scene, PLAYS)
        first = max(first, begin)
        if worst > limit:
            _, worst = _slowest(bench, scene, 2 * PLAYS)
        if worst > limit:
            yield Finding(
                f"takes {1000.0 * worst:.0f} ms for a step (99th percentile, fastest of {2 * PLAYS} plays)",
                f"less than {1000.0 * limit:.0f} ms; compile in warm_up, and vectorise or lower the resolution",
                given=f"scene {scene.name!r}", scene=scene.name,
            )  # fmt: skip
            return
    if first > LONGEST_FIRST * max(1.0, limit):
        yield Finding(f"takes {first:.1f} s for its first step", f"less than {LONGEST_FIRST:g} s; compile in warm_up, "
                      "and make tables when it is made")  # fmt: skip


def _is_patient(bench: Bench) -> bool:
    return bool(bench.subject.thing.is_patient)


def _slowest(bench: Bench, scene: PlayedScene, plays: int) -> tuple[float, float]:
    """Time of the first step of a scene, and 99th percentile of the others, s; each step at its fastest play."""
    times = []
    for _ in range(plays):
        with alike():
            player = bench.player(scene)
            spent = []
            for given in scene.inputs:
                before = perf_counter()
                player.step(given)
                spent.append(perf_counter() - before)
        times.append(spent)
    fastest = np.min(times, axis=0)
    late = fastest[1:] if len(fastest) > 1 else fastest
    return float(fastest[0]), float(np.percentile(late, 99.0, method="higher"))


@check("contract", PLAYED, "An answer is at most 4 MiB, a map or path at most 16 MiB, so that it arrives in time.")
def message_size(bench: Bench) -> Iterator[Finding]:
    """The encoded size counts."""
    limit = LARGEST_OF_PATIENT if _is_patient(bench) else LARGEST
    for scene in bench.sound():
        with alike():
            player = bench.player(scene)
            for step, given in enumerate(scene.inputs):
                answer = player.step(given)
                if (size := size_of(answer)) > limit:
                    yield Finding(
                        f"gives an answer of {size / 2**20:.1f} MiB{_largest(answer)}",
                        f"at most {limit / 2**20:.0f} MiB", given=bench.at(scene, step), scene=scene.name,
                    )  # fmt: skip
                    return


def _largest(answer: Any) -> str:
    """The largest field of an answer, as a phrase; empty if it has none."""
    if isinstance(answer, PlatformOutput):
        name = max(answer.scans, key=lambda scan: size_of(answer.scans[scan]), default="")
        return f", most of it from the sensor {name!r}" if name else ""
    sizes: list[tuple[int, str]] = []

    def look(message: Message, path: str) -> None:
        for name in message.kinds:
            value = getattr(message, name)
            if isinstance(value, np.ndarray):
                sizes.append((value.nbytes, path + name))
            elif isinstance(value, Message):
                look(value, f"{path}{name}.")

    look(answer, "")
    return f", most of it in {max(sizes)[1]}" if sizes else ""


@check("contract", COMMANDING, "On an easy course, no command exceeds 1.5 times the robot's limits, or "
       "leads to the side.")  # fmt: skip
def limits(bench: Bench) -> Iterator[Finding]:
    """The gate limits commands, so a small excess does no harm; degrees taken for radians are a large one."""
    for scene in bench.sound():
        if not scene.is_gentle:
            continue
        with alike():
            player = bench.player(scene)
            for step, given in enumerate(scene.inputs):
                over = beyond(player.step(given).twist, scene.context.robot)
                if over is not None:
                    yield Finding(*over, given=bench.at(scene, step), scene=scene.name)
                    return


def beyond(twist: Twist2D, robot: RobotSpec) -> tuple[str, str] | None:
    """Problem and expectation for a command far beyond the limits, or to the side; None if it is neither."""
    if abs(twist.vy) > SIDEWAYS and robot.drive != "holonomic":
        return f"commands vy = {twist.vy:.3g} m/s", "vy = 0: only a holonomic robot can drive to the side"
    for name, value, limit, unit, of in (
        ("vx", twist.vx, robot.max_linear, "m/s", "max_linear"),
        ("wz", twist.wz, robot.max_angular, "rad/s", "max_angular"),
    ):
        if abs(value) > BEYOND * limit:
            hint = "; are these degrees?" if name == "wz" and abs(value) > 5.0 * limit else ""
            return (
                f"commands {name} = {value:.3g} {unit}, {abs(value) / limit:.1f} times the limit{hint}",
                f"at most {limit:.3g} {unit}, which is self.context.robot.{of}",
            )
    return None


@check("contract", PLAYED, "It prints nothing on standard output, which belongs to the running command, and at most "
       "one line in two steps on standard error.")  # fmt: skip
def silent(bench: Bench) -> Iterator[Finding]:
    """Output of Python and of C code counts, also on import."""
    steps, before = 0, PRINTED.errors()
    for scene in bench.scenes:
        bench.base(scene)
        with suppress(Fault):
            bench.play(scene)
        steps += len(scene.inputs)
    text = PRINTED.news()
    lines = PRINTED.errors() - before
    if text.strip():
        first = text.strip().splitlines()[0][:80]
        yield Finding(f"prints {first!r}", "logging.getLogger(__name__), or the answer's diagnostics; no print()")
    elif lines > MOST_LINES * steps:
        yield Finding(f"prints {lines} lines on standard error in {steps} steps", "a line only when something "
                      "happens; for each step logging.getLogger(__name__).debug(…) or diagnostics")  # fmt: skip


@dataclass(frozen=True)
class _Rule:
    """A kind of side effect that no verb needs."""

    kind: str
    does: str
    expected: str


RULES = {
    "thread": _Rule("thread", "starts a thread", "no thread: the framework runs each node in one of its own"),
    "process": _Rule("process", "starts a process", "no process: a step does its work itself"),
    "file": _Rule("file", "writes a file", "no file: data to keep goes into messages"),
    "socket": _Rule("socket", "uses a socket", "no socket: outside data comes from a platform or a node"),
}


@check("contract", PLAYED - {"platform"}, "A step starts no thread.")
def no_threads(bench: Bench) -> Iterator[Finding]:
    """A platform that is a driver may."""
    yield from _deeds(bench, "thread")
    left = [
        thread.name for thread in threading.enumerate() if thread is not threading.main_thread() and not thread.daemon
    ]
    if left:
        yield Finding(f"leaves {len(left)} threads running: {', '.join(left[:3])}", RULES["thread"].expected)


@check("contract", PLAYED - {"platform"}, "A step starts no process and does not fork.")
def no_processes(bench: Bench) -> Iterator[Finding]:
    """A platform that is a driver may."""
    yield from _deeds(bench, "process")


@check("contract", PLAYED - {"platform"}, "A step writes no file, leaves none open and uses no socket.")
def no_files(bench: Bench) -> Iterator[Finding]:
    """A platform that is a driver may. Files that imports and compilers write do not count."""
    yield from _deeds(bench, "file")
    yield from _deeds(bench, "socket")
    left = _left_open(bench)
    if left:
        yield Finding(f"keeps {len(left)} files open: {', '.join(left[:3])}", "each file read and closed in the "
                      "constructor: with open(…) as file")  # fmt: skip


def _left_open(bench: Bench) -> list[str]:
    """Paths of the files that an object keeps open; files that only the first object opens do not count."""
    scene = bench.sound()[0]
    bench.play(scene)
    gc.collect()
    with alike():
        before = _open_files()
        player = bench.player(scene)
        player.play(scene.inputs)
        return [path for number, path in _open_files().items() if before.get(number) != path]


def _open_files() -> dict[str, str]:
    """Paths of the open files of this process, by descriptor."""
    found = {}
    for number in os.listdir("/proc/self/fd"):
        with suppress(OSError):  # the descriptor of the listing itself is closed by now
            found[number] = os.readlink(f"/proc/self/fd/{number}")
    return found


def _deeds(bench: Bench, kind: str) -> Iterator[Finding]:
    """The first side effect of a kind in the plays of all scenes."""
    if kind in bench.deeds:
        deed, scene = bench.deeds[kind]
        rule = RULES[kind]
        yield Finding(f"{rule.does} in a call: {deed.text}", rule.expected, deed.place, f"scene {scene.name!r}",
                      scene.name)  # fmt: skip


@check("contract", PLAYED, "Memory does not grow with the number of steps.")
def memory(bench: Bench) -> Iterator[Finding]:
    """Repeat a scene with new input objects, rising stamps and poses that differ a little, and measure the memory."""
    scene = bench.sound()[0]
    with alike():
        player = bench.player(scene)
        before = process_time()  # not wall time: a loaded host would leave too few steps to see a small leak
        player.play(scene.inputs)
        one_step = (process_time() - before) / len(scene.inputs)
    count = int(np.clip(MEMORY_TIME / max(one_step, 1e-6) / 3.0, FEWEST, MOST)) // 4 * 4
    # What does not grow in a few steps is done; what does may be a memory that is still filling.
    for steps in sorted({min(FEW, count), count}):
        held, resident, sizes, shot = _grown(bench, scene, steps)
        growth, native = (
            [4 * (late - early) / steps for early, late in itertools.pairwise(each)] for each in (held, resident)
        )
        limit = GROWTH if steps >= FEW else GROWTH_OF_FEW
        leaks = min(growth) > limit and growth[-1] > 0.5 * growth[0]
        if not leaks and min(native[1:]) <= NATIVE_GROWTH:
            return
    given = f"{count} steps of scene {scene.name!r}"
    if not leaks:
        yield Finding(
            f"takes {native[-1]:.0f} bytes more after each step, outside Python's memory",
            "compiled code that frees its memory", given=given, scene=scene.name,
        )  # fmt: skip
        return
    names = _growing(sizes, count // 4)
    if names and all(name.startswith("bounded ") for name in names):
        return
    what = f": {', '.join(names)} grows" if names else ""
    yield Finding(
        f"holds {growth[-1]:.0f} bytes more after each step{what}", "a bounded memory, as collections.deque(maxlen=…)",
        _line_that_holds(bench, shot), given, scene.name,
    )  # fmt: skip


def _grown(
    bench: Bench, scene: PlayedScene, steps: int
) -> tuple[list[int], list[int], list[dict[str, int]], tracemalloc.Snapshot]:
    """Memory of Python and of the process, bytes, and sizes of containers, after each quarter of a repeated scene."""
    held, resident, sizes = [], [], []
    tracemalloc.start(1)
    try:
        with alike():
            player = bench.player(scene)
            for step in range(steps):
                lap, place = divmod(step, len(scene.inputs))
                given = restamped(scene.inputs[place], lap * len(scene.inputs) * PERIOD, lap * 1000)
                player.step(nudged(given, step))
                if (step + 1) % (steps // 4) == 0:
                    gc.collect()
                    held.append(tracemalloc.get_traced_memory()[0])
                    resident.append(_resident())
                    sizes.append(_sizes(bench, player.plugin))
        return held, resident, sizes, tracemalloc.take_snapshot()
    except Fault as fault:
        raise NotRun(f"it fails when the scene is repeated: see the check `goes_on` ({fault.problem})") from None
    finally:
        tracemalloc.stop()


def _resident() -> int:
    """Resident memory of this process, bytes."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096


def _sizes(bench: Bench, plugin: Any) -> dict[str, int]:
    """Number of entries in each container of a plugin and of its modules, by name."""
    import sys

    found: dict[str, int] = {}

    def look(owner: str, held: dict[str, Any], depth: int) -> None:
        for name, value in list(held.items()):
            if isinstance(value, (list, dict, set)) or type(value).__name__ == "deque":
                is_bounded = getattr(value, "maxlen", None) is not None
                found[f"{'bounded ' if is_bounded else ''}{owner}{name}"] = len(value)
            elif depth and hasattr(value, "__dict__") and bench.subject.is_own(type(value).__module__):
                look(f"{owner}{name}.", vars(value), depth - 1)

    look("self.", vars(plugin) if hasattr(plugin, "__dict__") else {}, 3)
    look(f"{type(plugin).__name__}.", dict(vars(type(plugin))), 0)
    for module in [one for name, one in list(sys.modules.items()) if bench.subject.is_own(name)]:
        look(f"{module.__name__}.", vars(module), 0)
    return found


def _growing(sizes: Sequence[dict[str, int]], quarter: int) -> list[str]:
    """Containers that gained at least one entry every four steps, in each quarter of the steps."""
    return [
        name
        for name, last in sizes[-1].items()
        if all(late.get(name, 0) - early.get(name, 0) >= quarter // 4 for early, late in itertools.pairwise(sizes))
        and last
    ]


def _line_that_holds(bench: Bench, shot: tracemalloc.Snapshot) -> str:
    """The line of the plugin that allocated most of the held memory; empty if other code did."""
    folder = bench.subject.folder
    lines = [
        statistic
        for statistic in shot.statistics("lineno")
        if folder and statistic.traceback[0].filename.startswith(folder)
    ]
    if not lines or lines[0].size < 4096:
        return ""
    return f"{PurePath(lines[0].traceback[0].filename).name}:{lines[0].traceback[0].lineno}"


CHECKS = (limits, step_time, message_size, silent, no_threads, no_processes, no_files, memory)

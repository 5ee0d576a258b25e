"""Faults that are injected into a robot at full speed, and the measurements of each."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any

from fault_rig import SHARES, Note, Rig, until
from motor_record import longest_gap, old_words, ran_on
from navloom_live.live.description import Description
from outsider import FLOODED

__all__ = [
    "AGAIN",
    "PARTS",
    "PROCESSES",
    "SEIZED",
    "SHADOWS",
    "STOP",
    "STRANGERS",
    "STUCK",
    "Fault",
    "Outcome",
    "answer",
    "inject",
    "order",
    "tell",
    "untell",
]

STOP, AGAIN = 10.0, 90.0
"""Longest wait for the motors to be stopped after a fault, and to turn again after its end, s."""
BEFORE = 200_000_000
"""Length of the record before a fault, ns: it includes the command in effect at the fault."""
HOLD = 2.0
"""How long a process stays stopped, s: twice the lease after which others treat it as lost."""


@dataclass(frozen=True)
class Fault:
    """One kind of fault.

    Attributes:
        name: Name in the table.
        begin: Injects the fault.
        lift: Removes the fault once the motors are stopped; None if nothing has to be done.
        hold: Time between the stop of the motors and `lift`, s.
        stops: The motors must stop. Otherwise they may keep driving on healthy commands.
        is_platform: The fault hits the platform's own process, whose motors receive no stop command.
        watch: How long to observe where the motors need not stop, s.
        look: Further observation, made before and after.
        prepare: Called before, with the robot, to set up the fault.
    """

    name: str
    begin: Callable[[Rig], None]
    lift: Callable[[Rig], None] | None = None
    hold: float = 0.0
    stops: bool = True
    is_platform: bool = False
    watch: float = 1.5
    look: Callable[[Rig], dict[str, Any]] | None = None
    prepare: Callable[[Rig], object] = lambda rig: None


@dataclass
class Outcome:
    """Effects of one fault; times in s from its beginning unless stated otherwise.

    Attributes:
        fault: Name of the fault.
        ran_on: Longest time that the motors repeated one command, until another, a stop or the end of the look; None
            for the platform's own.
        gap: Longest time without a command while the motors turned; None for the platform's own.
        paused: Longest pause of the machine itself meanwhile, see `Pauses`; None if it cannot be seen.
        zero: Time until the first stop command to the motors; None if there was none.
        stood: Time from then until the robot was stopped; None for a platform that died.
        way: Distance driven until it was stopped, m; None if unknown.
        left_driving: Time until the goal reported another state than driving, or ended; None if it did neither.
        again: Time from the end of the fault until the motors turned again; None if they had not stopped.
        goal: "kept", or how the goal ended.
        fresh: A restarted platform moved only on a command that was made after its restart.
        touched: The robot touched something.
        old: Number of old commands that reached the motors again.
        load: Load of the machine, 1 min average.
        note: Further observations.
        problem: Why the measurement could not be completed; else empty.
    """

    fault: str
    ran_on: float | None = None
    gap: float | None = None
    paused: float | None = None
    zero: float | None = None
    stood: float | None = None
    way: float | None = None
    left_driving: float | None = None
    again: float | None = None
    goal: str = "kept"
    fresh: bool = True
    touched: bool = False
    old: int = 0
    load: float = 0.0
    note: dict[str, Any] = field(default_factory=dict)
    problem: str = ""

    def to_json(self) -> dict[str, Any]:
        """Plain values for the campaign's file."""
        return asdict(self)


def inject(rig: Rig, fault: Fault) -> Outcome:
    """Inject a fault into a robot at full speed, wait until it drives at full speed again, and measure the effects.

    Raises:
        AssertionError: The robot did not stop, or did not drive again, within STOP or AGAIN.
    """
    fault.prepare(rig)
    rig.wait_full_speed(AGAIN)
    outcome = Outcome(fault.name, load=os.getloadavg()[0])
    if fault.look is not None:
        outcome.note["before"] = fault.look(rig)
        rig.wait_full_speed(AGAIN)
    began = time.monotonic_ns()
    fault.begin(rig)
    if fault.is_platform:
        rig.driver.wait_for(_leaves_driving, began, STOP)
    elif fault.stops:
        until(lambda: rig.motors.zero_after(began), STOP, f"{fault.name}: the motors are told to stand")
    else:
        until(lambda: time.monotonic_ns() - began > fault.watch * 1e9, STOP, "the time to look on is over")
    if fault.hold:
        time.sleep(fault.hold)
    if fault.look is not None:
        outcome.note["after"] = fault.look(rig)
    lifted = time.monotonic_ns()
    if fault.lift is not None:
        fault.lift(rig)
    zero = rig.motors.zero_after(began)
    if fault.is_platform:
        zero = until(lambda: rig.motors.zero_after(began), AGAIN, f"{fault.name}: the platform is back")
    if zero is not None:
        after = max(zero.time_ns, lifted if fault.hold else began)
        again = until(lambda: rig.motors.turn_after(after), AGAIN, f"{fault.name}: the motors turn again")
        outcome.again = (again.time_ns - (lifted if fault.hold else began)) * 1e-9
    rig.wait_full_speed(AGAIN)
    _measure(rig, fault, outcome, began, lifted)
    return outcome


def _measure(rig: Rig, fault: Fault, outcome: Outcome, began: int, lifted: int) -> None:
    motors, end = rig.motors, time.monotonic_ns()
    zero = motors.zero_after(began)
    words = motors.between(began - BEFORE, end)
    outcome.touched = motors.touched
    outcome.paused = rig.pauses.longest(began - BEFORE, end)
    if zero is not None:
        outcome.zero = (zero.time_ns - began) * 1e-9
    if fault.is_platform:
        first = next((word for word in words if word.time_ns > lifted), None)
        goals = [note.time_ns for note in rig.driver.notes if note.kind == "asked" and note.time_ns > began]
        turned = motors.turn_after(zero.time_ns) if zero is not None else None
        is_new = not goals or turned is None or turned.time_ns > goals[0]
        outcome.fresh = first is not None and not first.turns and is_new
    else:
        # After a stop, commands come from a healthy node again; an avoider may repeat one for a second.
        until_zero = [word for word in words if zero is None or word.time_ns <= zero.time_ns]
        outcome.ran_on, outcome.gap = ran_on(until_zero, end), longest_gap(until_zero)
        outcome.old = old_words(motors.words, began)
        standing = motors.standing_after(zero.time_ns) if zero is not None else None
        if standing is not None and zero is not None:
            outcome.stood = (standing.time_ns - zero.time_ns) * 1e-9
            before = [tick for tick in motors.ticks if tick.time_ns <= began][-1]
            outcome.way = abs(standing.x - before.x)
    left = next((note for note in rig.driver.notes if note.time_ns > began and _leaves_driving(note)), None)
    outcome.left_driving = None if left is None else (left.time_ns - began) * 1e-9
    ended = next((note for note in rig.driver.notes if note.time_ns > began and note.kind == "result"), None)
    outcome.goal = "kept" if ended is None else ended.text


def _leaves_driving(note: Note) -> bool:
    return note.kind == "result" or (note.kind == "state" and note.text != "driving")


# --- processes --------------------------------------------------------------------------------------------------------


def send(share: str, *numbers: signal.Signals) -> Callable[[Rig], None]:
    def signal_it(rig: Rig) -> None:
        pid = rig.pids()[share]
        for number in numbers:
            os.kill(pid, number)

    return signal_it


def _process_faults(share: str) -> list[Fault]:
    own = share == "robot"
    kill, stop, go_on = signal.SIGKILL, signal.SIGSTOP, signal.SIGCONT
    return [
        Fault(f"SIGKILL {share}", send(share, kill), is_platform=own),
        Fault(f"SIGTERM {share}", send(share, signal.SIGTERM), is_platform=own),
        Fault(f"SIGSTOP {share}, SIGCONT", send(share, stop), send(share, go_on), HOLD, is_platform=own),
        Fault(f"SIGSTOP {share}, SIGKILL", send(share, stop), send(share, kill), HOLD, is_platform=own),
    ]


PROCESSES = [fault for group in zip(*map(_process_faults, SHARES), strict=True) for fault in group]
"""Each signal to each process of the default split; successive faults hit different processes."""


# --- parts ------------------------------------------------------------------------------------------------------------


def tell(instance: str, way: str) -> Callable[[Rig], None]:
    """Makes an instance fail, in a way of `fault_plugins.fail`."""
    return lambda rig: rig.tell(instance, way).stat() and None


def untell(instance: str, way: str) -> Callable[[Rig], None]:
    """Ends what `tell` began."""
    return lambda rig: (rig.faults / f"{instance}.{way}").unlink()


def _part_fault(instance: str, way: str, hold: float = 0.0) -> Fault:
    words = {
        "hang": "hangs in its step",
        "spin": "computes for ever",
        "seize": "computes for ever in C code",
        "hold": "sleeps for ever in C code that holds the GIL",
        "raise": "raises each tick",
        "nan": "makes NaN",
        "smuggle": "publishes NaN past the checks",
    }
    more = f" for {hold:g} s more" if hold else ""
    return Fault(f"{instance} {words[way]}{more}", tell(instance, way), untell(instance, way), hold)


PARTS = [
    _part_fault(instance, way, hold)
    for way, hold in (("hang", 0.0), ("spin", 0.0), ("raise", 0.0), ("raise", 1.5), ("nan", 0.0), ("smuggle", 0.0))
    for instance in ("faulty_tracker", "faulty_vfh")
]
"""Controller and avoider that fail in each way."""
SEIZED = [_part_fault(instance, way) for way in ("seize", "hold") for instance in ("faulty_tracker", "faulty_vfh")]


# --- strangers --------------------------------------------------------------------------------------------------------


def order(what: str, line: str) -> Callable[[Rig], None]:
    """Sends a line to an outsider."""

    def give(rig: Rig) -> None:
        stdin = rig.outsider(what).stdin
        assert stdin is not None
        stdin.write(f"{line}\n")
        stdin.flush()

    return give


def answer(what: str) -> Callable[[Rig], None]:
    """Waits for the outsider's answer."""
    return lambda rig: rig.hear(rig.outsider(what)) and None


def malformed(rig: Rig) -> dict[str, Any]:
    """Counts of malformed and of all received messages, by node and stream, for the flooded streams."""
    return {
        f"{role} {stream}": (counts.malformed, counts.received)
        for (role, _), node in rig.describe().items()
        for stream, counts in node.streams.items()
        if stream in FLOODED
    }


STRANGERS = [
    Fault(
        name, order("replay", f"go {mode}"), answer("replay"), stops=False, prepare=lambda rig: rig.outsider("replay")
    )
    for name, mode in (
        ("commands of 30 s replayed", "old"),
        ("commands of 1 s replayed", "fresh"),
        ("commands from the future", "future"),
    )
] + [
    Fault(
        "10,000 malformed messages",
        order("flood", "go"),
        answer("flood"),
        stops=False,
        look=malformed,
        prepare=lambda rig: rig.outsider("flood"),
    )
]
"""Faults by another process on the robot's own sockets."""


# --- parts that are stuck ---------------------------------------------------------------------------------------------

OTHER_STREAMS = (
    ("platform", "gate/main/command"),
    ("localizer", "platform/logged_sim/odometry"),
    ("reference", "localizer/odometry/pose"),
    ("gate", "controller/faulty_tracker/command"),
    ("gate", "avoider/faulty_vfh/command"),
    ("goal", "reference/main/reference"),
)
"""Role of a reader and its stream, whose message ages are measured while another node is stuck."""
AGES = 256
"""Number of messages whose ages a node keeps."""


def ages(rig: Rig) -> dict[str, Any]:
    """Median and 99th percentile of the age, s, of the next 256 messages of streams that the fault does not touch."""
    first = _received(rig.describe())
    until(lambda: _all_new(_received(rig.describe()), first), AGAIN, "256 new messages of each stream")
    nodes = {role: node for (role, instance), node in rig.describe().items() if not instance.startswith("shadow")}
    found = {}
    for role, stream in OTHER_STREAMS:
        counts = nodes[role].streams[stream]
        found[f"{role} <- {stream}"] = (counts.age_p50_s, counts.age_p99_s)
    return found


def _received(nodes: dict[tuple[str, str], Description]) -> dict[tuple[str, str], int]:
    return {
        (role, stream): node.streams[stream].received
        for (role, instance), node in nodes.items()
        for wanted, stream in OTHER_STREAMS
        if role == wanted and not instance.startswith("shadow")
    }


def _all_new(now: dict[tuple[str, str], int], first: dict[tuple[str, str], int]) -> bool:
    return all(now.get(key, 0) - count >= AGES for key, count in first.items())


def _free(instance: str, way: str, share: str) -> Callable[[Rig], None]:
    """Kill the process of the stuck instance; after its restart the instance is healthy."""

    def free(rig: Rig) -> None:
        (rig.faults / f"{instance}.{way}").unlink()
        now = time.monotonic_ns()
        os.kill(rig.pids()[share], signal.SIGKILL)
        until(lambda: rig.motors.zero_after(now), STOP, "the motors stand, and with them the fault is over")

    return free


STUCK = [
    Fault("shadow avoider sleeps for ever", tell("shadow_vfh", "hang"), _free("shadow_vfh", "hang", "drive"),
          stops=False, watch=0.5, look=ages),
    Fault("shadow mapper sleeps for ever", tell("shadow_map", "hang"), _free("shadow_map", "hang", "think"),
          stops=False, watch=0.5, look=ages),
]  # fmt: skip
SHADOWS = """
[[alternative]]
name = "shadow_vfh"
role = "avoider"
plugin = "faulty_vfh"

[[alternative]]
name = "shadow_map"
role = "mapper"
plugin = "faulty_map"
"""
"""Tables of a config that add the shadows which get stuck."""

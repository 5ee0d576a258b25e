"""Abuse of a certificate, and its cost to a driving robot: `python tests/faults/abuse.py --help`.

The processes of the robot are split as usual and meet behind a TLS router, all on this host; each attack is its own
process (`attacker.py`). One robot takes one attack after the other until one of its processes restarts or its goal
ends; then a new robot takes its place. The script writes a JSON file with every trial, and prints a table by kind.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import queue
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

from attacker import KINDS
from fault_rig import Rig, rig
from motor_record import Line
from navloom_live.hosting.runtime_folders import RobotFolder
from navloom_live.transport.access import Identity
from navloom_live.transport.certificate_folder import add_identity, new_authority
from navloom_live.transport.certificates import HOSTS, CertificateRequest

__all__ = ["SHADOW", "Trial", "main", "table", "target", "trial"]

ATTACKER = Path(__file__).with_name("attacker.py")
SHADOW = "shadow.avoider.shadow_vfh"
"""Name of the shadow's certificate."""
KINDNESS = 20
"""Added to the attacker's niceness: it would be on another host and not compete for this host's processors."""
AFTER = 1.25
"""How long the motors are watched after an attack, longer than the lease of a session, s."""
AGAIN = 60.0
"""Longest wait for full speed after an attack, s."""
HEAR = 60.0
"""Longest wait for a line of the attacker, s."""
FILLING = (
    "300 silent connections",
    "300 half handshakes",
    "garbage to the TLS port",
    "handshakes without a certificate",
)
"""Kinds after which no client can join for a long time: Zenoh waits 0.1 s after each failed handshake."""
MORE = """
router = "tls/127.0.0.1:{port}"
keys = "{keys}"

[[alternative]]
name = "shadow_vfh"
role = "avoider"
plugin = "faulty_vfh"
"""


@dataclass
class Trial:
    """Effects of one attack.

    Attributes:
        kind: Name of the attack.
        stops: Stop commands to the motors during the attack and the AFTER s that follow.
        stood: Total time under a stop command, s.
        restarts: Restarts of the robot's processes, the router included.
        touched: The robot touched something.
        goal: "kept", or how the goal ended.
        again: Time from the end of the attack until the robot drove at full speed, s.
        joined: Time until the attacker had joined, which the previous attack may prolong, s.
        took: Time from the start of the attacker's process until the robot drove at full speed again, s.
        said: What `navloom up` printed from the start of the attack, if the robot stopped.
        growth: Increase in MB and open files of each process, where it is large.
        spent: Share of a processor that each process used during the attack.
        load: Load of the machine, 1 min average.
        problem: Why the measurement could not be completed; else empty.
    """

    kind: str
    stops: int = 0
    stood: float = 0.0
    restarts: int = 0
    touched: bool = False
    goal: str = "kept"
    again: float = 0.0
    joined: float = 0.0
    took: float = 0.0
    said: str = ""
    growth: dict[str, Any] = field(default_factory=dict)
    spent: dict[str, float] = field(default_factory=dict)
    load: float = 0.0
    problem: str = ""

    @property
    def is_harmless(self) -> bool:
        """The robot is as before, so it can take another attack."""
        return not self.restarts and self.goal == "kept" and not self.problem


@dataclass
class Target:
    """A robot behind a TLS router, and the process that forks for each attack on it."""

    robot: Rig
    attacker: subprocess.Popen[str]
    lines: queue.Queue[str] = field(default_factory=queue.Queue)

    def listen(self) -> None:
        """Collect the lines of the attacker until it ends."""
        assert self.attacker.stdout is not None
        for line in self.attacker.stdout:
            self.lines.put(line.strip())
        self.lines.put("")

    def order(self, line: str) -> None:
        """Send a line to the attacker."""
        assert self.attacker.stdin is not None
        self.attacker.stdin.write(f"{line}\n")
        self.attacker.stdin.flush()

    def hear(self) -> str:
        """The next line of the attacker; empty if none came in time."""
        try:
            return self.lines.get(timeout=HEAR)
        except queue.Empty:
            return ""


@contextmanager
def target() -> Iterator[Target]:
    """A robot that drives behind its own TLS router; ended on exit."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = int(probe.getsockname()[1])
    with tempfile.TemporaryDirectory(prefix="nk", dir="/tmp") as folder:
        keys, now = Path(folder) / "keys", datetime.now(UTC)
        new_authority(keys, CertificateRequest("lab", "r1", HOSTS, 30, now))
        add_identity(keys, Identity(SHADOW, "shadow", "avoider.shadow_vfh"), (), 30, now)
        with rig(MORE.format(port=port, keys=keys)) as robot:
            attacker = subprocess.Popen(
                [sys.executable, str(ATTACKER), f"tls/127.0.0.1:{port}", str(keys)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
                env=robot.environment,
                preexec_fn=lambda: os.nice(KINDNESS),
            )
            try:
                aim = Target(robot, attacker)
                listener = threading.Thread(target=aim.listen, daemon=True)
                listener.start()
                yield aim
            finally:
                attacker.kill()
                attacker.wait()


def trial(aim: Target, kind: str, seconds: float) -> Trial:
    """Run one attack on a robot at full speed."""
    found, started = Trial(kind, load=os.getloadavg()[0]), time.monotonic()
    try:
        _watch(aim, found, seconds)
    except AssertionError as error:
        found.problem = str(error)[:400]
    found.took = time.monotonic() - started
    return found


def _watch(aim: Target, found: Trial, seconds: float) -> None:
    """Measure an attack; raises AssertionError if it does not begin, or if the robot no longer drives afterwards."""
    robot = aim.robot
    started = time.monotonic()
    with _joined(aim, found.kind, seconds):
        found.joined = time.monotonic() - started
        robot.wait_full_speed(AGAIN)
        before, restarts, spent, printed = _sizes(robot), _restarts(), _spent(robot), robot.log.stat().st_size
        began = time.monotonic_ns()
        aim.order("go")
        time.sleep(seconds)
        took = (time.monotonic_ns() - began) * 1e-9
        found.spent = {
            name: round((s - spent[name]) / took, 2)
            for name, s in _spent(robot).items()
            if s >= spent.get(name, s + 1.0)
        }
    over = time.monotonic_ns()
    time.sleep(AFTER)
    looked = time.monotonic_ns()
    found.stops, found.stood = _stops(robot.motors.between(began, looked), looked)
    if found.stops:
        found.said = robot.log.read_bytes()[printed:].decode("utf-8", "replace")[:2000]
    try:
        robot.wait_full_speed(AGAIN)
    finally:
        found.again = (time.monotonic_ns() - over) * 1e-9 - AFTER if found.stops else 0.0
        found.restarts, found.touched = _restarts() - restarts, robot.motors.touched
        found.growth = _growth(before, _sizes(robot))
        ended = [note for note in robot.driver.notes if note.time_ns > began and note.kind in ("result", "error")]
        found.goal = ended[0].text if ended else "kept"


@contextmanager
def _joined(aim: Target, kind: str, seconds: float) -> Iterator[None]:
    """The process of an attack, from when it joins until it is killed."""
    certificate = KINDS[kind][0]
    aim.order(json.dumps([kind, SHADOW if certificate == "shadow" else certificate, seconds]))
    word, _, pid = aim.hear().partition(" ")
    assert word == "ready", f"the attacker has not joined: {word}"
    try:
        yield
    finally:
        with suppress(ProcessLookupError):
            os.kill(int(pid), signal.SIGKILL)
        while (said := aim.hear()) and not said.endswith("gone"):
            pass
    assert said, "the attacker does not say that the attack has ended"


def _stops(words: Sequence[Line], end_ns: int) -> tuple[int, float]:
    """Number of stop commands to the motors, and total time under one until `end_ns`, s."""
    stops, stood = 0, 0
    for word, after in itertools.pairwise(words):
        stops += word.turns and not after.turns
        stood += 0 if word.turns else after.time_ns - word.time_ns
    if words and not words[-1].turns:
        stood += end_ns - words[-1].time_ns
    return stops, stood * 1e-9


def _restarts() -> int:
    return sum(fate.restarts for fate in RobotFolder("lab", "r1").fates().values())


def _sizes(robot: Rig) -> dict[str, tuple[int, int]]:
    """Memory, MB, and open files of each process."""
    found = {}
    for name, pid in robot.pids().items():
        status = Path(f"/proc/{pid}/status").read_text("utf-8")
        resident = next(line for line in status.splitlines() if line.startswith("VmRSS"))
        found[name] = int(resident.split()[1]) // 1024, len(os.listdir(f"/proc/{pid}/fd"))
    return found


def _spent(robot: Rig) -> dict[str, float]:
    """Processor time that each process has used, user and system, s."""
    found = {}
    for name, pid in robot.pids().items():
        fields = Path(f"/proc/{pid}/stat").read_text("utf-8").rpartition(")")[2].split()
        found[name] = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    return found


def _growth(before: dict[str, tuple[int, int]], after: dict[str, tuple[int, int]]) -> dict[str, Any]:
    both = {name: (after[name][0] - old[0], after[name][1] - old[1]) for name, old in before.items() if name in after}
    return {name: more for name, more in both.items() if more[0] > 50 or more[1] > 20}


def _most_spent(spent: dict[str, float]) -> float:
    """Largest share of a processor that one process used, the router excluded."""
    return max((share for name, share in spent.items() if name != "router"), default=0.0)


def table(trials: Sequence[dict[str, Any]]) -> str:
    """Effects of each kind of attack, as a Markdown table."""
    heads = ("abuse", "with", "n", "with stops", "stops", "stood at most, s", "restarts", "goals lost", "contact",
             "most of a processor", "problems")  # fmt: skip
    lines = [" | ".join(heads), " | ".join("---" for _ in heads)]
    for kind in dict.fromkeys(entry["kind"] for entry in trials):
        rows = [entry for entry in trials if entry["kind"] == kind]
        cells = (kind, KINDS[kind][0], len(rows), sum(entry["stops"] > 0 for entry in rows),
                 sum(entry["stops"] for entry in rows), f"{max(entry['stood'] for entry in rows):.2f}",
                 sum(entry["restarts"] for entry in rows), sum(entry["goal"] != "kept" for entry in rows),
                 sum(entry["touched"] for entry in rows), f"{max(_most_spent(entry['spent']) for entry in rows):.2f}",
                 sum(bool(entry["problem"]) for entry in rows))  # fmt: skip
        lines.append(" | ".join(map(str, cells)))
    return "\n".join(f"| {line} |" for line in lines)


def main(arguments: Sequence[str] | None = None) -> list[dict[str, Any]]:
    """Run the attacks that the arguments name, until each has its count; returns all trials."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kinds", nargs="*", help="names, or parts of names; else all")
    parser.add_argument("--with", dest="identity", default="", help="viewer, shadow or operator only")
    parser.add_argument("--count", type=int, default=3, help="of each kind")
    parser.add_argument("--seconds", type=float, default=4.0, help="of each attack")
    parser.add_argument("--out", type=Path, default=Path("abuse.json"), help="file; what is in it counts")
    given = parser.parse_args(arguments)
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # takes its robot down too
    trials: list[dict[str, Any]] = json.loads(given.out.read_text("utf-8")) if given.out.exists() else []
    kinds = [
        kind
        for kind, (identity, _) in KINDS.items()
        if given.identity in ("", identity) and (not given.kinds or any(part in kind for part in given.kinds))
    ]

    def due() -> list[str]:
        return [kind for kind in kinds if sum(entry["kind"] == kind for entry in trials) < given.count]

    while due():
        with target() as aim:
            for kind in itertools.chain.from_iterable(due() for _ in range(given.count)):
                found = trial(aim, kind, given.seconds)
                trials.append(asdict(found))
                given.out.write_text(json.dumps(trials, indent=1), "utf-8")
                print(f"{found}", flush=True)
                if not found.is_harmless or kind in FILLING:
                    break
    print(table([entry for entry in trials if entry["kind"] in kinds]))
    return trials


if __name__ == "__main__":
    main()

"""Abuse of a certificate: what it costs a driving robot. `python tests/faults/abuse.py --help`.

The processes of the robot are split as usual and meet behind a TLS router, all on this host; the attacker is one of its
own (`attacker.py`). It writes a JSON file with every trial, and prints a table by kind.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

from attacker import KINDS
from fault_rig import Rig, rig, until
from motor_record import Line
from navloom.runtime.access import Identity
from navloom.runtime.certificates import HOSTS, Order
from navloom.runtime.directory import RobotFolder
from navloom.runtime.keys import add_identity, new_authority

__all__ = ["SHADOW", "Trial", "main", "table", "target", "trial"]

SHADOW = "shadow.avoider.shadow_vfh"
"""Name of the shadow's certificate."""
KINDNESS = 20
"""Added to the attacker's niceness: it would be on another host, and not compete for this one's processors."""
AFTER = 2.0
"""s to look on after an attack."""
JOIN, AGAIN = 30.0, 60.0
"""s in which an attacker joins, and in which the robot drives at full speed again."""
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
    """What one attack did.

    Attributes:
        kind: Its name.
        stops: How often the motors were told to stand while it went on and AFTER s later.
        stood: s for which they were, in sum.
        restarts: Of the robot's processes, the router's too.
        touched: The robot touched something.
        goal: "kept", or how it ended.
        again: s from the end of the attack until the robot drove at full speed.
        growth: MB and open files that each process has more than before, where it is much.
        spent: Share of a processor that each process took while the attack went on.
        load: Of the machine, as a 1 min average.
        problem: Why it could not be measured to its end.
    """

    kind: str
    stops: int = 0
    stood: float = 0.0
    restarts: int = 0
    touched: bool = False
    goal: str = "kept"
    again: float = 0.0
    growth: dict[str, Any] = field(default_factory=dict)
    spent: dict[str, float] = field(default_factory=dict)
    load: float = 0.0
    problem: str = ""


@dataclass
class Target:
    """A robot behind a TLS router, and the certificates for it."""

    robot: Rig
    end: str
    keys: Path


@contextmanager
def target() -> Iterator[Target]:
    """A robot that drives behind a TLS router of its own, gone afterwards."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = int(probe.getsockname()[1])
    with tempfile.TemporaryDirectory(prefix="nk", dir="/tmp") as folder:
        keys, now = Path(folder) / "keys", datetime.now(UTC)
        new_authority(keys, Order("lab", "r1", HOSTS, 30, now))
        add_identity(keys, Identity(SHADOW, "shadow", "avoider.shadow_vfh"), (), 30, now)
        with rig(MORE.format(port=port, keys=keys)) as robot:
            yield Target(robot, f"tls/127.0.0.1:{port}", keys)


def trial(aim: Target, kind: str, seconds: float) -> Trial:
    """One attack on a robot at full speed. Raises AssertionError where it does not drive any more afterwards."""
    robot, found = aim.robot, Trial(kind, load=os.getloadavg()[0])
    identity = {"shadow": SHADOW}.get(KINDS[kind][0], KINDS[kind][0])
    command = [sys.executable, str(Path(__file__).with_name("attacker.py")), kind, aim.end, str(aim.keys), identity]
    attacker = subprocess.Popen(
        [*command, f"{seconds:g}"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=robot.environment,
        preexec_fn=lambda: os.nice(KINDNESS),
    )
    try:
        assert attacker.stdin is not None and attacker.stdout is not None
        assert attacker.stdout.readline() == "ready\n", "the attacker has not joined"
        robot.wait_full_speed(AGAIN)
        before, restarts, spent = _sizes(robot), _restarts(), _spent(robot)
        began = time.monotonic_ns()
        attacker.stdin.write("go\n")
        attacker.stdin.flush()
        until(lambda: time.monotonic_ns() - began > seconds * 1e9, seconds + JOIN, "the attack is over")
        took = (time.monotonic_ns() - began) * 1e-9
        found.spent = {
            name: round((s - spent[name]) / took, 2)
            for name, s in _spent(robot).items()
            if s >= spent.get(name, s + 1.0)
        }
    finally:
        attacker.kill()
        attacker.communicate()
    over = time.monotonic_ns()
    time.sleep(AFTER)
    looked = time.monotonic_ns()
    found.stops, found.stood = _stops(robot.motors.between(began, looked), looked)
    robot.wait_full_speed(AGAIN)
    found.again = (time.monotonic_ns() - over) * 1e-9 - AFTER if found.stops else 0.0
    found.restarts, found.touched = _restarts() - restarts, robot.motors.touched
    found.growth = _growth(before, _sizes(robot))
    ended = [note for note in robot.driver.notes if note.time_ns > began and note.kind in ("result", "error")]
    found.goal = ended[0].text if ended else "kept"
    return found


def _stops(words: Sequence[Line], end_ns: int) -> tuple[int, float]:
    """How often the motors were told to stand, and for how many s until then."""
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
    """MB of memory and open files of each process."""
    found = {}
    for name, pid in robot.pids().items():
        status = Path(f"/proc/{pid}/status").read_text("utf-8")
        resident = next(line for line in status.splitlines() if line.startswith("VmRSS"))
        found[name] = int(resident.split()[1]) // 1024, len(os.listdir(f"/proc/{pid}/fd"))
    return found


def _spent(robot: Rig) -> dict[str, float]:
    """s of processors that each process has had, in Python and outside it."""
    found = {}
    for name, pid in robot.pids().items():
        fields = Path(f"/proc/{pid}/stat").read_text("utf-8").rpartition(")")[2].split()
        found[name] = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    return found


def _growth(before: dict[str, tuple[int, int]], after: dict[str, tuple[int, int]]) -> dict[str, Any]:
    both = {name: (after[name][0] - old[0], after[name][1] - old[1]) for name, old in before.items() if name in after}
    return {name: more for name, more in both.items() if more[0] > 50 or more[1] > 20}


def _most_spent(spent: dict[str, float]) -> float:
    """Share of a processor of the process that took most, without the router."""
    return max((share for name, share in spent.items() if name != "router"), default=0.0)


def table(trials: Sequence[dict[str, Any]]) -> str:
    """What each kind did, in Markdown."""
    heads = (
        "abuse",
        "with",
        "n",
        "with stops",
        "stops",
        "stood at most, s",
        "restarts",
        "goals lost",
        "contact",
        "most of a processor",
    )
    lines = [" | ".join(heads), " | ".join("---" for _ in heads)]
    for kind in dict.fromkeys(entry["kind"] for entry in trials):
        rows = [entry for entry in trials if entry["kind"] == kind]
        lost = sum(entry["goal"] != "kept" or bool(entry["problem"]) for entry in rows)
        cells = (kind, KINDS[kind][0], len(rows), sum(entry["stops"] > 0 for entry in rows),
                 sum(entry["stops"] for entry in rows), f"{max(entry['stood'] for entry in rows):.2f}",
                 sum(entry["restarts"] for entry in rows), lost,
                 sum(entry["touched"] for entry in rows),
                 f"{max(_most_spent(entry['spent']) for entry in rows):.2f}")  # fmt: skip
        lines.append(" | ".join(map(str, cells)))
    return "\n".join(f"| {line} |" for line in lines)


def main(arguments: Sequence[str] | None = None) -> list[dict[str, Any]]:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kinds", nargs="*", help="names, or parts of names; else all")
    parser.add_argument("--with", dest="identity", default="", help="viewer, shadow or operator only")
    parser.add_argument("--count", type=int, default=3, help="of each kind")
    parser.add_argument("--seconds", type=float, default=4.0, help="of each attack")
    parser.add_argument("--out", type=Path, default=Path("abuse.json"), help="file; what is in it counts")
    given = parser.parse_args(arguments)
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # its robot is taken down whoever ends it
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
                try:
                    found = trial(aim, kind, given.seconds)
                except AssertionError as error:
                    found = Trial(kind, problem=str(error)[:300])
                trials.append(asdict(found))
                given.out.write_text(json.dumps(trials, indent=1), "utf-8")
                print(f"{found}", flush=True)
                if found.problem:
                    break
    print(table([entry for entry in trials if entry["kind"] in kinds]))
    return trials


if __name__ == "__main__":
    main()

"""CPU time and wake-ups of a live robot: every process that `navloom up` starts, itself included.

    python benchmarks/robot_cpu.py [CONFIG] [--standing] [--seconds S] [--rounds N] [--set A.B=V] [--beside PYTHON]
                                   [--json]

The robot drives to and fro between points in its first room; with `--standing` it has no goal. After it has settled,
the CPU time and the context switches of each thread are read from /proc at both ends of the window. `--beside` measures
this interpreter's navloom and another's in turn, with a new robot each time; the order alternates from round to round.
No part of navloom is imported, so it works with every version that has `navloom up` and `navloom goal --via`. Linux.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from beside import arguments, clean_environment, in_turns, set_options
from driven import PLACES

__all__ = ["CpuError", "Sample", "difference", "measured", "sample"]

WORLD = "world.ref=paper_gates"
LEG = 5.0
"""Least time of the drive between two of these points, s."""
START, MAPPED, SETTLE = 180.0, 60.0, 3.0
"""Longest waits for the robot to appear and to drive, and the time from then to the window, s."""
TICK = os.sysconf("SC_CLK_TCK")
SWITCHES = ("voluntary_ctxt_switches", "nonvoluntary_ctxt_switches")


class CpuError(RuntimeError):
    """The robot's CPU time cannot be measured; the message says why."""


@dataclass(frozen=True)
class Counts:
    """Counts of one thread: CPU time, s; voluntary context switches; involuntary context switches."""

    cpu: float
    waits: int
    preempted: int


@dataclass
class Sample:
    """Counts of all processes of a robot at one time.

    Attributes:
        time: Monotonic clock, s.
        names: Name of each process by process ID.
        threads: Name and counts of each thread by process ID and thread ID.
    """

    time: float
    names: dict[int, str] = field(default_factory=dict)
    threads: dict[tuple[int, int], tuple[str, Counts]] = field(default_factory=dict)


def sample(root: int) -> Sample:
    """Read the counts of a process and of all its descendants."""
    taken = Sample(time.monotonic())
    for pid in _tree(root):
        try:
            taken.names[pid] = "up" if pid == root else _process_name(pid)
            for entry in Path(f"/proc/{pid}/task").iterdir():
                tid = int(entry.name)
                name, counts = _thread(entry)
                taken.threads[pid, tid] = (name if pid != tid else "main thread"), counts
        except (OSError, ValueError):
            continue  # it has just ended
    return taken


def difference(before: Sample, after: Sample) -> dict[str, Any]:
    """Share of one processor and context switches per second, by process and thread. Threads of one name are added up.

    Raises:
        CpuError: The processes have changed.
    """
    if before.names != after.names:
        raise CpuError(f"processes {before.names} became {after.names} in the window, expected the same")
    lasted = after.time - before.time
    found: dict[str, dict[str, dict[str, float]]] = {name: {} for name in before.names.values()}
    nothing = Counts(0.0, 0, 0)
    for (pid, tid), (name, late) in after.threads.items():
        early = before.threads.get((pid, tid), ("", nothing))[1]
        row = found[after.names[pid]].setdefault(name, {"cpu": 0.0, "waits": 0.0, "preempted": 0.0, "threads": 0})
        row["cpu"] += (late.cpu - early.cpu) / lasted
        row["waits"] += (late.waits - early.waits) / lasted
        row["preempted"] += (late.preempted - early.preempted) / lasted
        row["threads"] += 1
    processes = {name: {**_total(rows.values()), "by_thread": rows} for name, rows in found.items()}
    return {"seconds": lasted, **_total(processes.values()), "processes": processes}


def _total(rows: Any) -> dict[str, float]:
    rows = list(rows)
    return {name: sum(row[name] for row in rows) for name in ("cpu", "waits", "preempted")}


def _tree(root: int) -> Iterator[int]:
    """Process IDs of a process and all its descendants."""
    children: dict[int, list[int]] = defaultdict(list)
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                parent = int(_status_fields(entry)[1])
            except (OSError, ValueError, IndexError):
                continue
            children[parent].append(int(entry.name))
    waiting = [root]
    while waiting:
        pid = waiting.pop()
        yield pid
        waiting += children[pid]


def _process_name(pid: int) -> str:
    """Name of a process: node processes set their own, others are named after the module that they run."""
    command = Path(f"/proc/{pid}/cmdline").read_bytes().decode("utf-8", "replace").split("\0")
    name = Path(f"/proc/{pid}/comm").read_text("utf-8").strip()
    if "-m" in command and name.startswith("python"):
        return command[command.index("-m") + 1].rpartition(".")[2]
    return name


def _status_fields(entry: Path) -> list[str]:
    """Fields of a `stat` file from the state on."""
    return (entry / "stat").read_text("utf-8", "replace").rpartition(")")[2].split()


def _thread(entry: Path) -> tuple[str, Counts]:
    fields = _status_fields(entry)
    status = dict(line.partition(":")[::2] for line in (entry / "status").read_text("utf-8").splitlines())
    waits, preempted = (int(status[name]) for name in SWITCHES)
    return status["Name"].strip(), Counts((int(fields[11]) + int(fields[12])) / TICK, waits, preempted)


def measured(python: str, config: str, changes: Sequence[str], seconds: float, standing: bool) -> dict[str, Any]:
    """Start a robot with an interpreter's navloom and measure it; returns `difference` and the last line it printed.

    Raises:
        CpuError: It does not start, does not drive, or its goal ends within the window.
    """
    with tempfile.TemporaryDirectory(prefix="nl") as folder:
        environment = clean_environment(NAVLOOM_RUNTIME_DIR=folder)
        command = [python, "-m", "navloom", "up", config, *set_options(["navigation.drive=false", *changes])]
        with (Path(folder) / "printed").open("w+b") as printed:
            up = subprocess.Popen(command, stdout=printed, stderr=subprocess.PIPE, text=True, env=environment)
            try:
                return _watch(up, python, environment, seconds, standing, Path(printed.name))
            finally:
                up.terminate()
                up.wait(30)


def _watch(
    up: subprocess.Popen[str], python: str, environment: dict[str, str], seconds: float, standing: bool, printed: Path
) -> dict[str, Any]:
    said = _Said(up)
    said.wait_for("every node is there", START)
    if not standing:
        legs = 1 + round((seconds + MAPPED) / LEG)
        points = [PLACES[number % len(PLACES)] for number in range(legs)]
        x, y = points.pop()
        vias = [word for point in points for word in ("--via", f"{point[0]},{point[1]}")]
        asked = subprocess.run(
            [python, "-m", "navloom", "goal", str(x), str(y), *vias, "--no-wait"],
            capture_output=True, text=True, env=environment, check=False,
        )  # fmt: skip
        if asked.returncode:
            raise CpuError(f"the goal was refused: {asked.stderr.strip()}")
        said.wait_for("driving", MAPPED)
    time.sleep(SETTLE)
    before = sample(up.pid)
    time.sleep(seconds)
    after = sample(up.pid)
    if printed.stat().st_size:
        raise CpuError(f"the goal ended within the window: {printed.read_text('utf-8').strip()[:200]}")
    return difference(before, after) | {"said": said.lines[-1]}


class _Said:
    """The output of `up`, line by line."""

    def __init__(self, up: subprocess.Popen[str]) -> None:
        self.lines: list[str] = []
        self._news = threading.Condition()
        self._up = up
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        for line in self._up.stderr or ():
            with self._news:
                self.lines.append(line.strip())
                self._news.notify_all()

    def wait_for(self, text: str, seconds: float) -> None:
        """Wait for a line that contains a text. Raises CpuError if it does not come in time."""
        with self._news:
            if not self._news.wait_for(lambda: any(text in line for line in self.lines), seconds):
                last = self.lines[-1] if self.lines else "nothing"
                raise CpuError(f"the robot did not say {text!r} within {seconds:g} s; it said last: {last}")


def summary(found: dict[str, list[dict[str, Any]]]) -> dict[str, Any]:
    """The figures of each round and their medians; with another interpreter also the ratios here / beside."""
    told: dict[str, Any] = dict(found)
    told["median"] = {
        side: {name: statistics.median(one[name] for one in rounds) for name in ("cpu", "waits")}
        for side, rounds in found.items()
    }
    if "beside" in found:
        pairs = list(zip(found["here"], found["beside"], strict=True))
        told["ratios"] = {name: [here[name] / beside[name] for here, beside in pairs] for name in ("cpu", "waits")}
    return told


def show(found: dict[str, list[dict[str, Any]]]) -> None:
    """Print a row for each process and thread of the last round, and the totals of all rounds."""
    for side, rounds in found.items():
        print(f"{side:<28} {'% of a core':>11} {'wake-ups/s':>11} {'preempted/s':>12}")
        for name, process in rounds[-1]["processes"].items():
            print(_row(name, process))
            for thread, row in sorted(process["by_thread"].items(), key=lambda entry: -entry[1]["cpu"]):
                if row["waits"] >= 1.0:
                    print(_row(f"  {thread}" + (f" ({row['threads']})" if row["threads"] > 1 else ""), row))
        print(_row("all", rounds[-1]))
        every = ", ".join(f"{100 * one['cpu']:.1f}" for one in rounds)
        print(f"all rounds: {every} % of a core\n")
    for name, ratios in summary(found).get("ratios", {}).items():
        print(f"here / beside, {name}: median {statistics.median(ratios):.3f}, of {len(ratios)} rounds")


def _row(name: str, row: dict[str, Any]) -> str:
    return f"{name:<28} {100 * row['cpu']:>11.2f} {row['waits']:>11.1f} {row['preempted']:>12.1f}"


def main() -> None:
    """Measure what the command line asks for."""
    parser = arguments(__doc__)
    parser.add_argument("--standing", action="store_true", help="the robot has no goal")
    parser.add_argument("--seconds", type=float, default=60.0, help="length of the window, s (default 60)")
    parser.add_argument("--rounds", type=int, default=1, help="number of robots of each side (default 1)")
    given = parser.parse_args()
    changes = [*([] if given.standing else [WORLD]), *given.set]

    def measure(python: str, number: int) -> dict[str, Any]:
        return measured(python, given.config, changes, given.seconds, given.standing)

    def told(one: dict[str, Any]) -> str:
        return f"{100 * one['cpu']:.1f} % of a core, {one['waits']:.0f} wake-ups/s"

    try:
        found = in_turns(given.beside, range(given.rounds), measure, told)
    except CpuError as error:
        sys.exit(f"robot_cpu: {error}")
    if given.json:
        print(json.dumps(summary(found)))
    else:
        show(found)


if __name__ == "__main__":
    main()

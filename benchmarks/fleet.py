"""Several robots on one host behind one router: their memory, their share of the processors, and their deadlines.

`python benchmarks/fleet.py [--robots N] [--processes 2] [--period S] [--seconds S] [--settle S] [--json]`

Each robot has its own realm and its own `navloom up` with the default four processes or with two, and drives to and fro
in the world `empty`. All share one router; `--router ""` runs without one. README.md beside this file explains the
figures.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from driven import config
from navloom.config.tables import LiveTable
from navloom_live.live.description import Description
from navloom_live.live.requests import SUBMIT, Submit
from navloom_live.operating.client import Client, ClientError
from navloom_live.operating.robot_lookup import join

COMMAND = [sys.executable, "-c", "from navloom.cli import main; main()"]
START, END = 300.0, 30.0
"""Longest start of all robots, and longest shutdown of one, s."""
PLACES = ((0.0, 6.0), (0.0, 0.0))
"""Places that a goal passes in turn, map frame, m."""
LEG = 10.0
"""Shortest drive from one place to the next, s."""
ANSWER = 30.0
"""Longest wait for the answer to a goal, s."""
BODY = ["platform", "localizer"]
MIND = ["mapper", "planner", "goal", "reference", "controller", "avoider", "recovery", "gate"]
PROCESSES: dict[int, dict[str, list[str]]] = {2: {"body": BODY, "mind": MIND}, 4: LiveTable().processes}
"""Processes of a robot and their nodes, by the number of processes."""
BESIDE = """
[robot]
realm = "{realm}"

[gate]
stop_deadline = {deadline}
sensor_timeout = {timeout}

[live]
{live}
"""


@dataclass
class One:
    """One robot.

    Attributes:
        realm: Its realm.
        up: Process of its `navloom up`.
        log: Output of that process.
        client: Connection to it.
    """

    realm: str
    up: subprocess.Popen[bytes]
    log: Path
    client: Client | None = None


@contextmanager
def fleet(
    count: int, period: float, router: str, processes: Mapping[str, list[str]], live: Sequence[str], folder: Path
) -> Iterator[list[One]]:
    """Running robots and their router; all are stopped at the end."""
    started: list[subprocess.Popen[bytes]] = []
    try:
        if router:
            started.append(_start(["router", router], folder / "router.log"))
        robots = []
        for number in range(count):
            realm, path = f"f{number}", folder / f"f{number}.toml"
            # A robot without a named host starts no router: one is already running.
            own = [f"processes = {_table(processes)}"]
            if router:
                own += [
                    f'router = "{router}"',
                    'router_host = "other"',
                    f"hosts = {_table({'own': [*processes], 'other': []})}",
                ]
            beside = BESIDE.format(
                realm=realm,
                deadline=max(0.1, 2.0 * period),
                timeout=max(0.5, 2.0 * period),
                live="\n".join([*own, *live]),
            )
            path.write_text(config("empty", period, 1e6) + beside, "utf-8")
            log = folder / f"f{number}.log"
            more = ["--host", "own"] if router else []
            robots.append(One(realm, _start(["up", str(path), *more], log), log))
            started.append(robots[-1].up)
            _await_up(robots[-1])  # one at a time, because robots that start together compete for the processors
        yield robots
    finally:
        for process in reversed(started):
            process.send_signal(signal.SIGINT)
        for process in started:
            try:
                process.wait(END)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def _table(lists: Mapping[str, list[str]]) -> str:
    """An inline table of TOML."""
    return "{ " + ", ".join(f"{name} = {json.dumps(words)}" for name, words in lists.items()) + " }"


def _start(words: Sequence[str], log: Path) -> subprocess.Popen[bytes]:
    with log.open("wb") as out:
        return subprocess.Popen([*COMMAND, *words], stdout=out, stderr=out, stdin=subprocess.DEVNULL)


def _await_up(one: One) -> None:
    limit = time.monotonic() + START
    while "every node is there" not in one.log.read_text("utf-8", "replace"):
        if one.up.poll() is not None or time.monotonic() > limit:
            raise ClientError(f"robot {one.realm} did not come up: {one.log.read_text('utf-8', 'replace')[-500:]}")
        time.sleep(0.1)


def drive(robots: Sequence[One], seconds: float) -> None:
    """Give each robot a goal that takes longer than this, s."""
    legs = 1 + round(seconds / LEG)
    *via, end = (PLACES[number % 2] for number in range(legs))
    for robot in robots:
        assert robot.client is not None
        robot.client.call("goal", "main", SUBMIT, Submit(*end, via=tuple(via)), ANSWER)


def told(one: One) -> Description:
    """The report of a robot's platform."""
    assert one.client is not None
    found = next((node for node in one.client.describe() if node.role == "platform"), None)
    if found is None:
        raise ClientError(
            f"the platform of robot {one.realm} does not answer: fewer robots or a longer --period may fit"
        )
    return found


def processes(folder: Path) -> list[int]:
    """All processes of the fleet: those with its folder in their environment or command line."""
    found = []
    for path in Path("/proc").glob("[0-9]*"):
        try:
            if os.fsencode(str(folder)) in (path / "environ").read_bytes() and int(path.name) != os.getpid():
                found.append(int(path.name))
        except OSError:
            continue
    return found


def memory(pids: Sequence[int]) -> float:
    """Memory of all these processes together, MB; each shared page counts once."""
    total = 0
    for pid in pids:
        try:
            text = Path(f"/proc/{pid}/smaps_rollup").read_text("utf-8")
        except OSError:
            continue
        total += sum(int(line.split()[1]) for line in text.splitlines() if line.startswith("Pss:"))
    return total / 1024


def spent(pids: Sequence[int]) -> float:
    """CPU time of these processes, s."""
    total = 0.0
    for pid in pids:
        try:
            fields = Path(f"/proc/{pid}/stat").read_text("utf-8").rpartition(")")[2].split()
        except OSError:
            continue
        total += (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    return total


def segments(pids: Sequence[int]) -> float:
    """Shared memory of Zenoh for these processes, MB."""
    found = set()
    for pid in pids:
        try:
            lines = Path(f"/proc/{pid}/maps").read_text("utf-8").splitlines()
        except OSError:
            continue
        found |= {line.split()[5] for line in lines if "/dev/shm/" in line and ".zenoh" in line}
    return sum(Path(name).stat().st_blocks * 512 for name in found if Path(name).exists()) / 2**20


def measure(robots: Sequence[One], folder: Path, seconds: float) -> dict[str, Any]:
    """Measure for some seconds."""
    pids = processes(folder)
    before, began, used = [told(robot) for robot in robots], time.monotonic(), spent(pids)
    time.sleep(seconds)
    took, after = time.monotonic() - began, [told(robot) for robot in robots]

    def more(count: Callable[[Description], int | None]) -> int:
        return sum((count(new) or 0) - (count(old) or 0) for new, old in zip(after, before, strict=True))

    driven = more(lambda node: node.driven_ticks)
    ages = [one.streams["gate/main/command"] for one in after]
    load, held = spent(pids) - used, memory(processes(folder))
    return {
        "robots": len(robots),
        "processes": len(pids),
        "seconds": round(took, 1),
        "cpu_share": round(load / took, 3),
        "pss_mb": round(held, 1),
        "pss_mb_per_robot": round(held / len(robots), 1),
        "segments_mb": round(segments(pids), 1),
        "ticks": more(lambda node: node.ticks),
        "late_ticks": more(lambda node: node.late_ticks),
        "driven_ticks": driven,
        "own_share": round(more(lambda node: node.own_ticks) / max(1, driven), 5),
        "stops": more(lambda node: node.stops),
        "age_p50_ms": round(1e3 * sorted(age.age_p50_s or 0.0 for age in ages)[len(ages) // 2], 2),
        "worst_age_p99_ms": round(1e3 * max(age.age_p99_s or 0.0 for age in ages), 2),
    }


def main() -> int:
    """Exit code: 1 if a robot did not start."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, default=10)
    parser.add_argument("--processes", type=int, choices=PROCESSES, default=4, help="of each robot")
    parser.add_argument("--period", type=float, default=0.1, help="control period of each robot, s")
    parser.add_argument("--seconds", type=float, default=60.0, help="length of the measurement, s")
    parser.add_argument("--settle", type=float, default=0.0, help="length of the drive before the measurement, s")
    parser.add_argument("--router", default=None, metavar="ENDPOINT", help='default: a port on loopback; "" for none')
    parser.add_argument(
        "--live", action="append", default=[], metavar="LINE", help="a line of the table [live]; repeats"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    given = parser.parse_args()
    router = _free_end() if given.router is None else given.router
    with tempfile.TemporaryDirectory(prefix="nf", dir="/tmp") as short, ExitStack() as stack:
        folder = Path(short)
        os.environ["NAVLOOM_RUNTIME_DIR"] = str(folder / "rt")
        try:
            robots = stack.enter_context(
                fleet(given.robots, given.period, router, PROCESSES[given.processes], given.live, folder)
            )
            for robot in robots:
                robot.client = stack.enter_context(join(f"{robot.realm}/r1"))
            drive(robots, given.settle + given.seconds + ANSWER * len(robots))
            time.sleep(given.settle)
            found = measure(robots, folder, given.seconds)
        except ClientError as error:
            print(f"fleet: {error}", file=sys.stderr)
            return 1
    print(json.dumps(found) if given.json else "\n".join(f"{name:18}{value}" for name, value in found.items()))
    return 0


def _free_end() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


if __name__ == "__main__":
    sys.exit(main())

"""Round trips between two processes of one host: navloom, raw Zenoh and dora, interleaved in one run.

`python benchmarks/wire.py [--json] [--rounds N] [--trips N] [--peers A,B] [--dora PYTHON]`. README.md beside this file
explains the figures.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib.metadata
import json
import os
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from samples import samples, wire_size
from trips import Driver, PeerError

HERE = Path(__file__).resolve().parent
PEERS = ("ours", "zenoh", "zenoh-thread", "zenoh-default", "zenoh-shared", "dora")
START = 30.0
"""Longest start of an end, s."""
END = 8.0
"""Longest shutdown of an end, s."""
WARM = 5
"""First trips of each block, which are not counted."""


@contextmanager
def started(command: Sequence[str], folder: Path, env: dict[str, str] | None = None) -> Iterator[subprocess.Popen[str]]:
    """Run a process. It ends by itself when the driver closes; otherwise it and its children are killed."""
    log = folder / f"log-{len(list(folder.iterdir()))}.txt"
    with log.open("w") as out:
        process = subprocess.Popen(
            command, cwd=folder, env=env, stdout=out, stderr=subprocess.STDOUT, text=True, start_new_session=True
        )
    try:
        yield process
    finally:
        try:
            process.wait(END)
        except subprocess.TimeoutExpired:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def start_zenoh(peer: str, folder: Path, driver: Driver, socket: Path, stack: ExitStack) -> None:
    """Start both ends of a peer over Zenoh. Raises PeerError."""
    env = {**os.environ, "ZENOH_RUNTIME": "()"} if peer == "zenoh-default" else None
    for part in ("echo", "ping"):
        command = [sys.executable, str(HERE / "zenoh_ends.py"), peer, part, str(folder), str(socket)]
        process = stack.enter_context(started(command, folder, env))
        driver.wait_for(f"{peer} {part}", START, lambda process=process: process.poll() is None)  # type: ignore[misc]


def start_dora(python: str, folder: Path, driver: Driver, socket: Path, stack: ExitStack) -> None:
    """Start both nodes of the dora dataflow. Raises PeerError."""
    command = find_dora(python)
    sizes = json.dumps({name: wire_size(message) for name, message in samples().items()})

    def node(part: str, source: str) -> dict[str, Any]:
        env = {"BENCH": part}
        args = " ".join(_quoted(text) for text in (str(HERE / "dora_ends.py"), part, str(socket), sizes))
        return {"id": part, "path": python, "args": args, "env": env, "inputs": {"data": source}, "outputs": ["data"]}

    flow = folder / "dataflow.yml"
    flow.write_text(json.dumps({"nodes": [node("ping", "echo/data"), node("echo", "ping/data")]}), "utf-8")
    process = stack.enter_context(started([command, "run", str(flow)], folder))
    driver.wait_for("dora ping", START, lambda: process.poll() is None)


def find_dora(python: str) -> str:
    """The dora command that belongs to an interpreter with its bindings. Raises PeerError if there is none."""
    try:
        done = subprocess.run([python, "-c", "import dora, pyarrow, numpy"], capture_output=True, text=True, timeout=60)
    except OSError as error:
        raise PeerError(f"dora: {python}: {error.strerror}") from None
    if done.returncode:
        raise PeerError(
            f"dora: {python}: {done.stderr.strip().splitlines()[-1]}; give --dora PYTHON of one that has it"
        )
    beside = Path(python).parent / "dora"
    command = str(beside) if beside.exists() else shutil.which("dora")
    if command is None:
        raise PeerError(f"dora: no command `dora` beside {python} or on the path: install dora-rs-cli")
    return command


def _quoted(text: str) -> str:
    return "'" + text + "'"


def measure(driver: Driver, peers: Sequence[str], name: str, rounds: int, trips: int) -> dict[str, Any]:
    """Measure one message: blocks of trips of each peer in turn; each round begins with another peer."""
    found: dict[str, list[int]] = {peer: [] for peer in peers}
    lost = dict.fromkeys(peers, 0)
    medians: dict[str, list[float]] = {peer: [] for peer in peers}
    for number in range(rounds):
        first = number % len(peers)
        for peer in (*peers[first:], *peers[:first]):
            driver.trips(f"{peer} ping", name, WARM)
            times = driver.trips(f"{peer} ping", name, trips)
            block = [spent for spent in times if spent is not None]
            lost[peer] += len(times) - len(block)
            found[peer] += block
            medians[peer].append(statistics.median(block) if block else float("inf"))
    return {
        "message": name,
        "bytes": wire_size(samples()[name]),
        "peers": {
            peer: {
                "p50_us": round(statistics.median(times) / 1e3, 1),
                "p99_us": round(sorted(times)[len(times) * 99 // 100] / 1e3, 1),
                "trips": len(times),
                "lost": lost[peer],
            }
            for peer, times in found.items()
            if times
        },
        "ratios": {peer: ratio_to(medians["ours"], medians[peer]) for peer in peers if peer != "ours"},
    }


def ratio_to(ours: Sequence[float], theirs: Sequence[float]) -> dict[str, float]:
    """Median and quartiles of ours / theirs over the rounds."""
    low, middle, high = statistics.quantiles([a / b for a, b in zip(ours, theirs, strict=True)], n=4)
    return {"median": round(middle, 3), "low": round(low, 3), "high": round(high, 3)}


def run(peers: Sequence[str], rounds: int, trips: int, dora: str) -> dict[str, Any]:
    """Start every peer, measure every message, and stop the peers."""
    skipped: dict[str, str] = {}
    with tempfile.TemporaryDirectory(prefix="wire") as top, ExitStack() as stack:
        socket = Path(top) / "driver"
        with Driver(socket) as driver:
            for peer in peers:
                folder = Path(top) / peer
                folder.mkdir(0o700)
                try:
                    if peer == "dora":
                        start_dora(dora, folder, driver, socket, stack)
                    else:
                        start_zenoh(peer, folder, driver, socket, stack)
                except PeerError as error:
                    skipped[peer] = _with_log(str(error), folder)
            there = [peer for peer in peers if peer not in skipped]
            rows = [measure(driver, there, name, rounds, trips) for name in samples()] if "ours" in there else []
    return {"machine": machine(), "rows": rows, "skipped": skipped}


def _with_log(text: str, folder: Path) -> str:
    said = [line for log in sorted(folder.glob("log-*.txt")) for line in log.read_text("utf-8").splitlines() if line]
    return f"{text}: {said[-1]}" if said else text


def machine() -> dict[str, Any]:
    """Processors, load and versions that the figures depend on."""
    return {
        "cpus": os.cpu_count(),
        "load": round(os.getloadavg()[0], 1),
        "python": sys.version.split()[0],
        "zenoh": importlib.metadata.version("eclipse-zenoh"),
    }


def as_text(found: dict[str, Any]) -> str:
    """A table for people."""
    at = found["machine"]
    lines = [f"{at['cpus']} CPUs, load {at['load']}, Python {at['python']}, Zenoh {at['zenoh']}", ""]
    lines.append(f"{'message':14}{'bytes':>9}  {'peer':13}{'p50 µs':>9}{'p99 µs':>9}{'lost':>6}  ours / peer")
    for row in found["rows"]:
        for peer, figures in row["peers"].items():
            ratio = row["ratios"].get(peer)
            text = f"{ratio['median']:.2f} ({ratio['low']:.2f} to {ratio['high']:.2f})" if ratio else ""
            lines.append(
                f"{row['message']:14}{row['bytes']:9}  {peer:13}{figures['p50_us']:9.0f}{figures['p99_us']:9.0f}"
                f"{figures['lost']:6}  {text}"
            )
        lines.append("")
    lines += [f"left out: {why}" for why in found["skipped"].values()]
    return "\n".join(lines)


def main() -> int:
    """Exit code: 1 if our own peer could not be measured."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--rounds", type=int, default=20, help="blocks of each peer and message (default 20)")
    parser.add_argument("--trips", type=int, default=40, help="round trips of a block (default 40)")
    parser.add_argument("--peers", default=",".join(PEERS), help=f"some of {','.join(PEERS)}; ours is always included")
    parser.add_argument("--dora", default=os.environ.get("DORA_PYTHON", sys.executable), metavar="PYTHON",
                        help="interpreter that has dora-rs (default: $DORA_PYTHON, else this one)")  # fmt: skip
    given = parser.parse_args()
    peers = [peer for peer in PEERS if peer == "ours" or peer in given.peers.split(",")]
    unknown = [peer for peer in given.peers.split(",") if peer not in PEERS]
    if unknown or given.rounds < 2 or given.trips < 1:
        parser.error(f"--peers {given.peers}, --rounds {given.rounds}, --trips {given.trips}: expected peers of "
                     f"{', '.join(PEERS)}, at least 2 rounds and 1 trip")  # fmt: skip
    found = run(peers, given.rounds, given.trips, given.dora)
    print(json.dumps(found) if given.json else as_text(found))
    return 0 if found["rows"] else 1


if __name__ == "__main__":
    sys.exit(main())

"""A robot live for a long time: memory, missed deadlines and ages, while it drives to and fro.

    python benchmarks/soak.py --minutes 30 --rate 50 [--json]
    python benchmarks/soak.py --minutes 10 --rate 20 --continuous --record drive.mcap

The resident memory of every process of the robot is sampled. Its growth is the median of the last tenth of the samples
relative to the median of the second tenth, after all buffers have filled. A deadline is missed when a tick of the
platform begins more than half a period late or is skipped. The result also has the share of driven ticks that had their
own command, and the time that the commands of a tick took. With `--record`, a recorder also runs; the result has its
CPU share, the number of dropped messages and the size of its file. With `--continuous`, the laser sweeps all the time,
so that a frame is always in transit. A bare timer of the same rate and priority also runs: what it misses is due to the
host.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

from driven import PLACES, config
from navloom_live.operating.client import Refused
from navloom_live.operating.health_findings import loop_rate
from navloom_live.operating.navigator import Navigator


def resident(pid: int) -> float:
    """Memory of a process, MB."""
    for line in Path(f"/proc/{pid}/status").read_text("utf-8").splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) / 1024
    raise ProcessLookupError(pid)


def processor_time(pid: int) -> float:
    """CPU time of a process, s."""
    fields = Path(f"/proc/{pid}/stat").read_text("utf-8").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def recorder_of(supervisor: int) -> int:
    """Process ID of the recorder that `up --record` has started."""
    for child in Path(f"/proc/{supervisor}/task/{supervisor}/children").read_text("utf-8").split():
        if b"record" in Path(f"/proc/{child}/cmdline").read_bytes().split(b"\0"):
            return int(child)
    raise SystemExit("there is no recorder beside the robot")


def bare_timer(seconds: float, rate: float) -> subprocess.Popen[str]:
    """A bare timer in a separate process."""
    command = [sys.executable, str(Path(__file__).with_name("bare_timer.py")), str(seconds), str(rate)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


def drive_about(navigator: Navigator, ends: threading.Event, outcomes: dict[str, int]) -> None:
    """Send one goal after another until the time is over."""
    number = 0
    while not ends.is_set():
        try:
            result = navigator.drive_to(*PLACES[number % len(PLACES)], timeout=300.0)
            outcomes[result.outcome] = outcomes.get(result.outcome, 0) + 1
        except (Refused, TimeoutError) as error:
            outcomes[str(error)] = outcomes.get(str(error), 0) + 1
        number += 1


def growth(samples: list[float]) -> float:
    """Relative growth from the median of the second tenth of the samples to that of the last tenth."""
    tenth = max(1, len(samples) // 10)
    return statistics.median(samples[-tenth:]) / statistics.median(samples[tenth : 2 * tenth]) - 1.0


def soak(given: argparse.Namespace) -> dict[str, Any]:
    """Run the soak and report the results."""
    with tempfile.TemporaryDirectory(prefix="nl") as folder:
        os.environ["NAVLOOM_RUNTIME_DIR"] = folder
        path = Path(folder) / "soak.toml"
        sweeps = "continuous" if given.continuous else "on_request"
        path.write_text(config("paper_gates", 1.0 / given.rate, 600.0, sweeps), "utf-8")
        command = [sys.executable, "-m", "navloom", "up", str(path)]
        command += ["--record", str(given.record)] if given.record else []
        up = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        assert up.stderr is not None
        stops: dict[str, int] = {}
        said = [""]
        ready, ends = threading.Event(), threading.Event()

        def listen() -> None:
            for line in up.stderr or ():
                said.append(line.strip())
                if "every node is there" in line:
                    ready.set()
                _, found, reason = line.strip().partition("stopped: ")
                if found and reason not in ("no goal", "goal reached"):
                    stops[reason] = stops.get(reason, 0) + 1
            ready.set()

        threading.Thread(target=listen, daemon=True).start()
        try:
            if not ready.wait(120) or not any("every node is there" in line for line in said):
                raise SystemExit(f"the robot did not come up; it said last: {said[-1]}")
            found = _watch(up.pid, given, ends) | {"gate_stops": stops}
        finally:
            ends.set()
            up.terminate()
            up.wait(30)
        return found | ({"recording": recorded(given.record)} if given.record else {})


def recorded(path: Path) -> dict[str, Any]:
    """Size of a recording, its messages, and how many were dropped, lost or malformed."""
    from navloom_recording.reader import Recording

    recording = Recording(path)
    counts = recording.counts()
    return {
        "complete": recording.is_complete,
        "bytes": path.stat().st_size,
        "messages": counts["messages"],
        **{name: sum(counts[name].values()) for name in ("dropped", "lost", "malformed")},
    }


def _watch(supervisor: int, given: argparse.Namespace, ends: threading.Event) -> dict[str, Any]:
    outcomes: dict[str, int] = {}
    with Navigator() as navigator, Navigator() as driver:
        nodes = navigator.client.describe()
        pids = {node.process: node.pid for node in nodes} | {"up": supervisor}
        pids |= {"recorder": recorder_of(supervisor)} if given.record else {}
        samples: dict[str, list[float]] = {name: [] for name in pids}
        spent = {name: processor_time(pid) for name, pid in pids.items()}
        thread = threading.Thread(target=drive_about, args=(driver, ends, outcomes))
        timer = bare_timer(60 * given.minutes, given.rate)
        thread.start()
        began = time.monotonic()
        while time.monotonic() - began < 60 * given.minutes:
            time.sleep(given.every)
            for name, pid in pids.items():
                samples[name].append(resident(pid))
            print(f"{(time.monotonic() - began) / 60:.1f} min, goals {outcomes}", file=sys.stderr, flush=True)
        lasted = time.monotonic() - began
        shares = {name: (processor_time(pid) - spent[name]) / lasted for name, pid in pids.items()}
        ends.set()
        after = navigator.client.describe()
        navigator.cancel()
        thread.join(30)
    platform = next(node for node in after if node.role == "platform")
    command = next(counts for key, counts in platform.streams.items() if key.endswith("gate/main/command"))
    return {
        "minutes": given.minutes,
        "rate_hz": given.rate,
        "goals": outcomes,
        "ticks": platform.ticks,
        "missed_deadlines": platform.late_ticks,
        "missed_share": platform.late_ticks / platform.ticks,
        "driven_by_own_command": platform.own_ticks / max(1, platform.driven_ticks),
        "loop": None if (rate := loop_rate(after)) is None else asdict(rate),
        "bare_timer": json.loads(timer.communicate(timeout=30)[0]),
        "platform_stops": platform.stops,
        "command_age_s": {"p50": command.age_p50_s, "p99": command.age_p99_s},
        "memory_mb": {name: [round(sample[0], 1), round(sample[-1], 1)] for name, sample in samples.items()},
        "processor_share": {name: round(share, 4) for name, share in shares.items()},
        "memory_growth": {name: growth(sample) for name, sample in samples.items()},
        "same_processes": {n.process: n.pid for n in after} == {n.process: n.pid for n in nodes},
    }


def main() -> None:
    """Parse, soak, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--rate", type=float, default=50.0, help="Hz")
    parser.add_argument("--every", type=float, default=5.0, help="interval of the samples, s")
    parser.add_argument("--continuous", action="store_true", help="the laser sweeps all the time")
    parser.add_argument("--record", type=Path, help="MCAP file")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    found = soak(given)
    print(json.dumps(found, indent=None if given.json else 2))


if __name__ == "__main__":
    main()

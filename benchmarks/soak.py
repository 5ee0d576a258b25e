"""A robot live for a long time: memory, missed deadlines and ages, while it drives to and fro.

    python benchmarks/soak.py --minutes 30 --rate 50 [--json]

Every process of the robot is sampled for its resident memory. Growth is counted from the end of the first tenth, when
every buffer has filled, to the end: median of the last tenth against median of the second. A deadline is missed where
the platform's tick began more than half a period late or was passed over.
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
from pathlib import Path
from typing import Any

from navloom.runtime.client import Refused
from navloom.runtime.navigator import Navigator

CONFIG = """
[run]
period = {period}
stop_after = 600.0

[world]
ref = "paper_gates"

[platform]
plugin = "sensors_sim"

[[sensor]]
name = "laser"
kind = "pitched_laser"
geometry = "paper"

[[sensor]]
name = "sonars"
kind = "sonar_ring"
layout = "p3dx"

[navigation]
drive = false
start = {{ x = 0.0, y = 0.0, heading_deg = 90.0 }}
"""
PLACES = ((0.0, 3.2), (1.6, 2.0), (-1.2, 2.4), (0.0, 0.8))


def resident(pid: int) -> float:
    """MB of memory a process holds."""
    for line in Path(f"/proc/{pid}/status").read_text("utf-8").splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) / 1024
    raise ProcessLookupError(pid)


def drive_about(navigator: Navigator, ends: threading.Event, outcomes: dict[str, int]) -> None:
    """Goal after goal, until it is time."""
    number = 0
    while not ends.is_set():
        try:
            result = navigator.drive_to(*PLACES[number % len(PLACES)], timeout=300.0)
            outcomes[result.outcome] = outcomes.get(result.outcome, 0) + 1
        except (Refused, TimeoutError) as error:
            outcomes[str(error)] = outcomes.get(str(error), 0) + 1
        number += 1


def growth(samples: list[float]) -> float:
    """Of the median of the last tenth over that of the second tenth, as a share."""
    tenth = max(1, len(samples) // 10)
    return statistics.median(samples[-tenth:]) / statistics.median(samples[tenth : 2 * tenth]) - 1.0


def soak(minutes: float, rate: float, every: float) -> dict[str, Any]:
    """Run it and say what came of it."""
    with tempfile.TemporaryDirectory(prefix="nl") as folder:
        os.environ["NAVLOOM_RUNTIME_DIR"] = folder
        config = Path(folder) / "soak.toml"
        config.write_text(CONFIG.format(period=1.0 / rate), "utf-8")
        command = [sys.executable, "-c", "from navloom.cli import main; main()", "up", str(config)]
        up = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        assert up.stderr is not None
        stops: dict[str, int] = {}
        ready, ends = threading.Event(), threading.Event()

        def listen() -> None:
            for line in up.stderr or ():
                if "every node is there" in line:
                    ready.set()
                _, found, reason = line.strip().partition("stopped: ")
                if found and reason != "no_trajectory":
                    stops[reason] = stops.get(reason, 0) + 1

        threading.Thread(target=listen, daemon=True).start()
        try:
            if not ready.wait(120):
                raise SystemExit("the robot did not come up")
            return _watch(up.pid, minutes, rate, every, ends) | {"gate_stops": stops}
        finally:
            ends.set()
            up.terminate()
            up.wait(30)


def _watch(supervisor: int, minutes: float, rate: float, every: float, ends: threading.Event) -> dict[str, Any]:
    outcomes: dict[str, int] = {}
    with Navigator() as navigator, Navigator() as driver:
        nodes = navigator.client.describe()
        pids = {node["process"]: node["pid"] for node in nodes} | {"up": supervisor}
        samples: dict[str, list[float]] = {name: [] for name in pids}
        thread = threading.Thread(target=drive_about, args=(driver, ends, outcomes))
        thread.start()
        began = time.monotonic()
        while time.monotonic() - began < 60 * minutes:
            time.sleep(every)
            for name, pid in pids.items():
                samples[name].append(resident(pid))
            print(f"{(time.monotonic() - began) / 60:.1f} min, goals {outcomes}", file=sys.stderr, flush=True)
        ends.set()
        after = navigator.client.describe()
        navigator.cancel()
        thread.join(30)
    platform = next(node for node in after if node["role"] == "platform")
    command = next(counts for key, counts in platform["streams"].items() if key.endswith("gate/main/command"))
    return {
        "minutes": minutes,
        "rate_hz": rate,
        "goals": outcomes,
        "ticks": platform["ticks"],
        "missed_deadlines": platform["late_ticks"],
        "missed_share": platform["late_ticks"] / platform["ticks"],
        "platform_stops": platform["stops"],
        "command_age_s": {name: command[f"age_{name}_s"] for name in ("p50", "p99")},
        "memory_mb": {name: [round(found[0], 1), round(found[-1], 1)] for name, found in samples.items()},
        "memory_growth": {name: growth(found) for name, found in samples.items()},
        "same_processes": {n["process"]: n["pid"] for n in after} == {n["process"]: n["pid"] for n in nodes},
    }


def main() -> None:
    """Parse, soak, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--rate", type=float, default=50.0, help="Hz")
    parser.add_argument("--every", type=float, default=5.0, help="s between samples")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    found = soak(given.minutes, given.rate, given.every)
    print(json.dumps(found, indent=None if given.json else 2))


if __name__ == "__main__":
    main()

"""Runs a command on a hostile file in a forked child, with bounds on its inputs, memory and time."""

from __future__ import annotations

import io
import os
import re
import resource
import signal
import sys
import time
from pathlib import Path
from typing import NamedTuple

from navloom.cli import main

BOUND_MB = 4
MEMORY_MB = 3000
SECONDS, WAIT = 20, 120
"""Processor time and wall time after which a command is killed, s."""
ZEROS = 100_000_000
"""Size that a bomb unpacks to, bytes."""
NOTICES = ("dropped", "later ones load them")
"""Ends of lines on standard error that are no errors."""


class Outcome(NamedTuple):
    """Exit code, standard error, peak increase of memory, MB, and processor time, s."""

    code: int
    error: str
    peak_mb: float
    seconds: float


def status_mb(name: str) -> float:
    """A value of this process's /proc status, such as VmHWM, MB."""
    found = re.search(rf"{name}:\s+(\d+) kB", Path("/proc/self/status").read_text("ascii"))
    assert found is not None
    return int(found[1]) / 1e3


def navloom(folder: Path, *words: str, bound_mb: float = BOUND_MB) -> Outcome:
    """Run the command line in a forked child."""
    said, told = folder / "stderr.txt", folder / "told.txt"
    child = os.fork()
    if not child:
        _run(words, said, told, bound_mb)
    _, status = os.waitpid(child, 0)
    assert told.exists(), f"ended by {status}: {said.read_text('utf-8', 'replace')[-500:]}"
    code, peak, seconds = told.read_text("ascii").split()
    return Outcome(int(code), said.read_text("utf-8", "replace"), float(peak), float(seconds))


def _run(words: tuple[str, ...], said: Path, told: Path, bound_mb: float) -> None:
    """Run the command and write its outcome; never returns."""
    code = -1
    try:
        signal.alarm(WAIT)
        limit = round(time.process_time()) + SECONDS
        resource.setrlimit(resource.RLIMIT_CPU, (limit, limit))
        os.environ["NAVLOOM_MAX_INPUT_MB"] = str(bound_mb)
        sys.argv = ["navloom", *words]
        sys.stdout = io.StringIO()
        before = status_mb("VmRSS")
        Path("/proc/self/clear_refs").write_text("5", "ascii")  # reset the peak
        limit = round((status_mb("VmSize") + MEMORY_MB) * 1e6)
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
        began = time.process_time()
        with said.open("w", encoding="utf-8") as sys.stderr:
            try:
                main()
                code = 0
            except SystemExit as end:
                code = int(end.code or 0)
        spent = time.process_time() - began
        told.write_text(f"{code} {status_mb('VmHWM') - before} {spent}", "ascii")
    finally:
        os._exit(0)


def refused(
    folder: Path, text: str, *words: str, bound_mb: float = BOUND_MB, peak_mb: float = 60.0, seconds: float = 3.0
) -> None:
    """Check that a command is refused in one line that matches `text`, within bounds of memory and time."""
    found = navloom(folder, *words, bound_mb=bound_mb)
    lines = found.error.splitlines()
    assert lines and all(line.endswith(NOTICES) for line in lines[:-1]), found.error[-800:]
    assert re.search(text, lines[-1]), lines[-1][:800]
    assert found.code == 2 and len(lines[-1]) < 1000, lines[-1][:300]
    assert found.peak_mb < peak_mb and found.seconds < seconds, found


MAP_YAML = "{image: m.pgm, resolution: 0.1, origin: [0, 0, 0], negate: 0, occupied_thresh: 0.65, free_thresh: 0.2}"


def laughs(levels: int, item: str) -> str:
    """A YAML map description with nested aliases: each level has nine times the items of the one before."""
    lines = [f"a0: &a0 {item}"]
    lines += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]" for n in range(1, levels)]
    return "\n".join([*lines, f"image: *a{levels - 1}", MAP_YAML[1:-1].replace(", ", "\n").partition("\n")[2]])


def merges(levels: int) -> str:
    """The same growth by merge keys, which copy tables."""
    lines = ["a0: &a0 {x: 1}"]
    lines += [f"a{n}: &a{n} {{<<: [{', '.join([f'*a{n - 1}'] * 9)}]}}" for n in range(1, levels)]
    return "\n".join(lines)

"""Runs the entries of `navloom bench` and collects their figures."""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from importlib import metadata
from pathlib import Path
from typing import Any

from navloom.config import ConfigError
from navloom.misspelt import did_you_mean
from navloom.plugins import PluginError

from navloom_benchmarks.pairs import Effort, PeerError, Row

__all__ = ["NAMES", "bench", "machine"]

Entry = Callable[[Effort, Callable[[str], None]], Iterator[Row]]
NAMES = ("loop", "planner", "rays", "codec", "bus", "barn")
"""Names of the entries, in the order in which they run."""
ROUNDS, QUICK_ROUNDS = 9, 2
"""Blocks of each side, and with --quick."""
DISTRIBUTIONS = ("navloom", "numpy", "numba", "eclipse-zenoh", "mujoco", "networkx", "pyastar2d")
"""Distributions whose versions are reported, if installed."""


def bench(
    only: Sequence[str] = (),
    quick: bool = False,
    barn: str | None = None,
    irsim: str = sys.executable,
    say: Callable[[str], None] = lambda text: None,
) -> dict[str, Any]:
    """Measure the entries.

    Args:
        only: Names of entries; empty for all.
        quick: Use small inputs and short blocks, to see that everything works; the figures mean little.
        barn: `F.npz#17`, or `F.npz` for its first world; without it the entry `barn` is left out.
        irsim: Interpreter in which ir-sim is sought.
        say: Receives a line of progress.

    Returns:
        `machine`; `quick`; `rows`, each with the fields of `Row`; `left_out`, the reason by name of an entry.

    Raises:
        ConfigError: An entry does not exist, or `barn` is named in `only` without a file.
        WorldError: The file is not one of the BARN data set.
    """
    entries = _entries(only, barn, irsim)
    effort = Effort(QUICK_ROUNDS if quick else ROUNDS, quick)
    rows: list[dict[str, Any]] = []
    left_out: dict[str, str] = {}
    if "barn" not in entries and not only:
        left_out["barn"] = "it needs a file of the BARN data set: --barn F.npz"
    for name, entry in entries.items():
        try:
            for row in entry(effort, say):
                rows.append(asdict(row))
        except (PeerError, PluginError) as error:
            left_out[name] = str(error)
    return {"machine": machine(), "quick": quick, "rows": rows, "left_out": left_out}


def _entries(only: Sequence[str], barn: str | None, irsim: str) -> dict[str, Entry]:
    """The entries to measure, in the order of NAMES."""
    for name in only:
        if name not in NAMES:
            raise ConfigError(f"--only {name}: there is no such entry; {did_you_mean(name, NAMES)}")
    if "barn" in only and barn is None:
        raise ConfigError("--only barn: it needs a file of the BARN data set, as in --barn barn_dev.npz#67")
    from navloom_benchmarks import barn as closed_loop
    from navloom_benchmarks import bus, entries

    known: dict[str, Entry] = {
        "loop": entries.loop,
        "planner": entries.planner,
        "rays": entries.rays,
        "codec": entries.codec,
        "bus": bus.bus,
    }
    if barn is not None:
        reference = closed_loop.reference_of(barn, Path.cwd())
        known["barn"] = lambda effort, say: closed_loop.barn(effort, say, reference, irsim)
    return {name: entry for name, entry in known.items() if not only or name in only}


def machine() -> dict[str, Any]:
    """Processor, load and versions, on which the figures depend."""
    versions = {}
    for name in DISTRIBUTIONS:
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return {
        "cpu": _cpu(),
        "cpus": os.cpu_count(),
        "load": round(os.getloadavg()[0], 1),
        "python": platform.python_version(),
        "versions": versions,
    }


def _cpu() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text("utf-8").splitlines()
    except OSError:
        return platform.processor()
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), platform.machine())

"""Runs checks in a separate process, and turns an early end of that process into a finding."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from navloom.plugins.one_file import files_in_use

from navloom_check.checks import Check
from navloom_check.findings import CheckReport, Finding, Result
from navloom_check.tiers import TIERS, checks_of
from navloom_check.worker_process import Process

__all__ = ["check_plugin"]

MOST_DEATHS = 3
"""Number of processes that end early after which the remaining checks are not run."""
Progress = Callable[[str, int, int], None]


@dataclass
class _Told:
    """Reports of the processes so far."""

    owner: str = ""
    place: str = ""
    folder: str = ""
    results: dict[str, Result] = field(default_factory=dict)


def check_plugin(
    name: str,
    *,
    params: Sequence[str] = (),
    seed: int = 0,
    tiers: Sequence[str] = tuple(TIERS),
    only: Sequence[str] = (),
    out: Path | None = None,
    progress: Progress = lambda check, done, total: None,
) -> CheckReport:
    """Check one plugin.

    Args:
        name: As `avoider.vff`.
        params: TOML assignments of its parameters.
        seed: Seed of everything random.
        tiers: Tiers to run.
        only: Names of the checks to run; empty for all of the tiers.
        out: Folder for pictures; None for none.
        progress: Called with the name of each check as it starts, its number, and the number of checks.
    """
    checks = [one for one in checks_of(name.partition(".")[0], tiers) if not only or one.name in only]
    job = {"name": name, "params": list(params), "seed": seed, "out": str(out or "")}
    told = _Told()
    deaths = 0
    while missing := [one for one in checks if one.name not in told.results]:
        ended = _one_process(job, missing, told, lambda check: progress(check, len(told.results), len(checks)))
        if ended is None:
            break
        deaths += 1
        _blame(told, checks, *ended, is_last=deaths >= MOST_DEATHS)
    results = tuple(told.results[one.name] for one in checks)
    options = [shlex.join(["--plugin", file]) for file in files_in_use()]
    options += [f"--set {value!r}" if " " in value else f"--set {value}" for value in params]
    return CheckReport(name, told.owner, told.place, seed, results, tuple(options))


def _one_process(
    job: dict[str, Any], checks: Sequence[Check], told: _Told, progress: Callable[[str], None]
) -> tuple[str, str, Finding] | None:
    """Run checks in one process. If it ends early: the current check, the check that reports it, and the finding."""
    under_way = ""
    with Process({**job, "checks": [check.name for check in checks]}) as process:
        for line in process.lines():
            if "start" in line:
                under_way = line["start"]
                progress(under_way)
            elif "result" in line:
                result = Result.of_json(line["result"])
                told.results[result.check] = result
            elif "loaded" in line:
                told.owner, told.place, told.folder = (line["loaded"][key] for key in ("owner", "place", "folder"))
            elif "done" in line:
                return None
        name, finding = process.autopsy(told.folder, told.place)
    return under_way, name, finding


def _blame(told: _Told, checks: Sequence[Check], under_way: str, name: str, finding: Finding, is_last: bool) -> None:
    """Store the finding for the end of a process, and which other checks are not run because of it."""
    of_tier = {check.name: check.tier for check in checks}
    first = not under_way or under_way in ("registers", "survives", "returns")
    name = name if name in of_tier else under_way or checks[0].name
    told.results[name] = Result(name, of_tier[name], "failed", (finding,))
    for check in checks:
        is_stopped = check.name == under_way or ((first or is_last) and check.name not in told.results)
        if is_stopped and check.name != name:
            reason = f"the plugin ended its process: see the check `{name}`"
            told.results[check.name] = Result(check.name, check.tier, "not_run", reason=reason)

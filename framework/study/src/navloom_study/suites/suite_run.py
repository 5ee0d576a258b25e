"""Runs a suite: one study for each of its conditions, with the same methods and seeds, into one result."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from navloom.config import ConfigError
from navloom.runs.metrics import all_metrics

from navloom_study.compare import plan_study, run_study
from navloom_study.episode_rows import EpisodeTask, Row
from navloom_study.study_methods import variation_of
from navloom_study.study_request import Study
from navloom_study.study_worlds import CachedDiscovery
from navloom_study.suites.method_files import Settings, methods_in_suite
from navloom_study.suites.result_file import SuiteResult, result_of
from navloom_study.suites.suite import Suite
from navloom_study.worker_pool import HANG_AFTER

__all__ = ["SuitePlan", "family_names", "plan_suite", "run_suite"]


@dataclass(frozen=True, eq=False)
class SuitePlan:
    """A checked request: the suite, and the study of each part by its name."""

    suite: Suite
    studies: Mapping[str, Study]
    given: Mapping[str, Settings]

    def tasks(self) -> dict[tuple[str, str, str, int], EpisodeTask]:
        """Every episode by method, part, world and seed."""
        return {
            (task.key.method, part, task.key.world, task.key.seed): task
            for part, study in self.studies.items()
            for task in study.tasks()
        }


def family_names(families: Sequence[str]) -> list[str]:
    """Names of a suite's own methods, in its order."""
    names = [value for family in families for value in variation_of(family).values]
    return list(dict.fromkeys(names))


def plan_suite(
    suite: Suite,
    own: Sequence[str],
    given: Mapping[str, Settings],
    say: Callable[[str], None] = lambda text: None,
) -> SuitePlan:
    """Check a request before anything runs.

    Args:
        suite: The suite.
        own: Names of its own methods to drive.
        given: Overrides of further methods, by name, from `read_methods`.
        say: Receives the progress of the checks.

    Raises:
        ConfigError, PluginError: Something does not fit, or a method changes the suite.
    """
    discovery = CachedDiscovery()
    known = {metric.name for metric in all_metrics(discovery)[0]}
    if suite.primary not in known:
        raise ConfigError(f"suite {suite.name}: primary: no metric {suite.primary!r} is installed")
    studies = {}
    for part in suite.parts:
        methods = methods_in_suite(suite, part, own, given, discovery)
        if not methods:
            raise ConfigError(f"suite {suite.name}: no method to drive: give --method FILE or --methods NAME,…")
        studies[part.name] = plan_study(
            suite.config, (), part.worlds, suite.seeds, part.changes, say, primary=[suite.primary], methods=methods,
            here=suite.base,
        )  # fmt: skip
    return SuitePlan(suite, studies, given)


def run_suite(
    plan: SuitePlan,
    out: Path | None = None,
    *,
    jobs: int | None = None,
    progress: Callable[[int, int, float | None], None] = lambda done, total, left: None,
    hang_after: float = HANG_AFTER,
) -> tuple[SuiteResult, dict[str, Any]]:
    """Run every episode that has not ended before. Returns the result, and the cost of computing of each method.

    Args:
        plan: From `plan_suite`.
        out: Folder that gets a folder for each part; an interrupted suite continues from it.
        jobs, hang_after: As in `run_study`.
        progress: Called with the number of ended episodes, the total, and the time left, s, or None.

    Raises:
        ConfigError, PoolError, StudyError: As by `run_study`.
    """
    rows: dict[str, Sequence[Row]] = {}
    total = sum(len(study.keys) for study in plan.studies.values())
    for part, study in plan.studies.items():
        before = sum(map(len, rows.values()))

        def tell(done: int, of: int, left: float | None, before: int = before) -> None:
            ahead = total - before - done
            progress(before + done, total, left * ahead / (of - done) if left is not None and done < of else None)

        folder = None if out is None else out / folder_of(part)
        result = run_study(study, folder, jobs=jobs, progress=tell, hang_after=hang_after)
        rows[part] = result.rows
    return result_of(plan.suite, plan.studies, rows, plan.given), cost_of(rows)


def folder_of(part: str) -> str:
    """Name of a part's folder."""
    return "".join(letter if letter.isalnum() or letter in "._-" else "_" for letter in part)


def cost_of(rows: Mapping[str, Sequence[Row]]) -> dict[str, dict[str, float]]:
    """Cost of computing by method.

    Returns:
        `step_us`: CPU time that 99 of 100 control steps stay below, the median over episodes, µs (wall time where the
        CPU time was not measured); `wall_s`: of all episodes; `load`: the highest of the machine.
    """
    found: dict[str, list[Mapping[str, float | bool]]] = {}
    for told in rows.values():
        for row in told:
            if "tick_us_p99" in row.timing:
                found.setdefault(row.key.method, []).append(row.timing)
    cost = {}
    for method, timings in found.items():
        steps = sorted(float(timing.get("tick_cpu_us_p99", timing["tick_us_p99"])) for timing in timings)
        cost[method] = {
            "step_us": round(steps[len(steps) // 2], 1),
            "wall_s": round(sum(float(timing["wall_s"]) for timing in timings), 1),
            "load": round(max(float(timing["load"]) for timing in timings), 1),
        }
    return cost

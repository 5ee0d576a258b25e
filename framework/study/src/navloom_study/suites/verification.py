"""Checks the result of a suite: its summary from its rows, and a sample of the episodes by running them again."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from navloom.config import ConfigError

from navloom_study.episode_rows import EpisodeTask, Row
from navloom_study.sign_flips import sign_flip_tests
from navloom_study.suites.result_file import (
    Key,
    ResultRow,
    SuiteResult,
    as_result_row,
    metrics_of,
    plugin_files,
    processor_type,
    summary_of,
    versions_of,
)
from navloom_study.suites.suite_run import SuitePlan
from navloom_study.worker_pool import run_on_processes

__all__ = ["Verified", "check_request", "check_rows", "check_sample", "detection", "drawn", "rerun"]

CHANCE = 0.01
"""p-value of the paired test below which a sample from another type of processor contradicts the rows."""
RESAMPLES = 20_000

Rerun = Callable[[Sequence[Key]], Iterable[ResultRow]]


@dataclass(frozen=True)
class Verified:
    """What a check found: the number of episodes run again, whether bit for bit, and on which processor."""

    sample: int
    is_bit_equal: bool
    processor: str

    def to_json(self) -> dict[str, Any]:
        """As a stored result keeps it."""
        return {"sample": self.sample, "bit_equal": self.is_bit_equal, "processor": self.processor}


def detection(share: float, count: int) -> float:
    """Least probability that a sample of `count` episodes has one of a share of forged ones: 1 - (1 - f)^n."""
    return 1.0 - (1.0 - share) ** count


def drawn(rows: Sequence[ResultRow], count: int, rng: random.Random) -> list[Key]:
    """The episodes that a verifier runs again, without repetition; the author of the rows must not know the draw."""
    return rng.sample([row.key for row in rows], min(count, len(rows)))


def check_rows(result: SuiteResult) -> None:
    """Compare the summary with the rows. Raises ConfigError."""
    try:
        summary = summary_of(result.rows, result.metrics)
    except ValueError as error:
        raise ConfigError(f"{result.suite}: {error}") from None
    wrong = [name for name in {**result.summary, **summary} if not _alike(summary.get(name), result.summary.get(name))]
    if wrong or not {*summary} == {*result.methods}:
        raise ConfigError(
            f"{result.suite}: summary of {', '.join(wrong)}: is not what the rows give; make the result again"
        )


def _alike(one: Any, other: Any) -> bool:
    """Whether two summaries are equal, numbers to the digits that another processor leaves as they are."""
    if isinstance(one, dict) and isinstance(other, dict):
        return {*one} == {*other} and all(_alike(value, other[key]) for key, value in one.items())
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(_alike, one, other))
    if isinstance(one, float) and isinstance(other, int | float):
        return math.isclose(one, other, rel_tol=1e-4, abs_tol=1e-9)
    return bool(one == other)


def check_request(result: SuiteResult, plan: SuitePlan) -> None:
    """Compare what a result depends on with the suite as it is installed here. Raises ConfigError with the difference.

    Versions of numerical packages may differ: then rows are compared by interval, as on another type of processor.
    """
    expected = plan.tasks()
    if (result.suite, result.primary, result.metrics) != (plan.suite.name, plan.suite.primary, metrics_of(plan.suite)):
        raise ConfigError(
            f"{result.suite}: its metrics are {', '.join(result.metrics)}, expected those of {plan.suite.name}: "
            f"{', '.join(metrics_of(plan.suite))}"
        )
    here = next(iter(plan.studies.values()))
    _check_versions(result, plan)
    if result.suite_sha256 != plan.suite.sha256:
        raise ConfigError(
            f"{result.suite}: is of the suite {result.suite_sha256[:12]}…, here it is {plan.suite.sha256[:12]}…; "
            "run the installed suite again"
        )
    for method in here.methods:
        for part, study in plan.studies.items():
            config = next(m.loaded.sha256() for m in study.methods if m.name == method.name)
            if result.methods[method.name].get("config_sha256", {}).get(part) != config:
                raise ConfigError(
                    f"{result.suite}: method {method.name}, {part}: its config is not what the suite and its settings "
                    f"give ({config[:12]}…); run it again"
                )
    found = [row.key for row in result.rows]
    if sorted(found) != sorted(expected):
        missing, more = set(expected) - set(found), set(found) - set(expected)
        raise ConfigError(
            f"{result.suite}: {len(missing)} episodes are missing and {len(more)} are not of the suite or twice there; "
            "a result has every episode once"
        )
    if is_same_machine(result, plan):
        worlds = {part: {world.ref: world.sha256 for world in study.worlds} for part, study in plan.studies.items()}
        if result.worlds != worlds:
            wrong = [
                ref
                for part in worlds
                for ref in worlds[part]
                if result.worlds.get(part, {}).get(ref) != worlds[part][ref]
            ]
            raise ConfigError(f"{result.suite}: world {', '.join(wrong[:3])}: is another one here; run it again")


def _differing(result: SuiteResult, plan: SuitePlan) -> dict[str, str]:
    """Versions here that differ from the result's. One of a study of many methods also has those of other methods."""
    return {name: here for name, here in versions_of(plan.studies).items() if result.versions.get(name) != here}


def _check_versions(result: SuiteResult, plan: SuitePlan) -> None:
    numerical = ("python", "machine", "numpy", "numba", "scipy")
    for name, here in sorted(_differing(result, plan).items()):
        if name not in numerical:
            raise ConfigError(
                f"{result.suite}: was made with {name} {result.versions.get(name, 'not installed')}, here is {here}; "
                "install that version, or run it again"
            )
    if dict(result.plugin_files) != (files := plugin_files()):
        raise ConfigError(
            f"{result.suite}: its plugins are in {_files(result.plugin_files)}, given here by --plugin are "
            f"{_files(files)}; give the same files"
        )


def _files(files: Mapping[str, str]) -> str:
    return ", ".join(f"{name} ({digest[:12]}…)" for name, digest in files.items()) or "no files"


def is_same_machine(result: SuiteResult, plan: SuitePlan) -> bool:
    """Whether rows must be equal bit for bit: the same type of processor, and the same versions of everything."""
    return result.processor == processor_type() and not _differing(result, plan)


def rerun(plan: SuitePlan, metrics: Sequence[str], jobs: int) -> Rerun:
    """Runs episodes of a plan again."""
    tasks = plan.tasks()

    def run(keys: Sequence[Key]) -> list[ResultRow]:
        found: list[ResultRow] = []

        def keep(part: str, row: Row) -> None:
            found.append(as_result_row(row, part, metrics))

        for part in dict.fromkeys(key[1] for key in keys):
            chosen: list[EpisodeTask] = [tasks[key] for key in keys if key[1] == part]
            run_on_processes(chosen, partial(keep, part), min(jobs, len(chosen)))
        return found

    return run


def check_sample(result: SuiteResult, keys: Sequence[Key], run: Rerun, is_same: bool) -> Verified:
    """Run a sample again and compare: bit for bit, or by a paired test of the primary metric.

    Args:
        result: The result.
        keys: Episodes from `drawn`.
        run: Runs episodes again.
        is_same: Whether the rows must be equal, see `is_same_machine`.

    Raises:
        ConfigError: A row is not what the episode gives.
    """
    claimed: Mapping[Key, ResultRow] = {row.key: row for row in result.rows}
    again = {row.key: row for row in run(keys)}
    pairs = [(claimed[key], again[key]) for key in keys]
    if is_same:
        for before, now in pairs:
            if before != now:
                raise ConfigError(_difference(result, before, now))
    else:
        values = [(before.values[0], now.values[0]) for before, now in pairs]
        steps = np.array([[(a or 0.0) - (b or 0.0)] for a, b in values])
        strata = np.zeros(len(steps), dtype=np.int64)
        (test,) = sign_flip_tests(steps, strata, np.random.default_rng(0), RESAMPLES)
        if test.p < CHANCE:
            raise ConfigError(
                f"{result.suite}: {result.primary} of {len(keys)} episodes run again here differs by "
                f"{steps.mean():+.3f} from the rows on average (p = {test.p:.2g}): more than another processor explains"
            )
    return Verified(len(keys), is_same, processor_type())


def _difference(result: SuiteResult, before: ResultRow, now: ResultRow) -> str:
    method, part, world, seed = before.key
    names = ["outcome", "trace_sha256", *result.metrics]
    values = zip(names, (before.outcome, before.trace_sha256, *before.values),
                 (now.outcome, now.trace_sha256, *now.values), strict=True)  # fmt: skip
    wrong = [f"{name} is {told}, here it is {found}" for name, told, found in values if told != found]
    return (
        f"{result.suite}: {method}, {part}, {world}, seed {seed}: {'; '.join(wrong[:3])}; "
        "the row is not what the episode gives"
    )


def stamped(result: SuiteResult, verified: Verified) -> SuiteResult:
    """The result with what its check found."""
    return replace(result, checked=verified.to_json())

"""The result of a suite as a file: one row an episode, what they depend on, and the summary that follows from them."""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from navloom.config import ConfigError
from navloom.config.config_methods import MethodTable
from navloom.inputs.bounds import IMAGE_MB, read_file
from navloom.inputs.texts import json_of
from navloom.plugins import Discovery
from navloom.plugins.one_file import files_in_use
from navloom.runs.metrics import Metric, all_metrics

from navloom_study.episode_rows import Row
from navloom_study.statistics import compare_methods
from navloom_study.study_request import Study
from navloom_study.suites.suite import Suite

__all__ = ["METRICS", "Key", "ResultRow", "SuiteResult", "processor_type", "read_result", "result_of", "summary_of"]

FORMAT = 1
METRICS = (
    "success",
    "spl",
    "time",
    "clearance_min",
    "collisions",
    "false_success",
    "person_distance_min",
    "pose_error_rms",
)
"""Metrics that a result keeps beside the primary one, if they are not the same."""
RESAMPLES = 5000
PLACES = 12
"""Significant digits of a metric, as in the table of a study."""

Key = tuple[str, str, str, int]
"""Method, part, world and seed."""


@dataclass(frozen=True)
class ResultRow:
    """One episode."""

    method: str
    part: str
    world: str
    seed: int
    outcome: str
    trace_sha256: str
    values: tuple[float | None, ...]

    @property
    def key(self) -> Key:
        """What makes it unique."""
        return (self.method, self.part, self.world, self.seed)


@dataclass(frozen=True)
class SuiteResult:
    """What one or more methods did in a suite. Equal requests give equal results on one type of processor.

    Attributes:
        suite, suite_sha256: Name and hash of the suite.
        primary, metrics: The metric that decides; and the metrics of the rows, in their order, it first.
        worlds: Hash of each world, by part and reference.
        methods: By method, its overrides `set` (None for one of the suite's own), and its `config_sha256` by part.
        versions, plugin_files, processor: What an episode depends on.
        rows: One row an episode.
        summary: By method, what `summary_of` computes from the rows.
        checked: What a verifier found, of a result that is stored; empty before.
    """

    suite: str
    suite_sha256: str
    primary: str
    metrics: tuple[str, ...]
    worlds: Mapping[str, Mapping[str, str]]
    methods: Mapping[str, Mapping[str, Any]]
    versions: Mapping[str, str]
    plugin_files: Mapping[str, str]
    processor: str
    rows: tuple[ResultRow, ...]
    summary: Mapping[str, Any]
    checked: Mapping[str, Any] = field(default_factory=dict)

    def text(self) -> str:
        """The file: reproducible, one line a row."""
        head = {name: value for name, value in vars(self).items() if name != "rows" and (name != "checked" or value)}
        whole = json.dumps({"format": FORMAT, **head}, indent=1, ensure_ascii=False)
        rows = ",\n".join(
            json.dumps([*row.key, row.outcome, row.trace_sha256, *row.values], ensure_ascii=False) for row in self.rows
        )
        return f'{whole[:-2]},\n "rows": [\n{rows}\n]\n}}\n'

    def of(self, method: str) -> SuiteResult:
        """The part of one method."""
        return replace(
            self, methods={method: self.methods[method]}, summary={method: self.summary[method]},
            rows=tuple(row for row in self.rows if row.method == method),
        )  # fmt: skip


def result_of(
    suite: Suite,
    studies: Mapping[str, Study],
    rows: Mapping[str, Sequence[Row]],
    given: Mapping[str, Mapping[str, Any]],
) -> SuiteResult:
    """The result of the studies of a suite's parts.

    Args:
        suite: The suite.
        studies, rows: By part, the study and its rows.
        given: Overrides of the methods that are not the suite's own.
    """
    metrics = metrics_of(suite)
    first = next(iter(studies.values()))
    found = [as_result_row(row, part, metrics) for part, told in rows.items() for row in told]
    names = [method.name for method in first.methods]
    found.sort(key=lambda row: names.index(row.method))
    methods = {
        name: {
            "set": given.get(name),
            "config_sha256": {
                part: next(m.loaded.sha256() for m in study.methods if m.name == name)
                for part, study in studies.items()
            },
        }
        for name in names
    }
    return SuiteResult(
        suite.name,
        suite.sha256,
        suite.primary,
        metrics,
        {part: {world.ref: world.sha256 for world in study.worlds} for part, study in studies.items()},
        methods,
        versions_of(studies),
        plugin_files(),
        processor_type(),
        tuple(found),
        summary_of(found, metrics),
    )


def versions_of(studies: Mapping[str, Study]) -> dict[str, str]:
    """Versions that the episodes of a suite's parts depend on, without files of `--plugin`: see `plugin_files`."""
    found = {name: version for study in studies.values() for name, version in study.versions.items()}
    for file in files_in_use():
        found.pop(file, None)
    return dict(sorted(found.items()))


def plugin_files() -> dict[str, str]:
    """SHA-256 of each file of `--plugin`, by its name without its folder, which is of one machine."""
    return {Path(file).name: hashlib.sha256(Path(file).read_bytes()).hexdigest() for file in files_in_use()}


def metrics_of(suite: Suite) -> tuple[str, ...]:
    """Metrics of the rows of a suite's result, the primary one first."""
    return tuple(dict.fromkeys([suite.primary, *METRICS]))


def as_result_row(row: Row, part: str, metrics: Sequence[str]) -> ResultRow:
    """A row of a study as a row of a result."""
    values = tuple(None if (v := row.metrics.get(name)) is None else float(f"{v:.{PLACES}g}") for name in metrics)
    return ResultRow(row.key.method, part, row.key.world, row.key.seed, row.outcome, row.trace_sha256, values)


def summary_of(rows: Iterable[ResultRow], metrics: Sequence[str]) -> dict[str, Any]:
    """By method: mean and 95 % interval of each metric, and successes by part. A method's summary needs its rows only.

    Raises:
        ValueError: A row is there twice, or a share is neither 0 nor 1.
    """
    known = {metric.name: metric for metric in all_metrics(Discovery())[0]}
    chosen = [known.get(name) or Metric(name, "?", None, lambda trail: None, "") for name in metrics]
    by_method: dict[str, list[ResultRow]] = {}
    for row in rows:
        by_method.setdefault(row.method, []).append(row)
    return {method: _summary(told, chosen) for method, told in by_method.items()}


def _summary(rows: Sequence[ResultRow], metrics: Sequence[Metric]) -> dict[str, Any]:
    names = [metric.name for metric in metrics]
    told = [
        {"method": row.method, "world": f"{row.part}: {row.world}", "seed": row.seed, "outcome": row.outcome,
         **dict(zip(names, row.values, strict=True))}
        for row in rows
    ]  # fmt: skip
    found = compare_methods(told, rows[0].method, metrics, np.random.default_rng(0), RESAMPLES)
    parts: dict[str, dict[str, int]] = {}
    for row in rows:
        count = parts.setdefault(row.part, {"episodes": 0, "reached": 0, "contacts": 0})
        told_row = dict(zip(names, row.values, strict=True))
        count["episodes"] += 1
        count["reached"] += int(told_row.get("success") or 0)
        count["contacts"] += int((told_row.get("collisions") or 0) > 0)
    return {
        "episodes": len(rows),
        "scope": found.scope,
        "metrics": {
            s.metric: [_short(v) for v in (s.estimate.mean, s.estimate.low, s.estimate.high)] for s in found.summaries
        },
        "parts": parts,
    }


def _short(value: float | None) -> float | None:
    return None if value is None else float(f"{value:.6g}")


def read_result(path: Path) -> SuiteResult:
    """Read the file of a result. Raises ConfigError for anything else; nothing in it is believed."""
    content = read_file(path, IMAGE_MB, ConfigError)
    tree = json_of(content, str(path), ConfigError)
    try:
        if tree.pop("format") != FORMAT:
            raise ConfigError(f"{path}: is a result of another format than {FORMAT}; make it again with this version")
        count = len(tree["metrics"])
        rows = tuple(_row(row, count) for row in tree.pop("rows"))
        texts = [tree[name] for name in ("suite", "suite_sha256", "primary", "processor")]
        tables = [tree[name] for name in ("worlds", "methods", "versions", "plugin_files", "summary")]
        if not all(isinstance(text, str) for text in texts) or not all(isinstance(table, dict) for table in tables):
            raise TypeError
        for name, table in tree["methods"].items():
            # A name becomes a file's; overrides are checked as those of a file of methods.
            MethodTable.model_validate({"name": name.replace("@", "-"), "set": table["set"] or {}})
        if not rows or tree["metrics"][0] != tree["primary"]:
            raise ValueError
        return SuiteResult(**{**tree, "metrics": tuple(tree["metrics"]), "rows": rows})
    except (KeyError, TypeError, ValueError, AttributeError, IndexError) as error:
        if isinstance(error, ConfigError):
            raise
        raise ConfigError(
            f"{path}: is no result of a suite; name the result.json of `navloom compare --suite`"
        ) from None


def _row(given: Any, count: int) -> ResultRow:
    method, part, world, seed, outcome, trace, *values = given
    if len(values) != count or not isinstance(seed, int):
        raise ValueError
    if not all(isinstance(text, str) for text in (method, part, world, outcome, trace)):
        raise TypeError
    return ResultRow(method, part, world, seed, outcome, trace, tuple(None if v is None else float(v) for v in values))


def processor_type() -> str:
    """Type of the processor: equality of traces holds on one type. From /proc/cpuinfo, else the machine's name."""
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()

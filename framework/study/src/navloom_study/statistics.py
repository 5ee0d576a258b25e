"""Paired comparison of methods over worlds and seeds: intervals, tests, worst worlds. See docs/metrics.md.

Episodes of one world are correlated, so they are not independent evidence. With enough worlds the unit is the world,
and the result holds for worlds like these. With fewer worlds the unit is the episode within its world, and the result
holds for these worlds only.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any, TypeVar

import numpy as np
from navloom.runs.metrics import Metric
from numpy.typing import NDArray

from navloom_study.binomial import share_interval
from navloom_study.paired_differences import (
    Difference,
    Estimate,
    Pairs,
    bounded,
    differences_of,
    means_of,
    units_of,
    value_of,
)
from navloom_study.resampling import intervals

__all__ = ["FEW_WORLDS", "FLEET_PRIMARY", "PRIMARY", "THESE_WORLDS", "WORLDS_LIKE_THESE", "Comparison", "Difference",
           "Estimate", "Summary", "WorstWorld", "compare_methods"]  # fmt: skip

T = TypeVar("T")
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

FEW_WORLDS = 10
"""Number of worlds below which the result holds for these worlds only."""
WORLDS_LIKE_THESE = "worlds like these"
THESE_WORLDS = "for these worlds only"
PRIMARY = ("success", "spl")
"""Metrics that a study asks about, if it names none: the first one in which enough pairs differ."""
FLEET_PRIMARY = ("success", "arrived")
"""The same of fleets."""
WORST = 5


@dataclass(frozen=True)
class Summary:
    """Estimate of one metric of one method."""

    method: str
    metric: str
    estimate: Estimate


@dataclass(frozen=True)
class WorstWorld:
    """A world with poor results of a method, and its worst episode there, to be run again."""

    world: str
    episodes: int
    failures: int
    seed: int
    outcome: str


@dataclass(frozen=True)
class Comparison:
    """Statistical comparison of several methods.

    Attributes:
        baseline: The method that the others are compared with.
        methods, metrics, worlds, seeds: Methods and metrics in the given order; worlds and seeds sorted.
        scope: Scope of the intervals and tests: `WORLDS_LIKE_THESE` or `THESE_WORLDS`.
        resamples: Number of draws of the bootstrap, and of a permutation test that is not exact.
        summaries: Estimates of every method and metric.
        differences: Differences of every method except the baseline, for every metric.
        outcomes: Number of episodes by method and outcome.
        worst: The five worst worlds of each method, worst first. Worlds, and the episodes within one, are ranked by the
            metrics in their order; later metrics break ties, and undefined values count as 0.
    """

    baseline: str
    methods: tuple[str, ...]
    metrics: tuple[str, ...]
    worlds: tuple[str, ...]
    seeds: tuple[int, ...]
    scope: str
    resamples: int
    summaries: tuple[Summary, ...]
    differences: tuple[Difference, ...]
    outcomes: Mapping[str, Mapping[str, int]]
    worst: Mapping[str, tuple[WorstWorld, ...]]

    def summary(self, method: str, metric: str) -> Estimate:
        """Estimate of one metric of one method. Raises KeyError if it was not compared."""
        return _only(s.estimate for s in self.summaries if (s.method, s.metric) == (method, metric))

    def difference(self, method: str, metric: str) -> Difference:
        """Difference of one metric between a method and the baseline. Raises KeyError if it was not compared."""
        return _only(d for d in self.differences if (d.method, d.metric) == (method, metric))


def compare_methods(
    rows: Iterable[Mapping[str, Any]],
    baseline: str,
    metrics: Sequence[Metric],
    rng: np.random.Generator,
    resamples: int = 10_000,
    primary: Sequence[str] = PRIMARY,
) -> Comparison:
    """Compare methods with a baseline, by pairs of episodes of equal world and seed.

    Args:
        rows: One row an episode: `method`, `world`, `seed`, `outcome`, and each metric by name: a number, or None or an
            empty string if it is not defined. Rows of a CSV file are accepted.
        baseline: Name of a method.
        metrics: Metrics to compare; the first ones decide which worlds are worst.
        rng: Generator for the resamples. The same rows and state give the same comparison.
        resamples: Number of draws, at least 5,000 for a report.
        primary: Names of the metrics that the study asks about. A method is tested in the first of them in which enough
            pairs differ to show a difference.

    Raises:
        ValueError: No rows, an unknown baseline, a duplicate episode, or a missing or unreadable column.
    """
    table = _Table(list(rows), metrics)
    if baseline not in table.methods:
        close = get_close_matches(baseline, table.methods, n=1) or [", ".join(table.methods)]
        raise ValueError(f"baseline {baseline!r}: no such method in the rows; did you mean {close[0]}?")
    few = len(table.worlds) < FEW_WORLDS
    others = [method for method in table.methods if method != baseline]
    base = table.values[table.methods.index(baseline)]
    # (worlds, seeds, columns): every method's metrics.
    episodes = np.concatenate(list(table.values), axis=-1)
    estimates = _estimates(episodes, *units_of(episodes, few), rng, resamples)
    summaries = [
        Summary(method, metric.name, _possible(estimates[m * len(metrics) + k], metric, few, table.values[m][..., k]))
        for m, method in enumerate(table.methods)
        for k, metric in enumerate(metrics)
    ]
    compared = [Pairs(table.values[table.methods.index(method)], base, few, rng, resamples) for method in others]
    differences = differences_of(others, metrics, compared, primary)
    return Comparison(
        baseline=baseline,
        methods=tuple(table.methods),
        metrics=tuple(metric.name for metric in metrics),
        worlds=tuple(table.worlds),
        seeds=tuple(table.seeds),
        scope=THESE_WORLDS if few else WORLDS_LIKE_THESE,
        resamples=resamples,
        summaries=tuple(summaries),
        differences=tuple(differences),
        outcomes=table.counts(),
        worst={method: _worst(table, method, metrics) for method in table.methods},
    )


class _Table:
    """The rows as arrays.

    Attributes:
        values: (methods, worlds, seeds, metrics), NaN where there is no value.
        outcomes: Outcomes by method, world and seed.
    """

    def __init__(self, rows: list[Mapping[str, Any]], metrics: Sequence[Metric]) -> None:
        if not rows:
            raise ValueError("rows: there are none; expected one an episode")
        for column in ("method", "world", "seed", "outcome", *(metric.name for metric in metrics)):
            if any(column not in row for row in rows):
                close = get_close_matches(column, list(rows[0]), n=1)
                raise ValueError(f"rows: no column {column!r}" + (f"; did you mean {close[0]!r}?" if close else ""))
        self.methods: list[str] = list(dict.fromkeys(row["method"] for row in rows))
        self.worlds: list[str] = sorted({row["world"] for row in rows})
        self.seeds: list[int] = sorted({int(row["seed"]) for row in rows})
        self.outcomes: dict[tuple[str, str, int], str] = {}
        self.values = np.full((len(self.methods), len(self.worlds), len(self.seeds), len(metrics)), np.nan)
        places = [{name: at for at, name in enumerate(names)} for names in (self.methods, self.worlds)]
        at_seed = {seed: at for at, seed in enumerate(self.seeds)}
        for row in rows:
            key = (row["method"], row["world"], int(row["seed"]))
            if key in self.outcomes:
                raise ValueError(f"rows: {key[0]} in {key[1]} with seed {key[2]} is there twice; keep one of them")
            self.outcomes[key] = row["outcome"]
            at = (places[0][key[0]], places[1][key[1]], at_seed[key[2]])
            self.values[at] = [_number(row[metric.name], metric, key) for metric in metrics]

    def counts(self) -> dict[str, dict[str, int]]:
        """Number of episodes by method and outcome."""
        return {
            method: dict(sorted(Counter(end for (m, _, _), end in self.outcomes.items() if m == method).items()))
            for method in self.methods
        }


def _number(value: Any, metric: Metric, key: tuple[str, str, int]) -> float:
    if value is None or value == "":
        return np.nan
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = np.inf
    if not np.isfinite(number) or (metric.is_share and number not in (0.0, 1.0)):
        where = f"{metric.name} of {key[0]} in {key[1]} with seed {key[2]}"
        expected = "1 or 0" if metric.is_share else "a finite number"
        raise ValueError(f"rows: {where} is {value!r}, expected {expected}, or nothing where undefined")
    return number


def _estimates(
    episodes: Floats, units: Floats, strata: Ints, rng: np.random.Generator, resamples: int
) -> list[Estimate]:
    """The estimate of every column."""
    mean, low, high = intervals(units, strata, rng, resamples)
    there = ~np.isnan(episodes)
    worlds, count = there.any(axis=1).sum(axis=0).tolist(), there.sum(axis=(0, 1)).tolist()
    ends = zip(mean.tolist(), low.tolist(), high.tolist(), worlds, count, strict=True)
    return [Estimate(value_of(m), value_of(lo), value_of(hi), w, n) for m, lo, hi, w, n in ends]


def _possible(one: Estimate, metric: Metric, few: bool, episodes: Floats) -> Estimate:
    """An estimate with its interval made exact, for a share, and cut at the metric's bounds.

    Args:
        one: Estimate of the metric.
        metric: The metric.
        few: The estimate is for these worlds only.
        episodes: (worlds, seeds) values that it is computed from.
    """
    if one.low is None or one.high is None:
        return one
    low, high = share_interval(episodes, few) if metric.is_share else (one.low, one.high)
    return bounded(one, low, high, *metric.bounds)


def _worst(table: _Table, method: str, metrics: Sequence[Metric]) -> tuple[WorstWorld, ...]:
    signs = np.array([{"higher": 1.0, "lower": -1.0, None: 0.0}[metric.better] for metric in metrics])
    values = table.values[table.methods.index(method)]
    worlds = np.nan_to_num(means_of(values)) * signs
    found = []
    for w in sorted(range(len(table.worlds)), key=lambda w: worlds[w].tolist()):
        world = table.worlds[w]
        seeds = [s for s, seed in enumerate(table.seeds) if (method, world, seed) in table.outcomes]
        if seeds:
            ends = {s: table.outcomes[method, world, table.seeds[s]] for s in seeds}
            worst = min(seeds, key=lambda s: (np.nan_to_num(values[w, s]) * signs).tolist())
            failures = sum(end != "succeeded" for end in ends.values())
            found.append(WorstWorld(world, len(seeds), failures, table.seeds[worst], ends[worst]))
    return tuple(found[:WORST])


def _only(found: Iterable[T]) -> T:
    for one in found:
        return one
    raise KeyError("not compared")

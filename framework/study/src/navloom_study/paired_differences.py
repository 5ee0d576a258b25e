"""Differences of methods from a baseline, over the pairs of equal world and seed: estimates, intervals and tests.

The interval and the p-value of a difference come from one sign-flip test, so they never contradict each other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from navloom.runs.metrics import Metric
from numpy.typing import NDArray

from navloom_study.binomial import difference_interval
from navloom_study.resampling import holm, holm_levels, statistic
from navloom_study.sign_flips import FlipTest, sign_flip_tests

__all__ = ["LEVEL", "Difference", "Estimate", "Pairs", "bounded", "differences_of", "means_of", "units_of", "value_of"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

LEVEL = 0.95
"""Confidence level of an interval that is not adjusted."""


@dataclass(frozen=True)
class Estimate:
    """A mean over worlds, with equal weight for each world's mean, and its 95 % interval.

    Attributes:
        mean: The mean; None if it is not defined in any episode.
        low, high: Ends of the interval, within the metric's bounds; None with too little data: fewer than two worlds
            or, for these worlds only, a world with fewer than two episodes.
        worlds, episodes: Numbers of worlds and episodes that it is computed from.
    """

    mean: float | None
    low: float | None
    high: float | None
    worlds: int
    episodes: int


@dataclass(frozen=True)
class Difference:
    """Difference of one metric between a method and the baseline, over the pairs of equal world and seed.

    Attributes:
        method, metric: Method and metric.
        estimate: Estimate of the difference, method minus baseline.
        p: Two-sided p-value of the sign-flip test; None for a metric without a better side, and without pairs.
        p_holm: Of the primary metric, the p-value adjusted over the methods; None for the other metrics, which are
            exploratory.
        attainable: Smallest p-value that these pairs could give, not adjusted; None without a test.
        level: Confidence level of the estimate's interval: 0 is outside exactly if the difference is `shown`.
        unpaired: Number of pairs left out, because the metric is defined in one of them only or an episode is missing.
    """

    method: str
    metric: str
    estimate: Estimate
    p: float | None
    p_holm: float | None
    attainable: float | None
    level: float
    unpaired: int

    @property
    def is_primary(self) -> bool:
        """Whether the metric is the one that the study asks about."""
        return self.p_holm is not None

    @property
    def can_be_shown(self) -> bool:
        """Whether pairs that differ as much as these could show a difference at the interval's level."""
        return self.attainable is not None and self.attainable <= 1.0 - self.level + 1e-12

    @property
    def is_shown(self) -> bool:
        """Whether the test rejects that there is no difference, at 5 %."""
        p = self.p_holm if self.p_holm is not None else self.p
        return p is not None and p <= 1.0 - LEVEL + 1e-12


class Pairs:
    """The pairs of one method with the baseline, and their tests by metric.

    Args:
        episodes, baseline: (worlds, seeds, metrics) values.
        few: The result is for these worlds only.
        rng, resamples: See `compare_methods`.
    """

    def __init__(self, episodes: Floats, baseline: Floats, few: bool, rng: np.random.Generator, resamples: int) -> None:
        self.episodes, self.baseline, self.few = episodes, baseline, few
        values = episodes - baseline
        there = ~np.isnan(values)
        told = np.isfinite(episodes) | np.isfinite(baseline)
        self.unpaired: list[int] = (told & ~there).sum(axis=(0, 1)).tolist()
        self.pairs: list[int] = there.sum(axis=(0, 1)).tolist()
        self.worlds: list[int] = there.any(axis=1).sum(axis=0).tolist()
        units, strata = units_of(values, few)
        self.means = statistic(units, strata)[0].tolist()
        self.tests = sign_flip_tests(units, strata, rng, resamples)

    def estimate(self, k: int, metric: Metric, level: float) -> Estimate:
        """Difference of the metric number k, with the interval of its test."""
        mean = value_of(self.means[k])
        bare = Estimate(mean, None, None, self.worlds[k], self.pairs[k])
        low, high = self.tests[k].interval(level)
        if mean is None or not np.isfinite(low):
            return bare
        if metric.is_share:
            # A shift of all pairs says little about shares: pairs that never differ would give a point.
            wide = difference_interval(self.episodes[..., k], self.baseline[..., k], self.few, level)
            # Where the two disagree about 0, the test's end counts.
            low = low if (wide[0] > 0.0) != (low > 0.0) else wide[0]
            high = high if (wide[1] < 0.0) != (high < 0.0) else wide[1]
        least, greatest = metric.bounds
        widest = None if least is None or greatest is None else greatest - least
        return bounded(bare, low, high, None if widest is None else -widest, widest)


def differences_of(
    methods: Sequence[str], metrics: Sequence[Metric], compared: Sequence[Pairs], primary: Sequence[str]
) -> list[Difference]:
    """Differences of all methods; metrics without a better side are not tested."""
    asked = [_asked(pairs.tests, metrics, primary, len(methods)) for pairs in compared]
    tested = [m for m, k in enumerate(asked) if k is not None]
    chances = np.array([compared[m].tests[asked[m] or 0].p for m in tested])
    adjusted = dict(zip(tested, holm(chances).tolist(), strict=True))
    levels = dict(zip(tested, holm_levels(chances, LEVEL).tolist(), strict=True))
    found = []
    for m, (method, pairs) in enumerate(zip(methods, compared, strict=True)):
        for k, metric in enumerate(metrics):
            test = pairs.tests[k]
            is_primary, is_tested = k == asked[m], metric.better is not None and not np.isnan(test.p)
            level = levels[m] if is_primary else LEVEL
            found.append(
                Difference(
                    method=method,
                    metric=metric.name,
                    estimate=pairs.estimate(k, metric, level),
                    p=test.p if is_tested else None,
                    p_holm=adjusted[m] if is_primary else None,
                    attainable=test.attainable if is_tested else None,
                    level=level,
                    unpaired=pairs.unpaired[k],
                )
            )
    return found


def _asked(tests: Sequence[FlipTest], metrics: Sequence[Metric], primary: Sequence[str], methods: int) -> int | None:
    """Number of the primary metric: the first in which a difference could be shown, else the first that differs at all.

    The choice depends on the sizes of the differences alone, not on their signs, and the test is conditional on the
    sizes. So choosing does not raise the probability of a false positive.
    """
    names = [metric.name for metric in metrics]
    there = [names.index(name) for name in primary if name in names]
    there = [k for k in there if metrics[k].better is not None and not np.isnan(tests[k].p)]
    for most in ((1.0 - LEVEL) / methods, 0.999):
        for k in there:
            if tests[k].attainable <= most:
                return k
    return there[0] if there else None


def units_of(episodes: Floats, few: bool) -> tuple[Floats, Ints]:
    """The resampled units, (n, columns), and their strata, (n,).

    With few worlds the units are episodes within their world; otherwise they are the means of worlds, in one stratum.
    """
    worlds, seeds, columns = episodes.shape
    if few:
        return episodes.reshape(worlds * seeds, columns), np.repeat(np.arange(worlds), seeds)
    return means_of(episodes), np.zeros(worlds, dtype=np.int64)


def means_of(episodes: Floats) -> Floats:
    """(worlds, columns) means over the seeds with a value, NaN if none has one."""
    there = ~np.isnan(episodes)
    count = there.sum(axis=1)
    total = np.where(there, episodes, 0.0).sum(axis=1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def bounded(one: Estimate, low: float, high: float, least: float | None, greatest: float | None) -> Estimate:
    low = low if least is None else max(low, least)
    return replace(one, low=low, high=high if greatest is None else min(high, greatest))


def value_of(value: float) -> float | None:
    return None if np.isnan(value) else value

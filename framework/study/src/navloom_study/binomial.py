"""Intervals of shares (metrics that are 1 or 0 in each episode) and of their differences. Arrays in, numbers out.

Episodes are (worlds, seeds), NaN where there is none. A share is the mean over worlds of the mean within each world.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

__all__ = ["difference_interval", "exact_interval", "share_interval"]

Floats = NDArray[np.float64]

_LEVEL = 0.95


def exact_interval(share: float, trials: float, level: float = _LEVEL) -> tuple[float, float]:
    """Clopper and Pearson 1934: the interval of a probability, from the share of successful trials.

    50 of 50 gives 0.929 to 1 at the level 0.95. The number of trials need not be an integer.
    """
    from scipy.special import betaincinv

    tail = 0.5 * (1.0 - level)
    hits = share * trials
    misses = trials - hits
    low = 0.0 if share <= 0.0 else float(betaincinv(hits, misses + 1.0, tail))
    high = 1.0 if share >= 1.0 else float(betaincinv(hits + 1.0, misses, 1.0 - tail))
    return min(low, share), max(high, share)


def share_interval(episodes: Floats, few: bool, level: float = _LEVEL) -> tuple[float, float]:
    """Interval of a share.

    Args:
        episodes: (worlds, seeds) of 1, 0 and NaN, at least one of them a number.
        few: The interval is for these worlds only. Then every episode is a trial: the sum of trials whose probabilities
            differ by world varies no more than that of equally many identical ones (Hoeffding 1956). Otherwise the
            worlds are a sample, and the number of trials is the effective sample size (Korn and Graubard 1998).
        level: Confidence level.
    """
    means = _means(episodes)
    count = int(np.count_nonzero(~np.isnan(episodes)))
    return exact_interval(float(means.mean()), count if few else _independent(means, count), level)


def difference_interval(episodes: Floats, baseline: Floats, few: bool, level: float = _LEVEL) -> tuple[float, float]:
    """Interval of a share minus another of the same worlds and seeds: Newcombe 1998, method 10.

    The intervals of both shares are combined by the correlation of the pairs, with its correction for small samples.

    Args:
        episodes, baseline: (worlds, seeds) of 1, 0 and NaN, at least one pair of them numbers.
        few, level: See `share_interval`.
    """
    paired = ~np.isnan(episodes) & ~np.isnan(baseline)
    one, other = np.where(paired, episodes, np.nan), np.where(paired, baseline, np.nan)
    p, q = float(_means(one).mean()), float(_means(other).mean())
    (p_low, p_high), (q_low, q_high) = share_interval(one, few, level), share_interval(other, few, level)
    units = (one[paired], other[paired]) if few else (_means(one), _means(other))
    r = _correlation(*units)

    def reach(a: float, b: float) -> float:
        return math.sqrt(max(a * a - 2.0 * r * a * b + b * b, 0.0))

    low, high = reach(p - p_low, q_high - q), reach(p_high - p, q - q_low)
    return max(p - q - low, -1.0), min(p - q + high, 1.0)


def _means(episodes: Floats) -> Floats:
    """(k,) means of the worlds with at least one value."""
    there = ~np.isnan(episodes)
    count = there.sum(axis=1)
    total: Floats = np.where(there, episodes, 0.0).sum(axis=1)[count > 0] / count[count > 0]
    return total


def _independent(means: Floats, count: int) -> float:
    """Effective number of independent trials, from the variance of the worlds' means, at most that of episodes.

    One artificial world with the opposite outcome is added, because worlds that all agree do not show how strongly the
    episodes of one world are correlated.
    """
    worlds = np.append(means, 0.0 if means.mean() >= 0.5 else 1.0)
    share, spread = float(worlds.mean()), float(worlds.var())
    return min(float(count), len(means) * share * (1.0 - share) / spread)


def _correlation(one: Floats, other: Floats) -> float:
    """Correlation of pairs, corrected by half a pair towards 0 if it is positive; 0 if one of the two does not vary."""
    spread = float(one.std() * other.std())
    if spread <= 0.0:
        return 0.0
    together = float((one * other).mean() - one.mean() * other.mean())
    if together > 0.0:
        together = max(together - 0.5 / len(one), 0.0)
    return together / spread

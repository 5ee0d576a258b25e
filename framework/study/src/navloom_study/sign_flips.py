"""Sign-flip permutation tests of a mean difference, and the interval of the same test. Arrays in, arrays out.

Units are (n, columns), NaN where a unit has no value; strata and statistic are those of `resampling`. The interval
holds every shift that the test would not reject, so p ≤ 1 - level exactly if 0 is outside of the interval.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from navloom_study.resampling import chunks, statistic

__all__ = ["FlipTest", "sign_flip_tests"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_EXACT_UNITS = 13
"""Largest number of units for which all 2^n sign patterns are enumerated."""


@dataclass(frozen=True, eq=False)
class FlipTest:
    """The test of one column.

    Attributes:
        p: Two-sided p-value of a mean of 0; NaN without units.
        attainable: Smallest p-value that units of these sizes could give: 2 / 2^n for n units that differ from 0.
    """

    p: float
    attainable: float
    _means: Floats
    """Sorted weighted means of the units that a pattern flips, and of those that it keeps, where there are any."""
    _empty: int
    """Number of patterns that flip no unit or keep none, which reach the statistic for any shift."""
    _patterns: int
    _observed: int
    """1 if the observed pattern counts beside those drawn, 0 if it is one of all patterns."""

    def interval(self, level: float = 0.95) -> tuple[float, float]:
        """Ends of the interval; infinite if too few units can reject any shift at this level.

        A pattern reaches the statistic of a smaller shift than the mean if the mean of the flipped units is no larger
        than the shift (Hartigan 1969, "typical values"). So both ends are ordered means of subsets.
        """
        allowed = math.floor((1.0 - level) * (self._patterns + self._observed) + 1e-9) - self._observed
        at = allowed - self._empty
        if at < 0:
            return -math.inf, math.inf
        return float(self._means[at]), float(self._means[-1 - at])


def sign_flip_tests(units: Floats, strata: Ints, rng: np.random.Generator, resamples: int) -> list[FlipTest]:
    """The test of each column: the sign of each unit is random if there is no difference.

    Exact, over all sign patterns, for few units; otherwise by resamples, including the observed pattern.
    """
    _, counts, _ = statistic(units, strata)
    there = ~np.isnan(units)
    places = np.searchsorted(np.unique(strata), strata)
    weights = np.where(there, 1.0 / (np.maximum(counts, 1)[places] * np.maximum((counts > 0).sum(axis=0), 1)), 0.0)
    shares = np.where(there, units, 0.0) * weights
    few = there.sum(axis=0) <= _EXACT_UNITS
    found: dict[int, FlipTest] = {}
    for column in np.flatnonzero(few).tolist():
        told = there[:, column]
        flips = _all_patterns(int(told.sum()))
        own, own_weights = shares[told, column], weights[told, column]
        found[column] = _flip_test(own, flips @ own, flips @ own_weights, own_weights.sum(), observed=0)
    many = np.flatnonzero(~few)
    if many.size:
        flipped, flipped_weights = np.empty((2, resamples, many.size))
        begin = 0
        for size in chunks(len(units), resamples):
            flips = rng.integers(0, 2, size=(size, len(units)), dtype=np.int8).astype(np.float64)
            flipped[begin : begin + size] = flips @ shares[:, many]
            flipped_weights[begin : begin + size] = flips @ weights[:, many]
            begin += size
        for k, column in enumerate(many.tolist()):
            total = weights[:, column].sum()
            found[column] = _flip_test(shares[:, column], flipped[:, k], flipped_weights[:, k], total, observed=1)
    return [found[column] for column in range(units.shape[1])]


def _all_patterns(units: int) -> Floats:
    """(2^units, units) of 1 where a unit is flipped and 0 where it is kept."""
    patterns = np.arange(2**units)[:, None]
    return ((patterns >> np.arange(units)) & 1).astype(np.float64)


def _flip_test(shares: Floats, flipped: Floats, flipped_weights: Floats, weight: float, observed: int) -> FlipTest:
    """One column's test.

    Args:
        shares: (n,) weighted units; their sum is the statistic.
        flipped, flipped_weights: (patterns,) sums over the flipped units.
        weight: Sum of all weights.
        observed: See `FlipTest`.
    """
    if weight <= 0.0:
        return FlipTest(math.nan, 1.0, np.empty(0), 2, 1, observed)
    total, count = float(shares.sum()), len(flipped)
    # Sums of the same numbers in another order may differ in the last digits; they count as ties.
    rounding = 1e-9 * float(np.abs(shares).sum())
    hits = np.count_nonzero(np.abs(total - 2.0 * flipped) >= abs(total) - rounding)
    sums = np.concatenate([flipped, total - flipped])
    sums[np.abs(sums) <= 0.5 * rounding] = 0.0
    held = np.concatenate([flipped_weights, weight - flipped_weights])
    some = held > 1e-9 * weight
    differing = int(np.count_nonzero(shares))
    least = 1.0 if differing == 0 else 2.0 ** (1 - differing)
    return FlipTest(
        p=float(hits + observed) / (count + observed),
        attainable=max(least, 1.0 / (count + 1)) if observed else least,
        _means=np.sort(sums[some] / held[some]),
        _empty=int(np.count_nonzero(~some)),
        _patterns=count,
        _observed=observed,
    )

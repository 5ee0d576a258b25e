"""How many particles a belief needs, and which ones to keep: KLD sampling and low-variance resampling."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["bins_of", "kld_size", "resampled", "sample_size", "warm_up"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_GOLDEN = 0.6180339887498949
"""Step of the sequence of draws that `sample_size` looks at: it spreads evenly over 0 to 1 for any number of draws."""
_MOST_BINS = 1 << 20
"""Bins along x and y that one key can tell apart."""


@njit(cache=True, nogil=True, error_model="numpy")
def kld_size(bins, error, quantile):  # type: ignore[no-untyped-def]
    """Particles that a belief over a number of bins needs: Fox 2003, eq. (7), Wilson and Hilferty's approximation.

    Args:
        bins: Number of bins that the belief occupies.
        error: Largest Kullback-Leibler distance between the particles and the belief.
        quantile: Upper quantile of the normal distribution for the probability that it is kept; 2.326 for 99 %.
    """
    if bins < 2:
        return 1
    part = 2.0 / (9.0 * (bins - 1))
    return math.ceil((bins - 1) / (2.0 * error) * (1.0 - part + math.sqrt(part) * quantile) ** 3)


def bins_of(particles: Floats, size: float, turns: int) -> tuple[Ints, Ints]:
    """Bins of particles: (k, 3) column, row and heading of the occupied ones, sorted, and each particle's bin, (n,).

    Args:
        particles: (n, 3) x, y, m, heading, rad, map frame.
        size: Edge of a bin, m.
        turns: Bins in a full turn.
    """
    place = np.clip(np.floor(particles[:, :2] / size), -_MOST_BINS // 2, _MOST_BINS // 2 - 1).astype(np.int64)
    turn = np.floor(particles[:, 2] * (turns / math.tau)).astype(np.int64) % turns
    keys, which = np.unique(
        ((place[:, 0] + _MOST_BINS // 2) * _MOST_BINS + place[:, 1] + _MOST_BINS // 2) * turns + turn,
        return_inverse=True,
    )
    places = keys // turns
    bins = np.column_stack(
        (places // _MOST_BINS - _MOST_BINS // 2, places % _MOST_BINS - _MOST_BINS // 2, keys % turns)
    )
    return bins, which


@njit(cache=True, nogil=True, error_model="numpy")
def sample_size(weights, which, first, least, most, error, quantile):  # type: ignore[no-untyped-def]
    """Number of particles that KLD sampling draws (Fox 2003, table 3).

    Args:
        weights: (n,) their sum is 1. which: (n,) bin of each particle.
        first: First draw, 0 to 1.
        least, most: Limits of the number.
        error, quantile: As for `kld_size`.
    """
    seen = np.zeros(which.max() + 1, dtype=np.bool_)
    sums = np.cumsum(weights)
    bins, needed, drawn, at = 0, least, 0, first
    while drawn < needed and drawn < most:
        i = min(np.searchsorted(sums, at * sums[-1]), len(weights) - 1)
        if not seen[which[i]]:
            seen[which[i]] = True
            bins += 1
            needed = max(least, kld_size(bins, error, quantile))
        at = (at + _GOLDEN) % 1.0
        drawn += 1
    return drawn


@njit(cache=True, nogil=True, error_model="numpy")
def resampled(weights, first, count):  # type: ignore[no-untyped-def]
    """Indices of `count` particles, each about count x weight times: low-variance sampling (Thrun et al. 2005, 4.4).

    Args:
        weights: (n,) their sum is 1.
        first: Random number from 0 to 1.
    """
    found = np.empty(count, dtype=np.int64)
    i, total = 0, weights[0]
    for k in range(count):
        at = (first + k) / count
        while at > total and i < len(weights) - 1:
            i += 1
            total += weights[i]
        found[k] = i
    return found


def warm_up() -> None:
    """Compile the kernels."""
    _, which = bins_of(np.zeros((2, 3)), 1.0, 4)
    weights = np.full(2, 0.5)
    resampled(weights, 0.5, sample_size(weights, which, 0.5, 1, 2, 0.05, 2.0))

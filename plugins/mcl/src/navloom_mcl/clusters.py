"""Groups particles into hypotheses: bins that touch one another belong to one place."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["Places", "clusters_of", "moments", "warm_up"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Places(NamedTuple):
    """Places where the robot may be, the likeliest first.

    Attributes:
        poses: (k, 3) means: x, y, m, heading, rad in [-π, π), map frame.
        weights: (k,) probabilities.
        covariances: (k, 3, 3) m², m rad, rad².
    """

    poses: Floats
    weights: Floats
    covariances: Floats


@njit(cache=True, nogil=True, error_model="numpy")
def _groups(bins, turns):  # type: ignore[no-untyped-def]
    """Group of each bin, the index of one of its bins, from sorted (k, 3) bins of `sampling.bins_of`."""
    count = bins.shape[0]
    parent = np.arange(count)
    for i in range(count):
        for dx in range(2):
            for dy in range(-1, 2):
                for dt in range(-1, 2):
                    x, y, t = bins[i, 0] + dx, bins[i, 1] + dy, (bins[i, 2] + dt) % turns
                    low, high = 0, count
                    while low < high:
                        middle = (low + high) // 2
                        a, b, c = bins[middle, 0], bins[middle, 1], bins[middle, 2]
                        if a < x or (a == x and (b < y or (b == y and c < t))):
                            low = middle + 1
                        else:
                            high = middle
                    if low < count and bins[low, 0] == x and bins[low, 1] == y and bins[low, 2] == t:
                        p, q = i, low
                        while parent[p] != p:
                            p = parent[p]
                        while parent[q] != q:
                            q = parent[q]
                        parent[max(p, q)] = min(p, q)
    for i in range(count):
        parent[i] = parent[parent[i]]
    return parent


@njit(cache=True, nogil=True, error_model="numpy")
def moments(particles, weights, about):  # type: ignore[no-untyped-def]
    """Second moments (3, 3) of weighted particles about a pose (3,), headings wrapped, per unit of weight."""
    found, total, off = np.zeros((3, 3)), 0.0, np.empty(3)
    for n in range(particles.shape[0]):
        off[0], off[1] = particles[n, 0] - about[0], particles[n, 1] - about[1]
        off[2] = (particles[n, 2] - about[2] + math.pi) % math.tau - math.pi
        total += weights[n]
        for i in range(3):
            for k in range(i + 1):
                found[i, k] += weights[n] * off[i] * off[k]
    for i in range(3):
        for k in range(i + 1):
            found[i, k] /= max(total, 1e-300)
            found[k, i] = found[i, k]
    return found


@njit(cache=True, nogil=True, error_model="numpy")
def _sums(particles, weights, groups, sums):  # type: ignore[no-untyped-def]
    """Add weight, x, y, cosine and sine of the particles of each group to (k, 5) sums."""
    for n in range(particles.shape[0]):
        k, w = groups[n], weights[n]
        sums[k, 0] += w
        sums[k, 1] += w * particles[n, 0]
        sums[k, 2] += w * particles[n, 1]
        sums[k, 3] += w * math.cos(particles[n, 2])
        sums[k, 4] += w * math.sin(particles[n, 2])


def clusters_of(particles: Floats, weights: Floats, bins: Ints, which: Ints, turns: int, most: int) -> Places:
    """The places of weighted particles.

    Args:
        particles: (n, 3) x, y, m, heading, rad, map frame. weights: (n,) their sum is 1.
        bins, which: As `sampling.bins_of` returns them. turns: Bins in a full turn.
        most: Largest number of places.
    """
    groups = _groups(bins, turns)[which]
    sums = np.zeros((len(bins), 5))
    _sums(particles, weights, groups, sums)
    # A stable sort: of equal weights the first bin comes first.
    order = np.argsort(-sums[:, 0], kind="stable")[:most]
    order = order[sums[order, 0] > 0.0]
    found = sums[order]
    poses = np.column_stack(
        (found[:, 1] / found[:, 0], found[:, 2] / found[:, 0], np.arctan2(found[:, 4], found[:, 3]))
    )
    poses[poses[:, 2] >= math.pi, 2] = -math.pi
    covariances = np.empty((len(order), 3, 3))
    for k, group in enumerate(order):
        inside = groups == group
        covariances[k] = moments(particles[inside], weights[inside], poses[k])
    return Places(poses, found[:, 0], covariances)


def warm_up() -> None:
    """Compile the kernels."""
    bins, which = np.zeros((1, 3), dtype=np.int64), np.zeros(1, dtype=np.int64)
    clusters_of(np.zeros((1, 3)), np.ones(1), bins, which, 4, 1)

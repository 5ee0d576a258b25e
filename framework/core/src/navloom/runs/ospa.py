"""The distance between two sets of points: optimal subpattern assignment, OSPA.

Schuhmacher, Vo and Vo, "A consistent metric for performance evaluation of multi-object filters", IEEE Transactions on
Signal Processing 56 (2008), eq. (3) and section II.D.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Ospa", "assignment", "ospa"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Ospa(NamedTuple):
    """An OSPA distance and its parts, m: `total**order` is the sum of both parts to the power of the order."""

    total: float
    location: float
    cardinality: float


def ospa(truth: Floats, found: Floats, cutoff: float, order: float = 1.0) -> Ospa:
    """OSPA distance of two sets of points; 0 for two empty sets.

    Args:
        truth, found: (m, 2) and (n, 2), m.
        cutoff: Distance from which a point counts as missing, m: c.
        order: p, at least 1; the larger, the more a single far point counts.
    """
    few, many = sorted((len(truth), len(found)))
    if not many:
        return Ospa(0.0, 0.0, 0.0)
    away = np.minimum(distances(truth, found), cutoff) ** order
    rows = assignment(away)
    is_assigned = rows >= 0
    location = float(away[is_assigned, rows[is_assigned]].sum()) / many
    cardinality = cutoff**order * (many - few) / many
    return Ospa(*((part ** (1.0 / order)) for part in (location + cardinality, location, cardinality)))


def distances(truth: Floats, found: Floats) -> Floats:
    """(m, n) distance of each point of one set from each of another, m."""
    away = truth[:, None, :] - found[None, :, :]
    return np.asarray(np.hypot(away[..., 0], away[..., 1]))


def assignment(costs: Floats) -> Ints:
    """(m,) column of each row in the assignment of least cost; -1 for none, as for m - n rows of m > n.

    Shortest augmenting paths: Jonker and Volgenant, "A shortest augmenting path algorithm for dense and sparse linear
    assignment problems", Computing 38 (1987).

    Args:
        costs: (m, n), finite.
    """
    if costs.shape[0] <= costs.shape[1]:
        return _kernel()(np.ascontiguousarray(costs))
    columns, rows = _kernel()(np.ascontiguousarray(costs.T)), np.full(costs.shape[0], -1)
    rows[columns] = np.arange(len(columns))
    return rows


@cache
def _kernel() -> Callable[[Floats], Ints]:
    from navloom.geometry.compiled import compiled  # numba takes half a second, and most readers need no assignment

    return compiled(_assigned)


def _assigned(costs: Floats) -> Ints:
    """Column of each row; no more rows than columns. Potentials of rows and columns make all reduced costs >= 0."""
    m, n = costs.shape
    of_row, of_column = np.zeros(m + 1), np.zeros(n + 1)
    row_of, back = np.zeros(n + 1, np.int64), np.zeros(n + 1, np.int64)
    for row in range(1, m + 1):
        row_of[0], column = row, 0
        least, used = np.full(n + 1, np.inf), np.zeros(n + 1, np.bool_)
        while row_of[column] != 0:
            used[column] = True
            own, step, following = row_of[column], np.inf, 0
            for j in range(1, n + 1):
                if not used[j]:
                    reduced = costs[own - 1, j - 1] - of_row[own] - of_column[j]
                    if reduced < least[j]:
                        least[j], back[j] = reduced, column
                    if least[j] < step:
                        step, following = least[j], j
            for j in range(n + 1):
                if used[j]:
                    of_row[row_of[j]] += step
                    of_column[j] -= step
                else:
                    least[j] -= step
            column = following
        while column != 0:
            row_of[column] = row_of[back[column]]
            column = back[column]
    found = np.full(m, -1)
    for j in range(1, n + 1):
        if row_of[j] != 0:
            found[row_of[j] - 1] = j - 1
    return found

"""The OSPA distance and its parts, against numbers worked out by hand, and its assignment against all permutations."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from navloom.runs.ospa import assignment, ospa

NONE = np.empty((0, 2))
ONE = np.array([(0.0, 0.0)])
TWO = np.array([(0.0, 0.0), (10.0, 0.0)])


@pytest.mark.parametrize(
    ("truth", "found", "parts"),
    [
        (NONE, NONE, (0.0, 0.0, 0.0)),
        (ONE, NONE, (1.0, 0.0, 1.0)),
        (NONE, TWO, (1.0, 0.0, 1.0)),
        (ONE, ONE + (0.3, 0.4), (0.5, 0.5, 0.0)),
        (ONE, ONE + 5.0, (1.0, 1.0, 0.0)),  # farther than the cut-off
        (TWO, ONE + (0.2, 0.0), (0.6, 0.1, 0.5)),  # (0.2 + 1.0) / 2
        (TWO, TWO[::-1] + (0.0, 0.3), (0.3, 0.3, 0.0)),  # the order says nothing
    ],
)  # fmt: skip
def test_the_distance_of_order_1_is_the_sum_of_its_parts(
    truth: np.ndarray, found: np.ndarray, parts: tuple[float, float, float]
) -> None:
    assert ospa(truth, found, 1.0) == pytest.approx(parts)


def test_of_order_2_the_squares_are_averaged() -> None:
    found = ospa(TWO, TWO + [(0.0, 0.6), (0.0, 0.8)], 1.0, 2.0)
    assert found == pytest.approx((np.sqrt(0.5), np.sqrt(0.5), 0.0))


@pytest.mark.parametrize("seed", range(20))
def test_the_assignment_costs_as_little_as_the_best_permutation(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows, columns = rng.integers(1, 6, 2)
    costs = rng.random((rows, columns))
    found = assignment(costs)
    own = found >= 0
    assert own.sum() == min(rows, columns) == len(set(found[own]))
    wide = costs if rows <= columns else costs.T
    best = min(sum(wide[i, j] for i, j in enumerate(p)) for p in permutations(range(wide.shape[1]), wide.shape[0]))
    assert costs[np.flatnonzero(own), found[own]].sum() == pytest.approx(best)

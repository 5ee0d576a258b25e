"""How often the intervals of a comparison cover the truth, in studies that are drawn from known distributions."""

from __future__ import annotations

import numpy as np
import pytest
from navloom.runs.metrics import METRICS
from navloom_study.binomial import share_interval
from navloom_study.paired_differences import LEVEL, Pairs

STUDIES, RESAMPLES = 600, 2000
BY_NAME = {metric.name: metric for metric in METRICS}
PAIRS = (6, 9, 30)

pytestmark = pytest.mark.slow


def covering(name: str, method: np.ndarray, baseline: np.ndarray, truth: float) -> float:
    """Share of the studies, (1, pairs, studies) values of a metric, whose interval of the difference holds the truth.

    A study that gives no interval says nothing that could be wrong.
    """
    compared = Pairs(method, baseline, True, np.random.default_rng(2), RESAMPLES)
    held = []
    for study in range(STUDIES):
        one = compared.estimate(study, BY_NAME[name], LEVEL)
        held.append(one.low is None or one.high is None or one.low - 1e-9 <= truth <= one.high + 1e-9)
    return float(np.mean(held))


@pytest.mark.parametrize("pairs", PAIRS)
def test_the_interval_of_a_paired_difference_of_times_covers_it_in_19_of_20_studies(pairs: int) -> None:
    draw = np.random.default_rng([pairs, 1])
    hard = draw.lognormal(3.0, 0.3, (1, pairs, STUDIES))  # what a seed does to both methods
    ours, theirs = (hard + draw.normal(0.0, 1.5, hard.shape) for _ in range(2))
    share = covering("time", ours + 2.0, theirs, 2.0)
    print(f"time, {pairs} pairs: {share:.3f}")
    assert 0.93 <= share <= 0.985 or (pairs == 6 and share >= 0.93)


@pytest.mark.parametrize("pairs", PAIRS)
def test_the_interval_of_a_difference_of_success_covers_it_in_19_of_20_studies(pairs: int) -> None:
    draw = np.random.default_rng([pairs, 2])
    # Both fail where the seed is hard: successes of 0.85 and 0.6, a difference of 0.25.
    luck = draw.random((1, pairs, STUDIES))
    own = draw.random((2, 1, pairs, STUDIES)) < 0.3
    ours, theirs = (
        np.where(alone, draw.random(luck.shape) < share, luck < share).astype(float)
        for alone, share in zip(own, (0.85, 0.6), strict=True)
    )
    share = covering("success", ours, theirs, 0.25)
    print(f"success difference, {pairs} pairs: {share:.3f}")
    assert share >= 0.93


@pytest.mark.parametrize("pairs", PAIRS)
def test_the_interval_of_success_covers_it_in_at_least_19_of_20_studies(pairs: int) -> None:
    episodes = (np.random.default_rng([pairs, 3]).random((STUDIES, pairs)) < 0.8).astype(float)
    found = [share_interval(study[None, :], True) for study in episodes]
    share = float(np.mean([low <= 0.8 <= high for low, high in found]))
    print(f"success, {pairs} episodes: {share:.3f}")
    assert share >= 0.95

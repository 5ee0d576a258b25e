"""Confidence intervals of shares: textbook numbers, and coverage."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from navloom_study import METRICS, Metric
from navloom_study.binomial import difference_interval, exact_interval, share_interval
from navloom_study.statistics import compare_methods


@pytest.mark.parametrize(
    ("hits", "trials", "low", "high"),
    [
        # n of n: the probability that gives n of n in 2.5 % of cases is 0.025^(1/n).
        (50, 50, 0.025 ** (1 / 50), 1.0),
        (0, 20, 0.0, 1.0 - 0.025 ** (1 / 20)),
        (1, 1, 0.025, 1.0),
        # Clopper and Pearson's table: 8 of 10.
        (8, 10, 0.4439, 0.9748),
    ],
)
def test_an_exact_interval_is_that_of_the_table(hits: int, trials: int, low: float, high: float) -> None:
    assert exact_interval(hits / trials, trials) == pytest.approx((low, high), abs=5e-5)


def rows(outcomes: dict[str, np.ndarray[Any, Any]]) -> list[dict[str, Any]]:
    """A study of two metrics: success as given by (method, (worlds, seeds)), and spl half of it."""
    return [
        {"method": method, "world": f"w{w:02}", "seed": s, "outcome": "", "success": values[w, s],
         "spl": 0.5 * values[w, s], "time": 10.0 * (1.0 - values[w, s])}
        for method, values in outcomes.items()
        for w in range(values.shape[0])
        for s in range(values.shape[1])
    ]  # fmt: skip


def compared(outcomes: dict[str, np.ndarray[Any, Any]]) -> Any:
    metrics = [metric for metric in METRICS if metric.name in ("success", "spl", "time")]
    return compare_methods(rows(outcomes), next(iter(outcomes)), metrics, np.random.default_rng(0), 500)


@pytest.mark.parametrize(("worlds", "seeds"), [(50, 1), (5, 10), (1, 50)], ids=["worlds", "both", "seeds"])
def test_the_interval_of_fifty_of_fifty_is_wider_than_a_point(worlds: int, seeds: int) -> None:
    found = compared({"sure": np.ones((worlds, seeds))}).summary("sure", "success")
    assert (found.mean, found.high) == (1.0, 1.0) and found.low == pytest.approx(0.929, abs=1e-3)


def test_episodes_of_one_world_that_agree_count_as_one_trial() -> None:
    """50 worlds of 3 episodes each count as 50 trials; one failure does not make the interval narrower."""
    every = np.ones((50, 3))
    low, high = share_interval(every, few=False)
    assert (low, high) == pytest.approx((0.929, 1.0), abs=1e-3)
    every[0, 0] = 0.0
    assert share_interval(every, few=False)[0] < low


def test_equal_successes_do_not_prove_equal_methods() -> None:
    found = compared({"old": np.ones((50, 1)), "new": np.ones((50, 1))}).difference("new", "success").estimate
    assert found.mean == 0.0 and (found.low, found.high) == pytest.approx((-0.0711, 0.0711), abs=1e-4)


def test_no_interval_is_beyond_what_is_possible() -> None:
    rng = np.random.default_rng(5)
    many = {"old": (rng.random((12, 1)) < 0.1) * 1.0, "new": (rng.random((12, 1)) < 0.95) * 1.0}
    found = compared(many)
    for name, least, most in (("success", 0.0, 1.0), ("spl", 0.0, 1.0), ("time", 0.0, np.inf)):
        for method in many:
            one = found.summary(method, name)
            assert least <= one.low <= one.mean <= one.high <= most, name
    for name in ("success", "spl"):
        one = found.difference("new", name).estimate
        assert -1.0 <= one.low <= one.mean <= one.high <= 1.0


def test_bounds_cut_an_interval_that_the_resamples_would_take_further() -> None:
    """The bootstrap of 11 values of 1 and one of 0.2 reaches beyond 1; with the bound it ends at 1."""
    given = [
        {"method": "m", "world": f"w{k:02}", "seed": 0, "outcome": "", "x": 0.2 if k == 0 else 1.0} for k in range(12)
    ]
    free = Metric("x", "1", "higher", lambda trail: None, "X.")
    bounded = Metric("x", "1", "higher", lambda trail: None, "X.", (0.0, 1.0))
    ends = [
        compare_methods(given, "m", [m], np.random.default_rng(0), 2_000).summary("m", "x") for m in (free, bounded)
    ]
    assert ends[0].high > 1.0 and ends[1].high == 1.0 and ends[0].low == ends[1].low


def test_the_bounds_of_the_built_in_metrics() -> None:
    bounds = {metric.name: metric.bounds for metric in METRICS}
    assert all(bounds[name] == (0.0, 1.0) for name in ("success", "false_success", "spl", "danger_share"))
    assert (bounds["barn_2_8"], bounds["barn_4_8"]) == ((0.0, 0.5), (0.0, 0.25))
    assert {name for name, (least, _) in bounds.items() if least is None} == {"clearance_min", "clearance_p5"}
    assert [metric.name for metric in METRICS if metric.is_share] == ["success", "false_success", "false_tracking"]


def test_a_value_that_is_no_share_is_refused_with_its_place() -> None:
    given = [{"method": "m", "world": "w00", "seed": 0, "outcome": "", "success": 2.0}]
    success = next(metric for metric in METRICS if metric.name == "success")
    with pytest.raises(ValueError, match=r"success of m in w00 with seed 0 is 2\.0, expected 1 or 0"):
        compare_methods(given, "m", [success], np.random.default_rng(0), 100)


@pytest.mark.parametrize(
    ("worlds", "seeds", "few"), [(1, 20, True), (5, 4, True), (50, 1, False), (20, 3, False)], ids=str
)
def test_shares_and_their_differences_are_covered(worlds: int, seeds: int, few: bool) -> None:
    """Probabilities of success differ by world (Beta 2, 1); the other method has 0.85 of each."""
    rng, hits, runs = np.random.default_rng(9), np.zeros(2), 300
    for _ in range(runs):
        chance = rng.beta(2.0, 1.0, (worlds, 1))
        one = (rng.random((worlds, seeds)) < chance) * 1.0
        other = (rng.random((worlds, seeds)) < 0.85 * chance) * 1.0
        truth = float(chance.mean()) if few else 2.0 / 3.0
        share, difference = share_interval(one, few), difference_interval(one, other, few)
        hits += [share[0] <= truth <= share[1], difference[0] <= 0.15 * truth <= difference[1]]
    assert (hits / runs >= 0.93).all()

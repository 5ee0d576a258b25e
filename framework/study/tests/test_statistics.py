"""Intervals with coverage, tests with uniform p-values under the null, and comparisons checked by hand."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from navloom_study import Metric
from navloom_study.resampling import bootstrap, holm, holm_levels, intervals
from navloom_study.sign_flips import FlipTest, sign_flip_tests
from navloom_study.statistics import THESE_WORLDS, WORLDS_LIKE_THESE, Comparison, Estimate, compare_methods
from numpy.typing import NDArray

Floats = NDArray[np.float64]
ONE = np.zeros(1000, dtype=np.int64)
NAN = float("nan")


def column(*values: float) -> Floats:
    return np.array(values)[:, None]


def test_holm_on_a_textbook_family() -> None:
    # In order 0.005, 0.01, 0.03, 0.04, times 4, 3, 2, 1; the last may not fall below the one before.
    assert holm(np.array([0.01, 0.04, 0.03, 0.005])).tolist() == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm(np.array([0.7, 0.6])).tolist() == [1.0, 1.0]
    assert holm(np.array([])).tolist() == []


def p_values(units: Floats, strata: NDArray[np.int64], rng: np.random.Generator, resamples: int) -> list[float]:
    return [test.p for test in sign_flip_tests(units, strata, rng, resamples)]


def flips(*values: float, resamples: int = 10_000) -> FlipTest:
    return sign_flip_tests(column(*values), ONE[: len(values)], np.random.default_rng(0), resamples)[0]


def test_six_pairs_are_the_fewest_that_show_a_difference() -> None:
    # All six alike: 2 of 2^6 patterns. Of the shifts within the smallest and largest pair, at least 4 of 64 reach.
    six = flips(1.94, 2.18, 2.0, 2.01, 1.97, 2.02)
    assert (six.p, six.attainable) == (2 / 64, 2 / 64)
    assert six.interval() == pytest.approx((1.94, 2.18))
    five = flips(1.94, 2.18, 2.0, 2.01, 2.02)
    assert (five.p, five.attainable) == (2 / 32, 2 / 32)
    assert five.interval() == (-np.inf, np.inf)
    # At 90 %, one pattern and its opposite of 32 may be rejected: 2 / 32 = 0.0625.
    assert five.interval(0.90) == pytest.approx((1.94, 2.18))


def test_the_interval_of_nine_pairs_by_hand() -> None:
    # 0.05 * 2^9 = 25.6: 25 patterns, as 12 subsets and their opposites, and the one that flips all. So the end is the
    # 12th smallest mean of a subset of 1 … 9: 1, 1.5, 2, 2, 2, 7/3, 2.5, 2.5, 2.5, 8/3, 8/3, and 2.75 of 1, 2, 3, 5.
    assert flips(*range(1, 10)).interval() == pytest.approx((2.75, 7.25))


def test_the_sampled_interval_is_near_that_of_student_for_normal_pairs() -> None:
    values = np.random.default_rng(5).standard_normal(30)
    low, high = flips(*values).interval()
    reach = 2.045 * values.std(ddof=1) / np.sqrt(30.0)
    assert (low, high) == pytest.approx((values.mean() - reach, values.mean() + reach), abs=0.1 * reach)


@pytest.mark.parametrize("pairs", [6, 9, 30])
@pytest.mark.parametrize("strata", [1, 3])
def test_zero_is_outside_of_the_interval_exactly_if_the_test_rejects_it(pairs: int, strata: int) -> None:
    rng = np.random.default_rng(pairs)
    # Rounded, so that there are ties and zeros; shifted, so that about half of the columns are rejected.
    units = np.round(rng.standard_normal((pairs, 200)) + 2.2 / np.sqrt(pairs), 1)
    units[rng.random(units.shape) < 0.05] = np.nan
    units[0] = 0.0
    for level in (0.9, 0.95, 0.975):
        seen = set()
        for test in sign_flip_tests(units, np.arange(pairs) % strata, rng, 999):
            low, high = test.interval(level)
            is_rejected = test.p <= 1.0 - level + 1e-12
            assert (not low <= 0.0 <= high) == is_rejected
            assert test.p >= test.attainable or not is_rejected
            seen.add(is_rejected)
        assert pairs == 6 or seen == {True, False}


@pytest.mark.parametrize(
    ("chances", "levels"),
    [
        ([0.03], [0.95]),
        # 0.01 of three is compared with 0.05 / 3, then 0.03 with 0.05 / 2: not rejected, and no other is.
        ([0.03, 0.01, 0.04], [0.975, 1.0 - 0.05 / 3.0, 0.975]),
        ([0.02, 0.01], [0.95, 0.975]),
        ([0.2, 0.1], [0.975, 0.975]),
    ],
)
def test_the_level_of_an_interval_is_that_of_its_step_of_holm(chances: list[float], levels: list[float]) -> None:
    found = holm_levels(np.array(chances))
    assert found.tolist() == pytest.approx(levels)
    assert ((np.array(chances) <= 1.0 - found) == (holm(np.array(chances)) <= 0.05)).all()


@pytest.mark.parametrize(
    ("values", "strata", "chance"),
    [
        ([1.0, 2.0, 3.0], [0, 0, 0], 2 / 8),
        ([3.0, 1.0, -1.0], [0, 0, 0], 6 / 8),
        ([0.0, 0.0, 0.0], [0, 0, 0], 1.0),
        ([0.1, 0.2, -0.3], [0, 0, 0], 1.0),
        ([1.0, 2.0, NAN, 3.0], [0, 0, 0, 0], 2 / 8),
        # 1 counts twice as much as each of the others: 0.5 ± 0.25 ± 0.25.
        ([1.0, 1.0, 1.0], [0, 1, 1], 2 / 8),
        ([1.0, 1.0, -1.0], [0, 1, 1], 6 / 8),
    ],
    ids=["all", "mixed", "none", "balanced", "missing", "strata", "strata_mixed"],
)
def test_few_sign_flips_are_enumerated(values: list[float], strata: list[int], chance: float) -> None:
    assert p_values(column(*values), np.array(strata), np.random.default_rng(0), 100) == [chance]


def test_many_sign_flips_are_sampled() -> None:
    # 14 of 20 alike: as likely as 14 or more heads or tails of 20 coins, 0.1153.
    found = p_values(column(*[1.0] * 14, *[-1.0] * 6), ONE[:20], np.random.default_rng(0), 20_000)
    assert found[0] == pytest.approx(0.11532, abs=4 * np.sqrt(0.1153 * 0.8847 / 20_000))
    assert p_values(column(*[1.0] * 40), ONE[:40], np.random.default_rng(0), 1_000) == [1 / 1001]


def test_a_column_without_values_has_no_p_value_and_no_interval() -> None:
    units = np.array([[NAN, 1.0], [NAN, 2.0], [NAN, 4.0]])
    assert np.isnan(p_values(units, ONE[:3], np.random.default_rng(0), 100)).tolist() == [True, False]
    assert [np.isnan(part).tolist() for part in intervals(units, ONE[:3], np.random.default_rng(0), 100)] == [
        [True, False]
    ] * 3


@pytest.mark.parametrize("count", [12, 25], ids=["exact", "sampled"])
def test_p_values_are_uniform_under_the_null(count: int) -> None:
    rng = np.random.default_rng(7)
    chances = np.concatenate([p_values(rng.standard_normal((count, 50)), ONE[:count], rng, 999) for _ in range(12)])
    for level in (0.05, 0.2, 0.5, 0.8):
        spread = np.sqrt(level * (1.0 - level) / chances.size)
        assert np.mean(chances <= level) == pytest.approx(level, abs=3.5 * spread), level


def covered(rng: np.random.Generator, repetitions: int, few: bool, skewed: bool = False, whole: bool = False) -> float:
    """Share of 95 % intervals that contain the truth: clustered data, 30 columns in each repetition.

    Worlds differ by a deviation of 3, episodes of one world by 1. `few`: 5 worlds, whose mean is the truth; else 12,
    and the truth is the mean of all possible worlds. `whole`: treat episodes as independent.
    """
    hits = []
    for _ in range(repetitions):
        worlds, seeds = (5, 4) if few else (12, 4)
        level = 3.0 * (rng.standard_exponential((worlds, 1, 30)) if skewed else rng.standard_normal((worlds, 1, 30)))
        episodes = level + rng.standard_normal((worlds, seeds, 30))
        truth = level.mean(axis=(0, 1)) if few else np.full(30, 3.0 if skewed else 0.0)
        flat = episodes.reshape(-1, 30)
        if few:
            _, low, high = intervals(flat, np.repeat(np.arange(worlds), seeds), rng, 500)
        elif whole:
            _, low, high = intervals(flat, ONE[: len(flat)], rng, 500)
        else:
            _, low, high = intervals(episodes.mean(axis=1), ONE[:worlds], rng, 500)
        hits.append((low <= truth) & (truth <= high))
    return float(np.mean(hits))


@pytest.mark.parametrize(("few", "least", "most"), [(True, 0.92, 0.98), (False, 0.92, 0.98)], ids=["these", "like"])
def test_the_interval_covers_the_truth_of_clustered_data(few: bool, least: float, most: float) -> None:
    assert least <= covered(np.random.default_rng(11), 20, few) <= most


def test_intervals_of_episodes_treated_as_independent_cover_too_little() -> None:
    assert covered(np.random.default_rng(11), 20, few=False, whole=True) < 0.75


@pytest.mark.slow
@pytest.mark.parametrize("skewed", [False, True], ids=["normal", "skewed"])
@pytest.mark.parametrize("few", [True, False], ids=["these", "like"])
def test_the_interval_covers_the_truth_over_many_repetitions(few: bool, skewed: bool) -> None:
    # 12 worlds of a skewed distribution: no interval of a mean covers more than 0.90 to 0.93 there.
    least = 0.90 if skewed and not few else 0.935
    assert least <= covered(np.random.default_rng(3), 300, few, skewed) <= 0.965


def test_the_bootstrap_spreads_as_the_standard_error() -> None:
    values = np.random.default_rng(2).standard_normal((6, 3))
    drawn = bootstrap(values, ONE[:6], np.random.default_rng(0), 20_000)
    assert drawn.mean(axis=0) == pytest.approx(values.mean(axis=0), abs=0.02)
    assert drawn.std(axis=0) == pytest.approx(values.std(axis=0, ddof=1) / np.sqrt(6.0), rel=0.02)


def test_the_bootstrap_within_two_strata_spreads_as_its_standard_error() -> None:
    values = column(0.0, 2.0, 10.0, 14.0, 18.0)
    drawn = bootstrap(values, np.array([0, 0, 1, 1, 1]), np.random.default_rng(0), 20_000)
    # Half of each stratum's mean; variances of the means 2 / 2 and 16 / 3.
    assert drawn.mean() == pytest.approx(0.5 * (1.0 + 14.0), abs=0.04)
    assert drawn.std() == pytest.approx(0.5 * np.sqrt(1.0 + 16.0 / 3.0), rel=0.02)


def test_an_interval_of_equal_values_is_a_point() -> None:
    mean, low, high = intervals(column(*[0.25] * 12), ONE[:12], np.random.default_rng(0), 500)
    assert mean[0] == low[0] == high[0] == 0.25


def test_a_skewed_column_has_a_skewed_interval() -> None:
    values = column(*[0.0] * 15, 1.0, 2.0, 6.0)
    mean, low, high = intervals(values, ONE[:18], np.random.default_rng(0), 4_000)
    assert high[0] - mean[0] > 1.5 * (mean[0] - low[0]) > 0.0


SUCCESS = Metric("success", "1", "higher", lambda trail: None, "Success.")
TIME = Metric("time", "s", "lower", lambda trail: None, "Time.")
LENGTH = Metric("length", "m", None, lambda trail: None, "Length.")
ALL = (SUCCESS, TIME, LENGTH)


def row(method: str, world: str, seed: int, success: Any, time: Any, length: Any = 1.0) -> dict[str, Any]:
    outcome = "succeeded" if float(success) else "timeout"
    return {"method": method, "world": world, "seed": seed, "outcome": outcome, "success": success, "time": time,
            "length": length}  # fmt: skip


SMALL = [
    row("old", "hall", 0, 1, 10.0), row("old", "hall", 1, 1, 14.0), row("old", "door", 0, 0, 60.0),
    row("old", "door", 1, 1, 20.0), row("new", "hall", 0, 1, 9.0), row("new", "hall", 1, 1, 11.0),
    row("new", "door", 0, 1, 30.0, None), row("new", "door", 1, 0, 60.0),
]  # fmt: skip


def small(rows: list[dict[str, Any]] = SMALL, baseline: str = "old") -> Comparison:
    return compare_methods(rows, baseline, ALL, np.random.default_rng(4), 2_000)


def test_a_small_study_by_hand() -> None:
    found = small()
    assert (found.methods, found.worlds, found.seeds) == (("old", "new"), ("door", "hall"), (0, 1))
    assert found.scope == THESE_WORLDS and found.metrics == ("success", "time", "length")
    assert found.summary("old", "time").mean == 0.5 * (12.0 + 40.0)
    assert found.summary("new", "success").mean == 0.75
    time = found.difference("new", "time")
    assert time.estimate.mean == 0.5 * (-2.0 + 5.0) and (time.estimate.worlds, time.estimate.episodes) == (2, 4)
    assert time.unpaired == 0
    # Differences -1, -3 in the hall and -30, 40 in the door: of 16 patterns, all 8 with the 30 and 40 alike reach 6,
    # and of the other 8 those with 10 and at most -4 against it.
    assert (
        time.p
        == sum(abs(a + 3 * b + 30 * c + 40 * d) >= 6.0 for a, b, c, d in itertools.product((-1, 1), repeat=4)) / 16
    )
    assert found.difference("new", "success").p == 1.0
    # Four pairs, all of which differ in time. Success is the primary metric; two pairs that differ show nothing.
    assert (time.attainable, time.p_holm, time.estimate.low) == (2 / 16, None, None)
    success = found.difference("new", "success")
    assert (success.attainable, success.p_holm, success.is_primary) == (2 / 4, 1.0, True)
    assert found.outcomes == {"old": {"succeeded": 3, "timeout": 1}, "new": {"succeeded": 3, "timeout": 1}}


def test_a_pair_with_one_side_undefined_is_left_out_and_counted() -> None:
    length = small().difference("new", "length")
    assert (length.unpaired, length.estimate.episodes, length.estimate.mean) == (1, 3, 0.0)
    assert length.p is None and length.p_holm is None
    missing = small(SMALL[:-1]).difference("new", "time")
    assert missing.unpaired == 1 and missing.estimate.mean == 0.5 * (-2.0 - 30.0)
    assert (missing.estimate.low, missing.estimate.high) == (None, None)


def test_the_worst_worlds_come_first_with_their_worst_episode() -> None:
    worst = small().worst
    assert [(w.world, w.episodes, w.failures, w.seed, w.outcome) for w in worst["old"]] == [
        ("door", 2, 1, 0, "timeout"),
        ("hall", 2, 0, 1, "succeeded"),
    ]
    assert [w.seed for w in worst["new"]] == [1, 1]
    rows = [row("old", f"w{n}", 0, n > 2, 10.0 + n) for n in range(8)]
    assert [w.world for w in small(rows).worst["old"]] == ["w2", "w1", "w0", "w7", "w6"]


def many(worlds: int, better: float = 0.0) -> Iterator[dict[str, Any]]:
    """Rows of worlds with two seeds: the new method is faster by given s, with noise of 1 s."""
    rng = np.random.default_rng(12)
    for number, seed in itertools.product(range(worlds), range(2)):
        base = 20.0 + number
        yield row("old", f"w{number:02}", seed, 1, base + rng.standard_normal())
        yield row("new", f"w{number:02}", seed, 1, base - better + rng.standard_normal())


def ends(estimate: Estimate) -> tuple[float, float]:
    assert estimate.low is not None and estimate.high is not None
    return estimate.low, estimate.high


def test_ten_worlds_speak_for_others_and_nine_do_not() -> None:
    assert small(list(many(10))).scope == WORLDS_LIKE_THESE
    assert small(list(many(9))).scope == THESE_WORLDS


def test_pairing_finds_what_the_spread_between_worlds_would_hide() -> None:
    found = small(list(many(30, better=2.0)))
    low, high = ends(found.difference("new", "time").estimate)
    assert -2.8 < low < -2.0 < high < -1.2 and 0.5 < high - low < 1.0
    assert found.difference("new", "time").p == pytest.approx(1 / 2001)
    apart = [ends(found.summary(method, "time")) for method in ("old", "new")]
    assert apart[0][0] < apart[1][1]


def test_one_seed_suffices_for_many_worlds_and_not_for_few() -> None:
    once = [one for one in many(12, better=3.0) if one["seed"] == 0]
    assert ends(small(once).difference("new", "time").estimate)[1] < 0.0
    few = small([one for one in once if one["world"] < "w05"]).difference("new", "time")
    assert few.estimate.low is None and few.p == 2 / 2**5


def test_rows_may_be_text_and_their_order_sets_only_the_order_of_methods() -> None:
    written = [{key: "" if value is None else str(value) for key, value in one.items()} for one in SMALL]
    assert small(written) == small()
    turned = [*SMALL[:1], *reversed(SMALL[1:])]
    assert small(turned) == small()


def test_the_same_stream_gives_the_same_comparison() -> None:
    rows = list(many(12))
    assert small(rows) == small(rows)
    other = compare_methods(rows, "old", ALL, np.random.default_rng(5), 2_000)
    assert other.summary("old", "time") != small(rows).summary("old", "time")


@pytest.mark.parametrize(
    ("rows", "baseline", "refusal"),
    [
        ([], "old", "rows: there are none"),
        (SMALL, "odl", "baseline 'odl': no such method in the rows; did you mean old?"),
        ([*SMALL, SMALL[0]], "old", "rows: old in hall with seed 0 is there twice"),
        ([{k: v for k, v in one.items() if k != "time"} for one in SMALL], "old", "rows: no column 'time'"),
        ([*SMALL, row("new", "x", 0, 1, "fast")], "old", "rows: time of new in x with seed 0 is 'fast', expected a"),
        ([*SMALL, row("new", "x", 0, 1, "nan")], "old", "rows: time of new in x with seed 0 is 'nan', expected a"),
    ],
    ids=["none", "baseline", "twice", "column", "text", "nan"],
)
def test_rows_that_cannot_be_compared_are_refused(rows: list[dict[str, Any]], baseline: str, refusal: str) -> None:
    with pytest.raises(ValueError) as caught:
        small(rows, baseline)
    assert str(caught.value).startswith(refusal)


def test_a_pair_that_was_not_compared_is_a_key_error() -> None:
    with pytest.raises(KeyError):
        small().summary("old", "spl")
    with pytest.raises(KeyError):
        small().difference("old", "time")


@pytest.mark.benchmark
def test_a_thousand_worlds_and_twenty_metrics_take_seconds(benchmark: Any) -> None:
    rng = np.random.default_rng(0)
    metrics = [Metric(f"m{k}", "1", "lower", lambda trail: None, "One.") for k in range(20)]
    rows = [
        {"method": method, "world": f"w{w:04}", "seed": 0, "outcome": "succeeded"}
        | {metric.name: value for metric, value in zip(metrics, rng.standard_normal(20).tolist(), strict=True)}
        for method in ("old", "new")
        for w in range(1000)
    ]
    run = lambda: compare_methods(rows, "old", metrics, np.random.default_rng(0), 10_000)  # noqa: E731
    assert len(benchmark.pedantic(run, rounds=1).worlds) == 1000
    assert benchmark.stats.stats.min < 30.0

"""The sentences of a study agree with its intervals and tests; worlds that tested nothing are left out."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
import pytest
from navloom_study import METRICS, Metric
from navloom_study.episode_key import EpisodeKey
from navloom_study.episode_rows import Row
from navloom_study.statistics import Comparison, compare_methods
from navloom_study.tested_worlds import untested_worlds, without_untested
from navloom_study.verdict import verdicts

SUCCESS, SPL, TIME = (metric for metric in METRICS if metric.name in ("success", "spl", "time"))
ASKED = (SUCCESS, SPL, TIME)
Values = tuple[float, float, float]


def study(
    *methods: Sequence[Values], worlds: int = 3, metrics: Sequence[Metric] = ASKED, primary: Sequence[str] = ()
) -> Comparison:
    """A comparison of methods `a` (the baseline), `b`, …: success, spl and time by episode, dealt to the worlds."""
    rows = [
        {"method": name, "world": f"w{k % worlds}", "seed": k // worlds, "outcome": "succeeded" if one[0] else "stuck",
         **{metric.name: value for metric, value in zip(ASKED, one, strict=True)}}
        for name, told in zip("abcd", methods, strict=False)
        for k, one in enumerate(told)
    ]  # fmt: skip
    asked = {"primary": primary} if primary else {}
    return compare_methods(rows, "a", metrics, np.random.default_rng(0), **asked)


def sentences(found: Comparison) -> list[str]:
    return verdicts(found, ASKED, {})


def test_six_pairs_that_all_differ_are_told_apart() -> None:
    found = study([(0, 0.0, 60.0)] * 6, [(1, 0.9, 20.0)] * 6)
    (told,) = sentences(found)
    # 2 of 2^6 sign patterns; Newcombe's interval of 6 of 6 against 0 of 6, whose ends are 0.459 from each share.
    assert told.startswith("b is better than a in success, for these worlds only: b has +100.0 points (95 % interval ")
    assert "to +100.0, p 0.031, 6 pairs)." in told
    assert "Exploratory, unadjusted, against a: spl +0.900 (95 % interval +0.900 to +0.900, p 0.031)" in told


def test_five_pairs_cannot_be_told_apart_however_clear_they_are() -> None:
    (told,) = sentences(study([(0, 0.0, 60.0)] * 5, [(1, 0.9, 20.0)] * 5, worlds=1))
    assert told == (
        "b and a cannot be told apart in success: the difference is +100.0 points, and no p below 0.062 is attainable, "
        "because too few of 5 pairs differ; drive more seeds or worlds."
    )


def test_equal_successes_leave_the_question_to_spl() -> None:
    # Times of 9 pairs differ by 1 to 9 s, SPL by 2 % of that: 2 / 2^9, and the 12th smallest mean of a subset.
    found = study([(1, 0.80, 30.0)] * 9, [(1, 0.80 + 0.02 * k, 30.0 - k) for k in range(1, 10)], worlds=1)
    (told,) = sentences(found)
    assert told == (
        "b is better than a in spl, for these worlds only: b has +0.100 (95 % interval +0.055 to +0.145, p 0.004, "
        "9 pairs). Exploratory, unadjusted, against a: time −5.00 s (95 % interval −7.25 to −2.75, p 0.004)."
    )
    assert not found.difference("b", "success").is_primary


def test_a_named_primary_metric_is_the_question() -> None:
    found = study([(1, 0.9, 20.0)] * 6, [(0, 0.0, 60.0)] * 6, primary=["time"])
    assert [d.metric for d in found.differences if d.is_primary] == ["time"]
    (told,) = sentences(found)
    assert told.startswith("a is better than b in time, for these worlds only: b has +40.0 s (95 % interval +40.0 to ")


def test_methods_equal_in_every_pair_are_called_equal() -> None:
    assert sentences(study([(1, 0.9, 20.0)] * 6, [(1, 0.9, 20.0)] * 6)) == [
        "b and a are equal in success in each of 6 pairs."
    ]


@pytest.mark.parametrize("pairs", [6, 9, 30])
@pytest.mark.parametrize("methods", [2, 4])
def test_sentence_interval_and_test_agree(pairs: int, methods: int) -> None:
    rng, kinds = np.random.default_rng(pairs), set()
    for _ in range(12):
        chances = rng.uniform(0.1, 1.0, methods)
        rows = [
            [(float(win), round(win * rng.uniform(0.8, 1.0), 3), round(60.0 - 30.0 * win, 1))
             for win in rng.random(pairs) < chance]
            for chance in chances
        ]  # fmt: skip
        found = study(*rows, worlds=3)
        for told, method in zip(sentences(found), found.methods[1:], strict=True):
            (asked,) = (d for d in found.differences if d.method == method and d.is_primary)
            assert asked.p_holm is not None and asked.p is not None and asked.attainable is not None
            low, high = asked.estimate.low, asked.estimate.high
            is_apart = low is not None and high is not None and not low <= 0.0 <= high
            assert is_apart == asked.is_shown == (asked.p_holm <= 0.05) == ("is better than" in told)
            assert ("cannot be told apart" in told) == (not asked.can_be_shown and asked.attainable < 1.0)
            kinds.add(re.sub(r"^(?:\S+) (?:and \S+ )?|(?<=is better than).*| in .*", "", told))
            for other in found.differences:
                if other.p is not None and other.estimate.low is not None and other.estimate.high is not None:
                    assert other.is_shown == (not other.estimate.low <= 0.0 <= other.estimate.high)
    assert "is better than" in kinds or (methods == 4 and pairs == 6)


def rows(shares: dict[str, tuple[float | None, float | None]], outcome: str = "succeeded") -> list[Row]:
    """One episode of the methods `a` and `b` in each world, with this share of the avoider."""
    return [
        Row(EpisodeKey(method, world, 0), outcome, "", {"avoider_share": share, "recoveries": 0.0}, "")
        for world, told in shares.items()
        for method, share in zip("ab", told, strict=True)
    ]


def test_a_world_in_which_no_avoider_drove_is_left_out() -> None:
    every = rows({"empty": (0.0, 0.0), "door": (0.0, 0.2), "real": (None, None), "box": (0.3, 0.1)})
    untested = untested_worlds(every, {"avoider.plugin": {}, "avoider.cell": {}})
    assert untested == {"avoider": ["empty"]}
    assert {row.key.world for row in without_untested(every, untested)} == {"door", "real", "box"}


def test_worlds_count_if_the_methods_differ_in_another_role_too() -> None:
    every = rows({"empty": (0.0, 0.0)})
    assert untested_worlds(every, {"avoider.plugin": {}, "controller.k3": {}}) == {}
    assert untested_worlds(every, {"planner.plugin": {}}) == {}
    assert untested_worlds(every, {"recovery.plugin": {}}) == {"recovery": ["empty"]}


def test_a_world_in_which_every_episode_failed_is_not_left_out() -> None:
    assert untested_worlds(rows({"empty": (0.0, 0.0)}, "error"), {"avoider.plugin": {}}) == {}


def test_a_study_that_tested_nothing_says_so_and_keeps_its_rows() -> None:
    every = rows({"empty": (0.0, 0.0)})
    untested = untested_worlds(every, {"avoider.plugin": {}})
    assert without_untested(every, untested) == every
    found = study([(1, 0.9, 20.0)] * 2, [(1, 0.9, 20.0)] * 2, worlds=1)
    assert verdicts(found, ASKED, {"avoider": ["w0"]})[-1] == (
        "The avoider never acted in 1 world, which tested nothing, so no world tested it: w0."
    )
    assert verdicts(found, ASKED, {"avoider": ["x", "y"]})[-1] == (
        "The avoider never acted in 2 worlds, which tested nothing and are left out of all means: x, y."
    )

"""The parts of a short run add up, and a fed run whose trace differs is refused."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

sys.path.insert(0, str(Path(__file__).parents[1]))
from engine_share import Answers, ShareError, Site, measured

SHORT = ("run.stop_after=3.0",)


def test_the_parts_of_a_short_run_add_up() -> None:
    share = measured("paper", 0, SHORT)
    parts = share.verbs_us + share.handover_us + share.reference_us + share.engine_us
    assert share.ticks >= 61  # 0 to 3 s, 0.05 s apart, and until the robot is at rest
    assert min(share.verbs_us, share.handover_us, share.reference_us) > 0.0
    assert 0.0 < share.standins_us < share.engine_us < share.run_us
    assert parts == pytest.approx(share.run_us, rel=0.5)


def test_standins_return_the_recorded_answers_in_order() -> None:
    answers, owner = Answers(), SimpleNamespace(verb=iter("ab").__next__)
    record = answers.recorder(0, Site("verbs", owner, "verb"))
    assert (record(), record()) == ("a", "b")
    recall = answers.standin(0, Site("verbs", None, ""))
    assert (recall(1), recall(2, 3)) == ("a", "b")


def test_runs_that_differ_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    def of_another_order(self: Answers, number: int, site: Site) -> Callable[..., Any]:
        following = iter(self.of_site[number][::-1]).__next__
        return lambda *given: following()

    monkeypatch.setattr(Answers, "standin", of_another_order)
    with pytest.raises(ShareError, match=r"expected the same of all|plugin breaks"):
        measured("paper", 0, SHORT)

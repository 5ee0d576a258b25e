"""Two operators at one robot: every request ends, in an answer or a typed error, and is carried out once at most."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import operators
import pytest

TWO_PROCESSES = (
    'live.processes={ think = ["mapper", "planner", "goal"], rest = ["platform", "localizer", "reference", '
    '"controller", "avoider", "recovery", "gate"] }'
)


def account(found: dict[str, Any], requests: int) -> None:
    """Check that every request ended in time, and that answered and received goals agree."""
    ended = {how: count for how, count in found["ended"].items() if not how.startswith("(")}
    assert sum(ended.values()) == requests and not [how for how in ended if "hangs" in how], found
    assert found["goals_answered_twice"] == 0 and found["longest_s"] < 7.0, found
    unanswered = sum(count for how, count in ended.items() if how == "submit Unanswered")
    assert found["goals_answered"] <= found["goals_of_the_robot"] <= found["goals_answered"] + unanswered, found


def test_every_goal_and_every_cancel_of_two_operators_is_answered(tmp_path: Path) -> None:
    found = operators.session(60, 1, kills=False, settings=["--set", TWO_PROCESSES], folder=tmp_path)
    account(found, 60)
    assert set(found["ended"]) == {"cancel answered", "submit answered"}


@pytest.mark.slow
@pytest.mark.parametrize("seed", [3, 5, 7])
@pytest.mark.parametrize("kills", [False, True])
def test_310_requests_of_two_operators_are_accounted_for(seed: int, kills: bool, tmp_path: Path) -> None:
    account(operators.session(310, seed, kills, [], tmp_path), 310)

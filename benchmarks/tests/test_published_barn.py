"""The campaign beside published scores of the BARN challenge: its rows and its table."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from navloom.config import load_config

sys.path.insert(0, str(Path(__file__).parents[1]))
from published_barn import CONFIG, PUBLISHED, ROWS, interval, table

ROW = {"row": "move_base", "seed": 0, "outcome": "succeeded", "contacts": 0, "arrived": True}


@pytest.mark.parametrize("name", ROWS)
def test_a_row_differs_from_its_method_by_what_its_changes_say(name: str) -> None:
    method, changes = ROWS[name]
    given, plain = (load_config(str(CONFIG), some, method=method) for some in (changes, []))
    assert (given.config == plain.config) is not bool(changes)
    assert (name in PUBLISHED) is ("+" not in name and name != "dwa")


def test_an_interval_is_over_worlds_and_not_over_drives() -> None:
    """Two drives in one world count as one: the mean of the worlds, 0.2 and 0.4, is 0.3, between both."""
    assert interval(["a", "a", "b"], [0.1, 0.3, 0.4]) == pytest.approx((0.3, 0.2, 0.4))


def test_a_drive_with_a_contact_is_no_success() -> None:
    good = {**ROW, "world": "a", "barn_2_8": 0.3, "time": 18.0}
    hit = {**ROW, "world": "b", "barn_2_8": 0.0, "time": 9.0, "contacts": 1, "outcome": "collision"}
    cells = [cell.strip() for cell in table([good, hit]).splitlines()[-1].strip("|").split("|")]
    assert cells == [
        "`move_base`", "2", "0.500 [0.000, 1.000]", "0.500 [0.000, 1.000]", "0.000", "0.000", "0.150 [0.000, 0.300]",
        "18.0/18.0/18.0",
    ]  # fmt: skip

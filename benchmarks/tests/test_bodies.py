"""The campaign of long bodies: the same episodes for every version, and its table."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1]))
from bodies import BODIES, drive, table, tasks


def test_an_episode_does_not_depend_on_how_many_there_are() -> None:
    few, many = (list(tasks(count, range(20), range(10), ["door", "post"])) for count in (15, 40))
    assert many[:15] == few
    assert [task.scene for task in many[5:15]] == ["door"] * 5 + ["post"] * 5


def test_the_base_is_in_each_quarter_of_a_body() -> None:
    quarters = {(body.front > body.rear, body.left > body.right) for body in BODIES if body.left != body.right}
    assert len(quarters) == 4
    assert max(body.front + body.rear for body in BODIES) == 1.5


def test_the_table_counts_contacts_and_arrivals() -> None:
    row = {"body": 0, "roomy": True, "outcome": "succeeded", "contacts": 0}
    rows = [row, row | {"outcome": "collision", "contacts": 2}, row | {"roomy": False, "outcome": "stuck"}]
    assert table(rows).splitlines()[-1].split() == ["all", "3", "1", "1", "of", "2", "0", "of", "1"]


@pytest.mark.slow
@pytest.mark.parametrize("number", [1, 37, 63, 120, 121])
def test_a_long_body_touches_nothing_at_doors_where_it_did(number: int) -> None:
    task = list(tasks(number + 1, range(20), range(len(BODIES)), ["door", "corner", "post"]))[number]
    assert drive(task)["contacts"] == 0

"""The campaign in DynaBARN's worlds: its table."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
from dynabarn import METHODS, table


def test_each_avoider_that_reads_tracks_has_a_row_with_and_one_without() -> None:
    assert {name.removesuffix("+tracks") for name in METHODS if "+" in name} == {"orca", "dwa", "mppi"}
    assert {"standing", "blind", "orca", "dwa", "mppi"} <= set(METHODS)


def test_the_table_counts_arrivals_by_truth_and_contacts_by_whose_they_are() -> None:
    """Of two, one arrived: Clopper and Pearson, 0.0126 to 0.9874. The robot that erred about its place is false."""
    row = {
        "method": "orca",
        "outcome": "succeeded",
        "code": "reached",
        "arrived": True,
        "own": 0,
        "others": 0,
        "time_s": 11.0,
    }
    rows = [row, row | {"arrived": False}]
    said = "| `orca` | 2 | 0.50 (0.01 to 0.99) | 0.00 (0.00 to 0.84) | 0.00 (0.00 to 0.84) | 1 | - | 11.0 |"
    assert table(rows).splitlines()[-1] == said
    hit = row | {"arrived": False, "outcome": "collision", "own": 1}
    assert "| 1.00 (0.16 to 1.00) |" in table([hit, hit])

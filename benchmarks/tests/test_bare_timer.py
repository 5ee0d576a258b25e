"""The bare timer counts late and skipped ticks; the tests hand in the clock."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1]))
from bare_timer import late_ticks


@pytest.mark.parametrize(
    ("over_ms", "ticks", "late"),
    [([], 49, 0), ([0, 9], 49, 0), ([0, 11], 49, 1), ([0, 45], 47, 2), ([0, 55], 47, 3)],
    ids=["in-time", "under-half", "over-half", "two-passed-over", "two-passed-over-and-late"],
)
def test_late_ticks(over_ms: list[int], ticks: int, late: int) -> None:
    now, extra = [0], iter(over_ms)

    def sleep(seconds: float) -> None:
        now[0] += round(seconds * 1e9) + next(extra, 0) * 1_000_000

    assert late_ticks(1.0, 50.0, lambda: now[0], sleep) == {"ticks": ticks, "late_ticks": late}

"""Record of the durations of steps."""

from __future__ import annotations

from navloom_live.live.step_times import KEPT, StepTimes


def test_the_newest_steps_are_kept_oldest_first() -> None:
    times = StepTimes()
    assert times.newest() == []
    for tick in range(KEPT + 2):
        times.note(tick, 10 * tick)
    assert len(times.newest()) == KEPT and times.newest()[0] == (2, 20)
    assert times.newest(2) == [(KEPT, 10 * KEPT), (KEPT + 1, 10 * KEPT + 10)]

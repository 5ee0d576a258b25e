"""Record of the durations of steps."""

from __future__ import annotations

from navloom_live.live.live_runner import STEPS_KEPT, StepTimes


def test_the_newest_steps_are_kept_oldest_first() -> None:
    times = StepTimes()
    assert times.newest() == []
    for tick in range(STEPS_KEPT + 2):
        times.note(tick, 10 * tick, 3 * tick)
    assert len(times.newest()) == STEPS_KEPT and times.newest()[0] == (2, 20)
    assert times.newest(2) == [(STEPS_KEPT, 10 * STEPS_KEPT), (STEPS_KEPT + 1, 10 * STEPS_KEPT + 10)]
    assert times.computed(1) == [(10 * STEPS_KEPT + 10, 3 * STEPS_KEPT + 3)]

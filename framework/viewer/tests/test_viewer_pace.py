"""Methods side by side begin together, follow the clock, and end together if one of them fails."""

from __future__ import annotations

import threading

import pytest
from navloom_viewer.side_by_side import Pace, Stopped


class Clock:
    """A wall clock that only advances in sleep."""

    def __init__(self) -> None:
        self.now = 100.0
        self.slept: list[float] = []

    def sleep(self, seconds: float) -> None:
        self.slept.append(seconds)
        self.now += seconds


def test_a_tick_waits_for_its_time_and_a_late_one_does_not() -> None:
    clock = Clock()
    pace = Pace(1, lambda: clock.now, clock.sleep)
    pace.begin()
    pace.wait_until(50_000_000)
    assert clock.slept == [pytest.approx(0.05)]
    clock.now += 1.0
    pace.wait_until(100_000_000)
    assert len(clock.slept) == 1


def test_runs_begin_together() -> None:
    pace = Pace(2)
    begun = threading.Event()

    def other() -> None:
        pace.begin()
        begun.set()

    thread = threading.Thread(target=other, daemon=True)
    thread.start()
    assert not begun.is_set()
    pace.begin()
    assert begun.wait(10.0)
    thread.join(10.0)


def test_if_one_run_fails_the_others_end() -> None:
    pace = Pace(2)
    pace.abort()
    with pytest.raises(threading.BrokenBarrierError):
        pace.begin()
    with pytest.raises(Stopped):
        pace.wait_until(0)

"""The platform's clock as others estimate it: newest stamp plus local time since then, never another host's clock."""

from __future__ import annotations

import pytest
from navloom_live.live.run_clock import RunClock


def test_time_goes_on_from_the_newest_stamp() -> None:
    here = [1_000]
    clock = RunClock(lambda: here[0])
    assert (clock.is_known, clock.now_ns(), clock.age_s(0), clock.silence_s()) == (False, -1, None, 0.0)
    clock.observe(50_000_000, 1_000, 1)
    here[0] += 30_000_000
    assert (clock.tick, clock.stamp_ns, clock.now_ns()) == (1, 50_000_000, 80_000_000)
    assert clock.age_s(50_000_000) == pytest.approx(0.03)
    assert clock.silence_s() == pytest.approx(0.03)
    clock.observe(100_000_000, here[0], 2)
    assert (clock.tick, clock.now_ns(), clock.silence_s()) == (2, 100_000_000, 0.0)

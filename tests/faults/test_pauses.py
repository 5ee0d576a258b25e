"""The watchers that tell pauses of the machine from those of a robot."""

from __future__ import annotations

import signal
import time
from pathlib import Path

import pytest
from fault_rig import until
from pauses import Pauses


def test_a_watcher_that_did_not_run_is_a_pause_of_that_time_only(tmp_path: Path) -> None:
    pauses = Pauses(tmp_path)
    assert pauses.longest(0, 2**62) is None
    pauses.start()
    try:
        watchers = pauses._watchers
        until(lambda: pauses.longest(0, 2**62) is not None or watchers[0].poll(), 20.0, "the watchers run")
        if watchers[0].poll() is not None:
            pytest.skip("this user may not have real-time priority")
        began = time.monotonic_ns()
        watchers[0].send_signal(signal.SIGSTOP)
        time.sleep(0.3)
        watchers[0].send_signal(signal.SIGCONT)
        until(lambda: (pauses.longest(began, 2**62) or 0.0) >= 0.29, 20.0, "the pause is recorded")
        assert (pauses.longest(0, began - 10**9) or 0.0) < 0.29
    finally:
        pauses.end()

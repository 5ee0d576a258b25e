"""`robot_cpu` reads a process and its descendants, and counts CPU shares and wake-ups."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1]))
from robot_cpu import Counts, CpuError, Sample, difference, sample


def test_shares_and_wake_ups_are_counted_by_process_and_thread() -> None:
    names = {1: "up", 2: "safe"}
    before = Sample(10.0, names, {(1, 1): ("main thread", Counts(1.0, 10, 0)), (2, 2): ("rx-0", Counts(0.0, 0, 0))})
    after = Sample(
        12.0,
        names,
        {
            (1, 1): ("main thread", Counts(1.5, 30, 4)),
            (2, 2): ("rx-0", Counts(0.2, 8, 0)),
            (2, 3): ("rx-0", Counts(0.2, 2, 0)),  # started within the window
        },
    )
    found = difference(before, after)
    assert (found["seconds"], found["cpu"], found["waits"]) == pytest.approx((2.0, 0.45, 15.0))
    assert found["processes"]["safe"]["by_thread"]["rx-0"] == pytest.approx(
        {"cpu": 0.2, "waits": 5.0, "preempted": 0.0, "threads": 2}
    )


def test_a_process_that_was_started_again_within_the_window_is_refused() -> None:
    with pytest.raises(CpuError, match="expected the same"):
        difference(Sample(0.0, {1: "up", 2: "safe"}), Sample(1.0, {1: "up", 3: "safe"}))


@pytest.mark.skipif(sys.platform != "linux", reason="/proc")
def test_a_process_and_what_it_started_are_read() -> None:
    child = subprocess.Popen(
        [sys.executable, "-c", "import subprocess, sys; subprocess.run([sys.executable, '-c', 'input()'])"],
        stdin=subprocess.PIPE,
    )
    try:
        while len(found := sample(child.pid).names) < 2:
            assert child.poll() is None
        assert found[child.pid] == "up"
    finally:
        child.communicate(b"\n", timeout=30)

"""Code that holds the GIL stops the heartbeat, whether it computes or sleeps; a stopped process is not blamed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable

import pytest
from navloom.kernel_progress import Kernels
from navloom_live.hosting.heartbeat import Heart, HeartMonitor, StopDetector

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="memory is shared by name on Linux only")
NODE = """
import ctypes, sys, threading, time
from navloom_live.hosting.heartbeat import Heart
sys.setswitchinterval(0.0005)
heart = Heart(sys.argv[1])
def hold():
    sys.stdin.readline()
    ctypes.PyDLL(None).sleep(60)     # sleeps, and holds the GIL
threading.Thread(target=hold, daemon=True).start()
print("+", flush=True)
while True:
    heart.beat()
    time.sleep(0.05)
"""


def watched(monitor: HeartMonitor, pid: int, until: Callable[[float], bool], limit: float) -> float:
    """The silence that ends a watch, s; or the last one after s."""
    began = time.monotonic()
    while time.monotonic() - began < limit:
        if until(silence := monitor.silence(pid)):
            break
        time.sleep(0.02)
    return silence


def test_a_node_that_holds_the_gil_asleep_falls_silent_and_one_that_is_stopped_does_not() -> None:
    monitor = HeartMonitor()
    node = subprocess.Popen(
        [sys.executable, "-c", NODE, monitor.path], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    try:
        assert node.stdout is not None and node.stdin is not None
        node.stdout.readline()
        assert watched(monitor, node.pid, lambda silence: silence > 0.6, 0.8) < 0.6
        os.kill(node.pid, signal.SIGSTOP)
        assert watched(monitor, node.pid, lambda silence: silence > 0.6, 1.2) < 0.6
        os.kill(node.pid, signal.SIGCONT)
        node.stdin.write("\n")
        node.stdin.flush()
        assert watched(monitor, node.pid, lambda silence: silence > 0.6, 20.0) > 0.6
    finally:
        node.kill()
        node.communicate()
        monitor.close()


def test_a_process_detects_that_it_was_stopped(monkeypatch: pytest.MonkeyPatch) -> None:
    times, switches = iter([0, 10**8, 9 * 10**9, 10**10]), iter([0, 1, 2, 500])
    monkeypatch.setattr(time, "monotonic_ns", lambda: next(times))
    monkeypatch.setattr("navloom_live.hosting.heartbeat._own_switches", lambda: next(switches))
    detector = StopDetector()
    assert detector.look() == 0
    assert detector.look() == 9 * 10**9  # 9 s in which it ran once
    assert detector.look() == 9 * 10**9  # 1 s in which it tried for the GIL again and again


def test_kernels_are_counted_before_the_first_beat_and_anew_after_a_restart() -> None:
    monitor = HeartMonitor()
    Heart(monitor.path).note_compiled(Kernels(9, 12, 40))
    assert (monitor.kernels, monitor.has_beaten) == (Kernels(9, 12, 40), False)
    monitor.reset()
    assert monitor.kernels == Kernels()
    monitor.close()

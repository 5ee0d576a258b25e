"""Descendants of a supervisor are found by their mark, and ended."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import pytest
from navloom_live.hosting.descendants import (
    MARK,
    PROCESS,
    Descendant,
    descendants,
    end_all,
    left_of,
    mark,
    reap_orphans,
)

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="only Linux shows the environment of a process")
DEAF = "import signal, time; signal.signal(15, signal.SIG_IGN); print('+', flush=True); time.sleep(60)"


def started(folder: Path, code: str, **more: str) -> subprocess.Popen[bytes]:
    process = subprocess.Popen(
        [sys.executable, "-c", code], env={**os.environ, **mark(folder), **more}, stdout=subprocess.PIPE
    )
    assert process.stdout is not None and process.stdout.read(1) == b"+"
    return process


def of(folder: Path) -> list[Descendant]:
    return [descendant for descendant in descendants() if descendant.folder == folder]


def test_a_marked_process_is_found_with_its_robot_and_what_started_it(tmp_path: Path) -> None:
    child = started(tmp_path, "import time; print('+', flush=True); time.sleep(60)", **{PROCESS: "drive"})
    try:
        (found,) = of(tmp_path)
        assert (found.pid, found.supervisor, found.process) == (child.pid, os.getpid(), "drive")
        assert str(found).startswith(f"process {child.pid} ({sys.executable} -c import time; print(")
        assert str(found).endswith(" of drive")
        assert not found.is_left and left_of(tmp_path) == []
    finally:
        child.kill()
        child.communicate()
    assert of(tmp_path) == []


def test_a_descendant_that_ignores_sigterm_is_killed_and_reaped(tmp_path: Path) -> None:
    child = started(tmp_path, DEAF)
    began = time.monotonic()
    ended: Sequence[Descendant] = end_all(lambda: of(tmp_path), 0.1)
    assert [descendant.pid for descendant in ended] == [child.pid] and 0.1 < time.monotonic() - began < 2.0
    with pytest.raises(ChildProcessError):  # reaped
        os.waitpid(child.pid, os.WNOHANG)
    child.communicate()


def test_orphans_of_a_known_group_are_reaped_and_children_of_others_are_not() -> None:
    ours, others = (subprocess.Popen(["true"], process_group=0) for _ in range(2))
    for process in (ours, others):
        os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
    reap_orphans({ours.pid}, set())
    with pytest.raises(ChildProcessError):
        os.waitpid(ours.pid, os.WNOHANG)
    assert others.wait(5) == 0 and ours.wait(5) == 0


def test_a_process_counts_as_left_over_though_its_supervisors_number_is_in_use_again(tmp_path: Path) -> None:
    child = started(tmp_path, DEAF, **{MARK: f"{os.getpid()}.12:{tmp_path}"})
    try:
        (found,) = left_of(tmp_path)
        assert found.pid == child.pid and found.is_left
    finally:
        child.kill()
        child.communicate()


def test_a_process_of_another_robot_is_not_touched(tmp_path: Path) -> None:
    child = started(tmp_path / "other", DEAF)
    try:
        assert end_all(lambda: left_of(tmp_path)) == [] and child.poll() is None
        assert MARK not in os.environ
    finally:
        child.send_signal(signal.SIGKILL)
        child.communicate()

"""Processes forked by the nursery: they belong to the supervisor, and outlive the nursery."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from navloom_live.hosting.descendants import descendants, mark
from navloom_live.hosting.fork_server import Nursery
from navloom_live.timing import FORK_SERVER_READY

pytestmark = pytest.mark.skipif(not Nursery.is_possible(), reason="only Linux gives a child of a child away")
CHILD = """
import os, signal, sys, time

def main():
    if os.fork() == 0:
        os.setsid()
        time.sleep(60)
    print("forked by", os.getppid(), "in its own group", os.getpgrp() == os.getpid(), flush=True)
    text = open(sys.argv[1]).read()
    if text == "deaf":
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        print("deaf", flush=True)
    elif text:
        return int(text)
    time.sleep(60)
"""


@pytest.fixture
def nursery(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Nursery]:
    (tmp_path / "child.py").write_text(CHILD, "utf-8")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    made = Nursery(tmp_path / "nursery.log", mark(tmp_path))
    made.start()
    yield made
    made.close()
    for descendant in descendants():
        if descendant.folder == tmp_path:
            os.kill(descendant.pid, signal.SIGKILL)


def spec(tmp_path: Path, text: str = "") -> Path:
    path = tmp_path / "spec"
    path.write_text(text, "utf-8")
    return path


def test_a_process_is_a_child_of_the_caller_and_its_end_is_reported(nursery: Nursery, tmp_path: Path) -> None:
    forked = nursery.fork("child", "child", spec(tmp_path, "7"), tmp_path / "log", FORK_SERVER_READY)
    assert forked is not None and forked.wait(20) == 7
    assert (tmp_path / "log").read_text("utf-8") == f"forked by {os.getpid()} in its own group True\n"
    assert forked.poll() == 7  # asked again


def test_forked_processes_outlive_the_nursery_which_is_replaced(nursery: Nursery, tmp_path: Path) -> None:
    forked = nursery.fork("child", "child", spec(tmp_path), tmp_path / "log", FORK_SERVER_READY)
    assert forked is not None
    assert nursery._process is not None
    nursery._process.kill()
    nursery._process.wait()
    assert nursery.fork("child", "child", spec(tmp_path), tmp_path / "log", 0.0) is None  # it has just begun
    assert forked.poll() is None
    again = nursery.fork("child", "child", spec(tmp_path), tmp_path / "log", FORK_SERVER_READY)
    assert again is not None and again.pid != forked.pid
    with pytest.raises(subprocess.TimeoutExpired):
        again.wait(0.01)
    for one in (forked, again):
        one.kill()
        assert one.wait(20) == -signal.SIGKILL
        one.send_signal(signal.SIGTERM)  # no process: nothing happens


def test_forked_processes_end_with_the_supervisor_even_stopped_ones(nursery: Nursery, tmp_path: Path) -> None:
    forked = nursery.fork("child", "child", spec(tmp_path), tmp_path / "log", FORK_SERVER_READY)
    assert forked is not None and nursery._line is not None and nursery._process is not None
    os.kill(forked.pid, signal.SIGSTOP)
    nursery._line.close()  # as its death would
    assert forked.wait(20) == -signal.SIGTERM
    assert nursery._process.wait(20) == 0
    assert not [
        descendant for descendant in descendants() if descendant.folder == tmp_path
    ]  # not even its fork, in another session


def test_a_process_that_ignores_sigterm_is_killed_within_5_s(nursery: Nursery, tmp_path: Path) -> None:
    forked = nursery.fork("child", "child", spec(tmp_path, "deaf"), tmp_path / "log", FORK_SERVER_READY)
    assert forked is not None and nursery._line is not None
    log = tmp_path / "log"
    while not log.exists() or "deaf\n" not in log.read_text("utf-8"):
        assert forked.poll() is None
    nursery._line.close()
    assert forked.wait(20) == -signal.SIGKILL


def test_no_process_starts_where_the_nursery_cannot_start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", "/bin/false")
    made = Nursery(tmp_path / "nursery.log")
    made.start()
    assert made.fork("child", "child", spec(tmp_path), tmp_path / "log", 1.0) is None
    made.close()

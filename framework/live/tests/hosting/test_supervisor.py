"""The supervisor restarts crashed processes after longer and longer waits, and at last not any more."""

from __future__ import annotations

import errno
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from navloom.config import load_config
from navloom.config.tables import LiveTable
from navloom.engine.build import assemble
from navloom_live.hosting.descendants import MARK, PROCESS, descendants
from navloom_live.hosting.process_log import LARGEST_LOG
from navloom_live.hosting.process_tasks import ProcessTask
from navloom_live.hosting.runtime_folders import RobotFolder
from navloom_live.hosting.supervisor import Supervisor
from navloom_live.live.live_node_builder import all_sources
from navloom_live.live.node_placement import spread
from navloom_live.operating.host_faults import restarting

STUBBORN = """
import ctypes, json, os, signal, sys, threading, time
spec = json.load(open(sys.argv[1]))
print("started", flush=True)
for has_session in spec.get("forks", ()):
    if os.fork() == 0:
        if has_session:
            os.setsid()
        time.sleep(60)
if spec.get("floods"):
    print("x" * 5_000_000, flush=True)
    while os.fstat(1).st_size > spec["floods"]:  # what is written during a cut may be lost
        time.sleep(0.01)
    print("the last word", flush=True)
if spec.get("holds"):
    from navloom_live.hosting.heartbeat import Heart
    heart = Heart(spec["heart"])
    heart.beat()
    threading.Thread(target=ctypes.PyDLL(None).sleep, args=(60,), daemon=True).start()
    time.sleep(0.01)
if spec.get("crashes"):
    sys.exit(3)
if spec.get("stubborn"):
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
open(spec["mark"], "w").close()
while True:
    time.sleep(0.05)
"""


@pytest.fixture
def rig(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[RobotFolder, list[str]]:
    (tmp_path / "child_of_test.py").write_text(STUBBORN, "utf-8")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setenv("NAVLOOM_RUNTIME_DIR", str(tmp_path / "rt"))
    folder = RobotFolder("lab", "r1")
    folder.make()
    return folder, []


def supervisor(
    rig: tuple[RobotFolder, list[str]], live: LiveTable, patience: float | None = None, **given: object
) -> Supervisor:
    folder, said = rig
    given = {"mark": str(mark_of(rig)), **given}
    task = ProcessTask("child", "child_of_test", given, frozenset({"avoider"}), patience)
    return Supervisor(live, folder, [task], said.append)


def mark_of(rig: tuple[RobotFolder, list[str]]) -> Path:
    """File that the child creates once it runs."""
    return rig[0].path.parent / "mark"


def until(condition: object, keeper: Supervisor, timeout: float = 30.0) -> None:
    limit = time.monotonic() + timeout
    while not condition():  # type: ignore[operator]
        assert time.monotonic() < limit, "it did not happen"
        keeper.poll()
        time.sleep(0.005)


def test_a_crash_loop_ends_with_the_process_down_and_its_last_output(
    rig: tuple[RobotFolder, list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "navloom_live.hosting.supervisor.HEALTHY_AFTER", 60.0
    )  # a loaded machine takes seconds to start one
    keeper = supervisor(rig, LiveTable(restart_limit=2, restart_window=60.0), crashes=True)
    keeper.start()
    child = keeper.children["child"]
    until(lambda: child.state == "failed", keeper)
    assert child.restarts == 2
    assert rig[1][0] == "process child ended with code 3; it restarts in 0.1 s. Its last message: started"
    assert rig[1][1].startswith("process child ended with code 3; it restarts in 0.2 s.")
    assert rig[1][2].startswith(
        "process child ended with code 3, 3 times within 60 s: it stays down. Its last message: started"
    )
    keeper.stop()


def test_a_killed_process_is_restarted(rig: tuple[RobotFolder, list[str]]) -> None:
    keeper = supervisor(rig, LiveTable())
    keeper.start()
    child, mark = keeper.children["child"], mark_of(rig)
    until(mark.exists, keeper)
    assert child.process is not None
    first = child.process.pid
    mark.unlink()
    os.kill(first, signal.SIGKILL)
    until(mark.exists, keeper)
    assert child.process is not None and child.process.pid != first
    assert "was ended by SIGKILL" in rig[1][0]
    keeper.stop()
    assert child.process is None


def test_a_process_that_ignores_sigterm_is_killed_even_when_stopped(rig: tuple[RobotFolder, list[str]]) -> None:
    keeper = supervisor(rig, LiveTable(), stubborn=True)
    keeper.start()
    until(mark_of(rig).exists, keeper)
    process = keeper.children["child"].process
    assert process is not None
    os.kill(process.pid, signal.SIGSTOP)
    began = time.monotonic()
    keeper.stop()
    assert process.returncode == -signal.SIGKILL and time.monotonic() - began < 5.0


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux shows the environment of a process")
def test_the_children_of_a_process_end_before_it_is_restarted(rig: tuple[RobotFolder, list[str]]) -> None:
    keeper = supervisor(rig, LiveTable(), forks=[False, True])
    keeper.start()
    child = keeper.children["child"]
    until(mark_of(rig).exists, keeper)
    assert child.process is not None
    first = child.process.pid
    below = [
        descendant.pid for descendant in descendants() if descendant.folder == rig[0].path and descendant.pid != first
    ]
    assert len(below) == 2
    os.kill(first, signal.SIGKILL)
    until(lambda: child.restarts, keeper)
    until(lambda: not any(Path(f"/proc/{pid}").exists() for pid in below), keeper)  # nor as a zombie
    assert rig[1][0].startswith("ended programs that process child had started: process ")
    assert rig[1][0].count(" of child") == 2
    keeper.stop()
    assert not [descendant for descendant in descendants() if descendant.folder == rig[0].path]


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux shows the environment of a process")
def test_processes_left_over_by_an_earlier_supervisor_are_ended_first(rig: tuple[RobotFolder, list[str]]) -> None:
    left = subprocess.Popen(["sleep", "60"], env={**os.environ, MARK: f"1:{rig[0].path}", PROCESS: "drive"})
    while left.pid not in [
        descendant.pid for descendant in descendants()
    ]:  # its environment appears a moment after its start
        time.sleep(0.005)
    keeper = supervisor(rig, LiveTable())
    keeper.start()
    left.wait(5.0)
    ended = f"process {left.pid} (sleep 60) of drive"
    assert rig[1] == [f"ended processes left by an earlier robot of this name: {ended}"]
    keeper.stop()


@pytest.mark.skipif(sys.platform != "linux", reason="memory is shared by name on Linux only")
def test_a_process_in_which_code_holds_the_gil_and_sleeps_is_killed(rig: tuple[RobotFolder, list[str]]) -> None:
    keeper = supervisor(rig, LiveTable(), patience=0.6, holds=True)
    keeper.start()
    child = keeper.children["child"]
    until(lambda: child.state == "waiting", keeper)
    assert child.why == "was ended: a node held the GIL for 0.6 s"
    until(lambda: child.state == "running", keeper)
    keeper.poll()
    assert not child.verdict  # the restarted process is not judged by the last heartbeat of the old one
    keeper.stop()


def test_a_deleted_folder_is_restored_and_restarts_go_on(rig: tuple[RobotFolder, list[str]]) -> None:
    folder, said = rig
    assert folder.lock()
    keeper = supervisor(rig, LiveTable())
    keeper.start()
    child, mark = keeper.children["child"], mark_of(rig)
    until(mark.exists, keeper)
    shutil.rmtree(folder.path)
    mark.unlink()
    assert child.process is not None
    os.kill(child.process.pid, signal.SIGKILL)
    until(mark.exists, keeper)
    assert folder.fates()["child"].restarts == 1 and folder.is_claimed()
    assert said[0] == f"runtime folder {folder.path} was deleted and is made again; the robot continues"
    keeper.stop()
    folder.unlock()


def test_a_full_disk_is_reported_once_and_ends_no_process(
    rig: tuple[RobotFolder, list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, said = rig
    keeper = supervisor(rig, LiveTable())

    def full(path: Path, content: str) -> None:
        raise OSError(errno.ENOSPC, "No space left on device", str(path))

    with monkeypatch.context() as disk:
        disk.setattr("navloom_live.hosting.runtime_folders.write_whole", full)
        keeper.start()
        child, mark = keeper.children["child"], mark_of(rig)
        until(mark.exists, keeper)
        mark.unlink()
        assert child.process is not None
        os.kill(child.process.pid, signal.SIGKILL)
        until(mark.exists, keeper)
    assert [line for line in said if "No space" in line] == [
        f"[Errno 28] No space left on device: '{folder.path / 'fates.json'}'; the robot continues, "
        "but `navloom doctor` does not see the state of its processes"
    ]
    until(lambda: folder.fates(), keeper)  # written once there is space
    keeper.stop()


def test_the_log_of_a_process_that_prints_much_is_cut_and_keeps_its_last_lines(
    rig: tuple[RobotFolder, list[str]],
) -> None:
    folder, said = rig
    keeper = supervisor(rig, LiveTable(), floods=LARGEST_LOG)
    keeper.start()
    child = keeper.children["child"]
    until(mark_of(rig).exists, keeper)
    keeper.poll()
    assert sum(path.stat().st_size for path in folder.path.glob("child.log*")) < LARGEST_LOG + 200
    assert keeper.tail(child, 1) == "the last word"
    assert said == [
        f"process child writes too much: the last 2 MB each are kept of {folder.path / 'child.log'} and child.log.1"
    ]
    until(lambda: folder.fates()["child"].cut, keeper)
    cut = child.log.cut
    assert folder.fates()["child"].cut == cut > 1_000_000  # of 2.9 MB: what is written while it is cut is not counted
    (found,) = restarting(folder, ())
    assert found.what == f"process child writes so much that {cut / 1e6:.1f} MB of its log were dropped"
    keeper.stop()


def test_every_node_is_spread_once_and_alternatives_live_with_their_role_unless_placed() -> None:
    other = ["alternative=[{name='a2', role='avoider', plugin='improved_vfh'}]"]
    loaded = load_config("paper", other)
    sources = all_sources(assemble(loaded))
    shares = spread(loaded.config, sources, None)
    assert list(shares) == ["robot", "think", "drive", "safe"]
    assert ("avoider", "a2") in shares["drive"] and sum(map(len, shares.values())) == len(sources) - 1
    roles = '"platform", "localizer", "mapper", "planner", "goal", "reference", "controller", "avoider", "recovery"'
    split = f'live.processes={{a=[{roles}, "gate"], b=["avoider.a2"]}}'
    placed = load_config("paper", [*other, split, 'live.hosts={x=["b"]}'])
    assert spread(placed.config, sources, None)["b"] == (("avoider", "a2"),)
    assert list(spread(placed.config, sources, "x")) == ["b"]

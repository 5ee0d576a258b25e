"""The supervisor's states, counts and signals with several processes that a test pretends, on a clock of its own."""

from __future__ import annotations

import shutil
import signal
import subprocess
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from navloom.config.tables import LiveTable
from navloom_live.hosting import supervisor as module
from navloom_live.hosting.heartbeat import HeartMonitor
from navloom_live.hosting.node_process import HUNG
from navloom_live.hosting.process_setup import SEIZED
from navloom_live.hosting.process_tasks import ProcessTask
from navloom_live.hosting.runtime_folders import RobotFolder
from navloom_live.hosting.supervisor import Supervisor, Worker

LIVE = LiveTable(restart_limit=2, restart_window=30.0)


class Process:
    """A process that ends when the test says so; `signals` keeps what it was sent."""

    def __init__(self, pid: int, name: str, sent: list[tuple[str, str]]) -> None:
        self.pid, self.name, self.sent = pid, name, sent
        self.returncode: int | None = None
        self.ignores = False

    def poll(self) -> int | None:
        return self.returncode

    def send_signal(self, number: int) -> None:
        self.sent.append((self.name, signal.Signals(number).name))
        if number == signal.SIGTERM and not self.ignores:
            self.returncode = 0

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)
        self.returncode = -9

    def wait(self, timeout: float | None = None) -> int:
        if self.returncode is None:
            raise subprocess.TimeoutExpired(self.name, timeout or 0.0)
        return self.returncode


class Robot:
    """A supervisor of pretended processes. `started` has their names, `said` its messages, `sent` all signals."""

    def __init__(self, folder: RobotFolder, roles: dict[str, str], live: LiveTable = LIVE) -> None:
        self.now, self.pids = 1000.0, 100
        self.started: list[Process] = []
        self.said: list[str] = []
        self.sent: list[tuple[str, str]] = []
        self.ended: list[tuple[str, int]] = []
        self.supervisor = Supervisor(live, folder, [task(name, role) for name, role in roles.items()], self.said.append)

    def popen(self, module: str, spec: Path, log: Any, environment: Any) -> Process:
        self.pids += 1
        process = Process(self.pids, environment["NAVLOOM_PROCESS"], self.sent)
        self.started.append(process)
        return process

    def poll(self, later: float = 0.0, restarts: bool = True) -> list[str]:
        """Names of the processes that ended."""
        self.now += later
        return [child.task.name for child in self.supervisor.poll(restarts)]

    def crash(self, name: str, code: int = 3) -> None:
        process: Any = self[name].process
        process.returncode = code

    def __getitem__(self, name: str) -> Worker:
        return self.supervisor.children[name]

    def names(self) -> list[str]:
        return [process.name for process in self.started]


def task(name: str, role: str = "avoider", patience: float | None = None) -> ProcessTask:
    return ProcessTask(name, "pretended", {}, frozenset({role} if role else ()), patience)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> RobotFolder:
    monkeypatch.setenv("NAVLOOM_RUNTIME_DIR", str(tmp_path / "rt"))
    made = RobotFolder("lab", "r1")
    made.make()
    return made


def robot_of(folder: RobotFolder, monkeypatch: pytest.MonkeyPatch, live: LiveTable = LIVE, **roles: str) -> Robot:
    robot = Robot(folder, roles or {"drive": "avoider", "safe": "gate", "base": "platform"}, live)
    monkeypatch.setattr(module, "_popen", robot.popen)
    monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: robot.now))
    monkeypatch.setattr(module, "end_all", lambda *given: [])
    monkeypatch.setattr(module, "reap_orphans", lambda groups, own: robot.ended.extend(sorted(own)))
    robot.supervisor.start()
    return robot


@pytest.fixture
def robot(folder: RobotFolder, monkeypatch: pytest.MonkeyPatch) -> Robot:
    return robot_of(folder, monkeypatch)


# --- restarts ---------------------------------------------------------------------------------------------------------


def test_each_process_has_its_own_state(robot: Robot) -> None:
    first = robot["drive"].process
    robot.crash("safe")
    assert robot.poll() == ["safe"] and robot.poll() == []
    assert [robot[name].state for name in ("drive", "safe", "base")] == ["running", "waiting", "running"]
    assert robot["safe"].process is None and robot["drive"].process is first
    assert robot.poll(0.099) == [] and robot.names() == ["drive", "safe", "base"]
    robot.poll(0.001)
    assert robot.names() == ["drive", "safe", "base", "safe"]
    assert [robot[name].restarts for name in ("drive", "safe", "base")] == [0, 1, 0]
    assert robot["safe"].state == "running" and robot["safe"].process is robot.started[-1]


def test_two_processes_that_end_at_once_are_both_restarted(robot: Robot) -> None:
    robot.crash("drive")
    robot.crash("base", -9)
    assert robot.poll() == ["drive", "base"]
    assert (robot["drive"].why, robot["base"].why) == ("ended with code 3", "was ended by SIGKILL")
    robot.poll(0.11)
    assert robot.names()[3:] == ["drive", "base"]


def test_the_wait_doubles_with_each_crash_up_to_5_s(folder: RobotFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    robot = robot_of(folder, monkeypatch, LiveTable(restart_limit=50, restart_window=600.0), drive="avoider")
    waits = []
    for _ in range(8):
        robot.crash("drive")
        robot.poll()
        waits.append(robot["drive"].again_at - robot.now)
        robot.poll(waits[-1] + 1e-6)
    assert waits == pytest.approx([0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 5.0, 5.0])


@pytest.mark.parametrize(("healthy", "wait"), [(5.0, 0.2), (5.01, 0.1)])
def test_a_process_that_ran_for_5_s_begins_with_the_first_wait(robot: Robot, healthy: float, wait: float) -> None:
    robot.crash("drive")
    robot.poll()
    robot.poll(0.25)
    robot.poll(healthy)
    robot.crash("drive")
    robot.poll()
    assert robot["drive"].again_at - robot.now == pytest.approx(wait)


@pytest.mark.parametrize(("later", "state"), [(29.0, "failed"), (31.0, "waiting")])
def test_a_process_stays_down_after_its_third_crash_within_the_window(robot: Robot, later: float, state: str) -> None:
    for pause in (0.5, later - 0.5, 0.5):
        robot.crash("drive")
        robot.poll()
        robot.poll(pause)
    assert robot["drive"].state == ("failed" if state == "failed" else "running")
    assert ("3 times within 30 s: it stays down" in robot.said[-1]) is (state == "failed")
    robot.poll(60.0)
    assert (robot.names().count("drive") == 3) is (state == "failed")


def test_a_crash_counts_until_the_window_is_over(robot: Robot) -> None:
    """Just 30 s after the first one it still counts."""
    for now in (1000.0, 1001.0, 1030.0):
        robot.now = now
        robot.crash("drive")
        robot.poll()
        if now < 1030.0:
            robot.poll(0.5)
    assert robot["drive"].state == "failed"


def test_without_restarts_a_process_waits(robot: Robot) -> None:
    robot.crash("drive")
    robot.poll()
    robot.poll(9.0, restarts=False)
    assert robot["drive"].state == "waiting"
    robot.poll()
    assert robot["drive"].state == "running"


@pytest.mark.parametrize(
    ("code", "why"),
    [(3, "ended with code 3"), (HUNG, "ended because a node hung"), (-11, "was ended by SIGSEGV"),
     (-SEIZED, "was ended: a node computed without releasing the GIL"), (-99, "ended with code -99")],
)  # fmt: skip
def test_how_a_process_ended(robot: Robot, code: int, why: str) -> None:
    robot.crash("drive", code)
    robot.poll()
    assert robot["drive"].why == why
    assert robot.said == [f"process drive {why}; it restarts in 0.1 s. Its last message: "]


def test_states_are_written_for_other_programs(robot: Robot, folder: RobotFolder) -> None:
    assert {name: (fate.pid, fate.state) for name, fate in folder.fates().items()} == {
        "drive": (101, "running"), "safe": (102, "running"), "base": (103, "running"),
    }  # fmt: skip
    robot.crash("safe")
    robot.poll()
    fate = folder.fates()["safe"]
    assert (fate.pid, fate.state, fate.restarts, fate.why) == (None, "waiting", 0, "ended with code 3")
    robot.poll(0.2)
    fate = folder.fates()["safe"]
    assert (fate.pid, fate.state, fate.restarts) == (104, "running", 1)


def test_a_state_that_could_not_be_written_is_written_a_second_later(
    robot: Robot, folder: RobotFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    write, tried = RobotFolder.write_fates, list[float]()

    def fails(self: RobotFolder, fates: Any) -> None:
        tried.append(robot.now)
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(RobotFolder, "write_fates", fails)
    robot.crash("safe")
    robot.poll()
    for _ in range(12):
        robot.poll(0.25, restarts=False)
    assert tried == [1000.0, 1001.25, 1002.5] and sum("No space" in said for said in robot.said) == 1
    monkeypatch.setattr(RobotFolder, "write_fates", write)
    robot.poll(0.75, restarts=False)
    assert folder.fates()["safe"].state == "waiting"
    monkeypatch.setattr(RobotFolder, "write_fates", fails)
    robot.poll(9.0, restarts=False)
    assert len(tried) == 3, "nothing is left to write"
    robot.poll(1.0)
    assert sum("No space" in said for said in robot.said) == 2, "another failure is reported again"


# --- added processes --------------------------------------------------------------------------------------------------


def test_processes_may_be_added_to_a_running_robot(robot: Robot) -> None:
    robot.supervisor.add(task("more"))
    robot.supervisor.add(task("most"))
    assert robot.names() == ["drive", "safe", "base"]
    robot.poll()
    assert robot.names()[3:] == ["more", "most"]
    assert [robot[name].is_added for name in ("drive", "more", "most")] == [False, True, True]
    robot.supervisor.add(task("more"))
    robot.poll()
    assert len(robot.started) == 5, "it runs already"


def test_an_added_process_that_stays_down_may_be_added_again(robot: Robot) -> None:
    robot.supervisor.add(task("more"))
    robot.supervisor.add(task("most"))
    robot.poll()
    for pause in (0.5, 0.5, 0.5):
        robot.crash("more")
        robot.poll()
        robot.poll(pause)
    assert robot["more"].state == "failed"
    robot.supervisor.add(task("more"))
    robot.poll()
    assert robot["more"].state == "running" and robot.names()[-1] == "more"
    robot.crash("more")
    robot.poll()
    assert robot["more"].state == "waiting", "earlier crashes no longer count"


@pytest.mark.parametrize(
    ("name", "code", "beats", "state"),
    [
        ("more", 2, False, "failed"),
        ("more", 3, False, "waiting"),
        ("more", 2, True, "waiting"),
        ("drive", 2, False, "waiting"),
    ],
)
def test_an_added_process_that_is_unfit_stays_down_at_once(
    robot: Robot, monkeypatch: pytest.MonkeyPatch, name: str, code: int, beats: bool, state: str
) -> None:
    monkeypatch.setattr(HeartMonitor, "has_beaten", property(lambda self: beats))
    robot.supervisor.add(task("more"))
    robot.poll()
    robot.crash(name, code)
    assert robot.poll() == [name] and robot[name].state == state
    if state == "failed":
        assert robot.said[-1] == "process more ended with code 2: it stays down. Its last message: "


# --- processes that hang, and the end ---------------------------------------------------------------------------------


def test_a_process_that_holds_the_gil_is_asked_for_its_traceback_once_and_then_killed(
    folder: RobotFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot = robot_of(folder, monkeypatch)
    robot.supervisor.add(task("slow", patience=2.0))
    silences = {"slow": 2.0}
    monkeypatch.setattr(HeartMonitor, "silence", lambda self, pid: silences["slow"])
    robot.poll()
    robot.poll()
    assert robot.sent == []
    silences["slow"] = 2.01
    robot.poll()
    robot.poll()
    assert robot.sent == [("slow", signal.Signals(SEIZED).name)]
    silences["slow"] = 2.5
    robot.poll()
    assert len(robot.sent) == 1
    silences["slow"] = 2.51
    robot.poll()
    assert robot.sent[1:] == [("slow", "SIGKILL")]
    robot.poll()
    assert robot["slow"].why == "was ended: a node held the GIL for 2 s"
    silences["slow"] = 0.0
    robot.poll(0.2)
    robot.crash("slow")
    robot.poll()
    assert robot["slow"].why == "ended with code 3", "the verdict was on the one before"


def test_processes_end_in_order_and_each_is_woken(folder: RobotFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    robot = robot_of(folder, monkeypatch, router="", base="platform", safe="gate", drive="avoider", think="planner")
    robot.supervisor.stop()
    assert [name for name, sent in robot.sent if sent == "SIGTERM"] == ["drive", "think", "safe", "base", "router"]
    assert [sent for name, sent in robot.sent if name == "safe"] == ["SIGTERM", "SIGCONT"]
    assert all(robot[name].state == "ended" and robot[name].process is None for name in robot.names())


def test_a_process_that_ignores_the_end_is_killed_and_the_others_end(robot: Robot) -> None:
    process: Any = robot["drive"].process
    process.ignores = True
    waited: list[float | None] = []
    wait = process.wait

    def waits(timeout: float | None = None) -> int:
        waited.append(timeout)
        return int(wait(timeout))

    process.wait = waits
    robot.supervisor.stop()
    assert ("drive", "SIGKILL") in robot.sent and waited == [1.0, None]
    assert [robot[name].state for name in ("drive", "safe", "base")] == ["ended"] * 3


def test_its_own_processes_are_no_orphans_and_chores_are_done_every_half_second(robot: Robot) -> None:
    robot.poll()
    assert robot.ended == [101, 102, 103]
    robot.poll(0.49)
    assert len(robot.ended) == 3
    robot.crash("safe")
    robot.poll(0.01)
    assert robot.ended[3:] == [101, 102, 103]


def test_a_log_that_is_cut_is_told_once(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    log = robot["safe"].log

    def bound() -> None:
        log.cut += 7

    monkeypatch.setattr(log, "bound", bound)
    robot.poll()
    robot.poll()
    assert len(robot.said) == 1 and robot.said[0].startswith("process safe writes too much: the last ")


def test_a_deleted_folder_has_states_and_logs_again(robot: Robot, folder: RobotFolder) -> None:
    assert folder.lock()
    shutil.rmtree(folder.path)
    robot.poll(0.5)
    assert {name: fate.state for name, fate in folder.fates().items()} == dict.fromkeys(
        ("drive", "safe", "base"), "running"
    )
    assert all((folder.path / f"{name}.log").exists() for name in ("drive", "safe", "base"))
    folder.unlock()

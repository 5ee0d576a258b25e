"""The supervisor: crashes are answered with restarts that come slower and slower, and at last not at all."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import pytest
from navloom.config import load_config
from navloom.config.schema import LiveTable
from navloom.engine.build import assemble
from navloom.runtime.cells import all_sources
from navloom.runtime.directory import RobotFolder
from navloom.runtime.placing import spread
from navloom.runtime.supervisor import Supervisor, Task

STUBBORN = """
import json, os, signal, sys, time
spec = json.load(open(sys.argv[1]))
print("started", flush=True)
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


def supervisor(rig: tuple[RobotFolder, list[str]], live: LiveTable, **given: object) -> Supervisor:
    folder, said = rig
    task = Task("child", "child_of_test", {"mark": str(folder.path / "mark"), **given}, frozenset({"avoider"}))
    return Supervisor(live, folder, [task], said.append)


def until(condition: object, keeper: Supervisor, timeout: float = 30.0) -> None:
    limit = time.monotonic() + timeout
    while not condition():  # type: ignore[operator]
        assert time.monotonic() < limit, "it did not happen"
        keeper.poll()
        time.sleep(0.005)


def test_a_crash_loop_ends_with_the_process_left_down_and_its_last_words(
    rig: tuple[RobotFolder, list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("navloom.runtime.supervisor.HEALTHY", 60.0)  # a loaded machine takes seconds to start one
    keeper = supervisor(rig, LiveTable(restart_limit=2, restart_window=60.0), crashes=True)
    keeper.start()
    child = keeper.children["child"]
    until(lambda: child.state == "failed", keeper)
    assert child.restarts == 2
    assert rig[1][0] == "process child ended with code 3; it is started again in 0.1 s. It said last: started"
    assert rig[1][1].startswith("process child ended with code 3; it is started again in 0.2 s.")
    assert rig[1][2].startswith(
        "process child ended with code 3, 3 times within 60 s: left down. It said last: started"
    )
    keeper.stop()


def test_one_that_is_killed_is_started_again(rig: tuple[RobotFolder, list[str]]) -> None:
    keeper = supervisor(rig, LiveTable())
    keeper.start()
    child, mark = keeper.children["child"], rig[0].path / "mark"
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


def test_one_that_will_not_end_is_ended_even_when_it_was_stopped(rig: tuple[RobotFolder, list[str]]) -> None:
    keeper = supervisor(rig, LiveTable(), stubborn=True)
    keeper.start()
    until((rig[0].path / "mark").exists, keeper)
    process = keeper.children["child"].process
    assert process is not None
    os.kill(process.pid, signal.SIGSTOP)
    began = time.monotonic()
    keeper.stop()
    assert process.returncode == -signal.SIGKILL and time.monotonic() - began < 5.0


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

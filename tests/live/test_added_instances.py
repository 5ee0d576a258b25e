"""A method that a running robot does not have is started beside it, swapped in, and stays, during a drive."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from live_rig import BROKEN, Up, up
from navloom_live.operating.client import Refused
from navloom_live.operating.navigator import GoalHandle, Navigator
from test_live_swaps import CONFIG, Listener

BARE = CONFIG.partition("[[alternative]]")[0].format(speed=0.2, handover="when_blocked")
"""The robot of the swaps, without an alternative."""
SOON = 30.0


@pytest.fixture
def robot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Up]:
    config = tmp_path / "bare.toml"
    config.write_text(BARE, "utf-8")
    with up(str(config)) as robot:
        robot.wait_for("every node is there")
        monkeypatch.setenv("NAVLOOM_RUNTIME_DIR", robot.environment["NAVLOOM_RUNTIME_DIR"])
        yield robot


def begin(navigator: Navigator, y: float) -> GoalHandle:
    """A drive that has begun: an avoider steps only while the robot follows a trajectory."""
    handle = navigator.go(0.0, y)
    assert next(f for f in handle.updates(timeout=60) if f.state == "driving" and f.distance > 0.0)
    return handle


def node(robot: Up, instance: str) -> dict[str, Any]:
    return next((one for one in robot.json("list") if one["instance"] == instance), {})


def test_a_method_that_the_robot_lacks_takes_over_during_a_drive_and_hands_back(robot: Up) -> None:
    said: list[str] = []
    with Navigator() as navigator:
        listener = Listener(navigator)
        handle = begin(navigator, 3.4)
        first, before = listener.commands[-1][0], len(listener.statuses)
        assert navigator.swap("avoider", "vff", say=said.append) == 1
        assert navigator.swap("avoider", "improved_vfh", say=said.append) == 2
        assert navigator.swap("avoider", "vff", say=said.append) == 3
        assert handle.result is None, "the drive ended before the last swap"
        last, statuses = listener.commands[-1][0], listener.statuses[before:]
        assert handle.wait(120).outcome == "succeeded"
        shas = {one.config_sha256 for one in navigator.client.describe()}
    assert said == ["avoider: starting vff in shadow"]
    assert len(shas) == 1
    span = range(first, last + 1)
    assert sorted(set(span) & listener.stepped - {tick for tick, _ in listener.commands}) == []
    # Other nodes may be late on a machine that runs several robots at once; the swap stops nothing.
    assert [status.reason for status in statuses if status.stopped and "stale" not in status.reason] == []
    assert [status.reason for status in statuses if status.stopped and "avoider" in status.reason] == []


def test_an_added_instance_comes_back_after_its_process_was_killed(robot: Up) -> None:
    with Navigator() as navigator:
        begin(navigator, 7.6)
        navigator.swap("avoider", "vff")
        before = node(robot, "vff")["pid"]
        navigator.swap("avoider", "improved_vfh")
        os.kill(before, signal.SIGKILL)
        robot.wait_for("process avoider-vff was ended by SIGKILL")
        limit = time.monotonic() + SOON
        while node(robot, "vff").get("pid") in (None, before):
            assert time.monotonic() < limit
            time.sleep(0.05)
        assert navigator.swap("avoider", "vff") == 3


def test_the_other_processes_know_it_after_their_restart(robot: Up) -> None:
    with Navigator() as navigator:
        begin(navigator, 7.6)
        navigator.swap("avoider", "vff")
        os.kill(node(robot, "main")["pid"], signal.SIGKILL)  # the goal's, beside mapper and planner
        robot.wait_for("process think was ended by SIGKILL")
        limit = time.monotonic() + SOON
        while len({one.config_sha256 for one in navigator.client.describe()}) != 1 or not navigator.client.lives(
            "goal", "main"
        ):
            assert time.monotonic() < limit
            time.sleep(0.05)
        assert navigator.drive_to(0.0, 0.6, timeout=60).outcome == "succeeded"


def test_a_method_that_is_not_installed_is_refused_with_the_nearest_name(robot: Up) -> None:
    with Navigator() as navigator, pytest.raises(Refused) as refused:
        navigator.swap("avoider", "vfff")
    assert str(refused.value) == (
        "there is no avoider 'vfff'; there are improved_vfh; it cannot be added: plugin: no plugin 'avoider.vfff' is "
        "installed; did you mean 'vff'?"
    )
    assert len(robot.json("list")) == 10


def test_a_method_that_does_not_start_is_refused_with_its_reason_and_the_robot_drives_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config, plugin = tmp_path / "bare.toml", tmp_path / "broken.py"
    config.write_text(BARE, "utf-8")
    plugin.write_text(BROKEN, "utf-8")
    with up(str(config), "--plugin", str(plugin)) as robot:
        robot.wait_for("every node is there")
        monkeypatch.setenv("NAVLOOM_RUNTIME_DIR", robot.environment["NAVLOOM_RUNTIME_DIR"])
        with Navigator() as navigator:
            handle = begin(navigator, 2.0)
            for _ in range(2):
                with pytest.raises(Refused, match=r"avoider broken does not start.*no such device"):
                    navigator.swap("avoider", "broken")
            assert handle.wait(60).outcome == "succeeded"
        assert sum("avoider-broken ended with code 2: it stays down" in line for line in robot.said) == 2


def test_a_recording_has_the_instance_and_replays_bit_for_bit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config, recorded = tmp_path / "bare.toml", tmp_path / "run.mcap"
    config.write_text(BARE, "utf-8")
    with up(str(config), "--record", str(recorded)) as robot:
        robot.wait_for("every node is there")
        monkeypatch.setenv("NAVLOOM_RUNTIME_DIR", robot.environment["NAVLOOM_RUNTIME_DIR"])
        with Navigator() as navigator:
            handle = begin(navigator, 1.6)
            navigator.swap("avoider", "vff")
            assert handle.wait(60).outcome == "succeeded"
        robot.end()
        checked = robot.json("replay", str(recorded), "--check")
    nodes = {one["node"]: one for one in checked["nodes"]}
    assert nodes["avoider vff"]["steps"] > 0
    assert checked["same"] is True, checked

"""What operators do from a page, end to end on a live simulated robot."""

from __future__ import annotations

import json
import math
import os
import socket
import time
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from dashboard_rig import WAIT, Served, frames, served
from live_rig import EMPTY, Up, up
from navloom_live.operating import web_server
from websockets.sync.client import ClientConnection

ROBOT = "lab/r1"
CONFIG = f"""{EMPTY}
[[sensor]]
name = "laser"
kind = "laser_2d"

[[alternative]]
name = "other"
role = "avoider"
plugin = "improved_vfh"
"""
SPY = """
import os
with open(os.environ["DASHBOARD_SPY"], "a") as file:
    file.write(f"{__name__} in {os.getpid()}\\n")
"""


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Up]:
    """A robot that is up, whose processes would say if they loaded anything of the dashboard."""
    folder = tmp_path_factory.mktemp("robot")
    (folder / "robot.toml").write_text(CONFIG)
    for name in ("navloom_dashboard", "uvicorn", "starlette", "websockets"):
        (folder / "spies" / name).mkdir(parents=True)
        (folder / "spies" / name / "__init__.py").write_text(SPY)
    spied = {"PYTHONPATH": str(folder / "spies"), "DASHBOARD_SPY": str(folder / "loaded.txt")}
    with patch.dict(os.environ, spied):
        starting = up(str(folder / "robot.toml"))
        made = starting.__enter__()
    try:
        made.wait_for("every node is there")
        made.loaded = folder / "loaded.txt"  # type: ignore[attr-defined]
        yield made
    finally:
        starting.__exit__(None, None, None)


@pytest.fixture(scope="module")
def site(robot: Up, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with patch.dict(os.environ, robot.environment), served(tmp_path_factory.mktemp("recordings"), ROBOT) as made:
        browser = made.browser("operate")
        until(lambda: browser.ask(f"/api/{ROBOT}/doctor").status == 200)
        yield made


def until(holds: Callable[[], Any]) -> Any:
    """Wait until something holds, and return it."""
    limit = time.monotonic() + WAIT
    while not (found := holds()):
        assert time.monotonic() < limit
        time.sleep(0.02)
    return found


def state(page: ClientConnection, holds: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    """The first state for which something holds."""
    limit = time.monotonic() + WAIT
    while time.monotonic() < limit:
        (frame,) = frames(page, "state")
        if holds(frame):
            return frame
    raise AssertionError(frame)


@pytest.fixture
def page(site: Served) -> Iterator[ClientConnection]:
    """An operator's page; the robot stands and may drive, and stands without a goal afterwards."""
    browser = site.browser("operate")
    browser.act("resume")
    with browser.socket(f"/ws/{ROBOT}") as opened:
        yield opened
    browser.act("cancel")
    with browser.socket(f"/ws/{ROBOT}") as later:
        state(later, lambda now: abs(now["v"]) < 0.01 and now["drives"] == "none")


def test_a_page_gets_pose_state_scans_map_and_what_the_robot_is_with_their_ages(page: ClientConnection) -> None:
    (about,) = frames(page, "robot")
    assert about["name"] == ROBOT and about["right"] == "operate" and len(about["footprint"]) == 4
    assert {one["instance"]: one["active"] for one in about["roles"]["avoider"]}["other"] is False
    (pose,) = frames(page, "pose")
    assert math.hypot(pose["x"], pose["y"]) < 50.0 and 0.0 <= pose["age"] < 1.0
    (moving,) = frames(page, "state")
    assert moving["stopped"] is True and moving["remedy"] and 0.0 <= moving["age"] < 1.0
    scans = {scan["name"]: scan for scan in frames(page, "scan", 4)}
    assert set(scans) == {"sonars", "laser"} and "beams" in scans["sonars"]
    laser = scans["laser"]
    ranges = np.frombuffer(laser["bytes"], "<f4")
    assert len(ranges) > 100 and math.isinf(ranges[0])
    assert laser["angle_min"] == pytest.approx(-laser["angle_step"] * (len(ranges) - 1) / 2, abs=1e-6)


def test_a_page_that_is_opened_later_gets_the_map_too(site: Served) -> None:
    for _ in range(2):
        with site.browser("view").socket(f"/ws/{ROBOT}") as opened:
            (found,) = frames(opened, "map")
        cells = np.frombuffer(zlib.decompress(found["bytes"]), np.int8)
        assert len(cells) == found["width"] * found["height"] and set(np.unique(cells)) <= set(range(-1, 101))


def test_a_goal_is_driven_with_commands_of_both_instances_and_stop_holds_until_resume(
    site: Served, page: ClientConnection
) -> None:
    browser = site.browser("operate")
    answer = browser.act("goal", points=[{"x": 0.0, "y": 1.0}, {"x": 4.0, "y": 4.0, "heading": None}])
    assert answer.status == 200, answer.body
    (trajectory,) = frames(page, "trajectory")
    assert len(trajectory["points"][0]) == 4
    (commands,) = frames(page, "commands")
    rows = {row["instance"]: row["active"] for row in commands["roles"]["avoider"]}
    assert len(rows) == 2 and rows["other"] is False and {"v", "w"} == set(commands["gate"])
    state(page, lambda now: now["v"] > 0.1 and now["goal"] is not None)
    with browser.socket(f"/stop/{ROBOT}") as stop:
        stop.send(json.dumps({"n": 3}))
        while "n" not in (said := json.loads(stop.recv(timeout=WAIT))):
            assert said == {"heartbeat": True}
        assert said == {"n": 3, "sent": True}
    stopped = state(page, lambda now: now["stopped"])
    assert stopped["latched"] and stopped["v"] == pytest.approx(0.0, abs=0.05) and "operator" in stopped["why"]
    with browser.socket(f"/ws/{ROBOT}") as later:
        until(lambda: frames(later, "event")[0]["code"] == "operator")
    assert browser.act("resume").status == 200
    state(page, lambda now: now["v"] > 0.1)
    assert browser.act("cancel").body == {"ok": True, "had_goal": True}


def test_the_robot_is_told_where_it_is(site: Served, page: ClientConnection) -> None:
    answer = site.browser("operate").act("pose", x=1.0, y=-1.0, heading=1.5)
    assert answer.status == 200, answer.body
    until(lambda: abs(frames(page, "pose")[0]["y"] + 1.0) < 0.01)


def test_what_the_robot_refuses_comes_back_with_the_reason(site: Served) -> None:
    browser = site.browser("operate")
    assert (browser.act("relocalise").status, browser.act("goal", points=[{"x": "a", "y": 0}]).status) == (409, 400)
    assert "nonsense" in browser.act("swap", role="avoider", instance="nonsense").body["error"]
    assert browser.act("goal", points=[{"x": 1e300, "y": 0}]).status == 400


def test_another_instance_becomes_active_and_back(site: Served, page: ClientConnection) -> None:
    browser = site.browser("operate")
    assert browser.act("goal", points=[{"x": 4.0, "y": 6.0}]).status == 200
    frames(page, "commands")  # an instance takes over as soon as it publishes, which it does during a drive
    first = next(one["instance"] for one in frames(page, "robot")[0]["roles"]["avoider"] if one["active"])
    for wanted in ("other", first):
        answer = browser.act("swap", role="avoider", instance=wanted)
        assert answer.status == 200, answer.body
        until(lambda wanted=wanted: {one["instance"]: one["active"] for one in
                                     frames(page, "robot")[0]["roles"]["avoider"]}[wanted])  # fmt: skip


def test_parameters_have_bounds_units_and_defaults_and_are_set(site: Served) -> None:
    browser = site.browser("operate")
    nodes = {node["node"]: node for node in browser.ask(f"/api/{ROBOT}/params").body["nodes"]}
    name = next(one for one in nodes if one.startswith("controller "))
    gain = {one["name"]: one for one in nodes[name]["params"]}["k3"]
    assert gain["unit"] == "1/s" and (gain["min"], gain["max"]) == (0.0, 20.0) and gain["default"] > 0.0
    assert browser.act("param", node=name, name="k3", value=gain["default"] + 0.5).status == 200
    told = {node["node"]: node for node in browser.ask(f"/api/{ROBOT}/params").body["nodes"]}[name]
    assert {one["name"]: one["value"] for one in told["params"]}["k3"] == gain["default"] + 0.5
    assert "k3" in browser.act("param", node=name, name="k3", value=99).body["error"]
    # A value is data: it cannot bring a second assignment.
    assert browser.act("param", node=name, name="k3", value="1\nk1 = 2").status == 409
    assert browser.act("param", node=name, name="k3 = 1\nk1", value=2).status == 400


def test_the_doctor_finds_nothing(site: Served) -> None:
    found = site.browser("view").ask(f"/api/{ROBOT}/doctor").body
    assert found["robot"] == ROBOT and found["nodes"] >= 10


def test_a_drive_is_recorded_and_downloaded(site: Served, page: ClientConnection) -> None:
    browser = site.browser("operate")
    name = browser.act("record", on=True).body["file"]
    assert browser.act("record", on=True).status == 409
    until(lambda: frames(page, "recording")[0]["file"] == name)
    frames(page, "pose", 5)
    assert browser.act("record", on=False).body["file"] == name
    assert [one["name"] for one in browser.ask(f"/api/{ROBOT}/recordings").body["recordings"]] == [name]
    assert browser.ask(f"/api/{ROBOT}/recordings/{name}").body.startswith(b"\x89MCAP")


# --- teleop -------------------------------------------------------------------------------------------------------


def hold(wheel: ClientConnection, holds: Callable[[dict[str, Any]], bool], v: float = 0.3) -> dict[str, Any]:
    """Hold the stick as a page does, 20 times a second, until an answer fulfils a condition."""
    limit, number, heard = time.monotonic() + WAIT, 0, None
    while time.monotonic() < limit:
        number += 1
        wheel.send(json.dumps({"v": v, "w": 0.0, "n": number, "heard": heard}))
        said = json.loads(wheel.recv(timeout=WAIT))
        assert "error" not in said, said
        heard = said["at"]
        if holds(said):
            return said
        time.sleep(0.05)
    raise AssertionError(said)


def test_teleop_drives_while_held_and_stands_within_0_3_s_after_it_is_not(site: Served, page: ClientConnection) -> None:
    browser = site.browser("operate")
    with browser.socket(f"/teleop/{ROBOT}") as wheel:
        hold(wheel, lambda said: said["measured"]["v"] > 0.15)
        let_go = time.monotonic()
        while json.loads(wheel.recv(timeout=WAIT))["held"]:
            pass
        # 0.2 s of dead-man, an interval of 0.05 s, and what a busy host adds.
        assert 0.1 < time.monotonic() - let_go < 0.8
        state(page, lambda now: abs(now["v"]) < 0.01 and now["drives"] == "operator")
        wheel.send(json.dumps({"end": True}))
        state(page, lambda now: now["drives"] != "operator" and not now["latched"])


def test_when_the_page_of_a_driver_is_lost_the_robot_stops_until_resumed(site: Served, page: ClientConnection) -> None:
    browser = site.browser("operate")
    wheel = browser.socket(f"/teleop/{ROBOT}")
    hold(wheel, lambda said: said["measured"]["v"] > 0.15)
    state(page, lambda now: now["v"] > 0.15)
    wheel.socket.shutdown(socket.SHUT_RDWR)
    lost = state(page, lambda now: now["stopped"] and abs(now["v"]) < 0.01)
    assert lost["drives"] == "none" and "operator" in lost["why"]
    # It has a goal again, and does not drive to it.
    assert browser.act("goal", points=[{"x": 0.0, "y": 5.0}]).status == 200
    frames(page, "trajectory")
    assert all(now["stopped"] for now in frames(page, "state", 10))
    assert browser.act("resume").status == 200
    state(page, lambda now: now["v"] > 0.1)


@pytest.mark.parametrize(
    "said",
    ["nonsense", "[]", '{"v": 1}', '{"v": NaN, "w": 0}', '{"v": 1e300, "w": 0}', "[" * 9000],
    ids=["no_json", "no_object", "incomplete", "nan", "huge", "deep"],
)
def test_a_driver_who_sends_nonsense_is_disconnected(site: Served, said: str) -> None:
    with site.browser("operate").socket(f"/teleop/{ROBOT}") as wheel:
        wheel.send(said)
        with pytest.raises(Exception, match="1008"):
            while True:
                wheel.recv(timeout=WAIT)


# --- browsers that are slow, and the robot ------------------------------------------------------------------------


def slow_page(site: Served) -> ClientConnection:
    """A page that takes only what it is asked to read."""
    narrow = socket.socket()
    narrow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    narrow.connect(("127.0.0.1", site.port))
    return site.browser("view").socket(f"/ws/{ROBOT}", sock=narrow, max_queue=1, ping_interval=None)


def test_a_page_that_freezes_for_a_while_delays_no_other_and_gets_the_newest_afterwards(site: Served) -> None:
    with slow_page(site) as frozen, site.browser("view").socket(f"/ws/{ROBOT}") as other:
        (first,) = frames(frozen, "pose")
        poses = frames(other, "pose", 100)
        assert max(pose["age"] for pose in poses) < 1.0
        behind, count = frames(frozen, "pose")[0], 1
        while behind["run_time"] < poses[-1]["run_time"]:
            behind, count = frames(frozen, "pose")[0], count + 1
    # Without slots it would be every pose of these 5 s: 100.
    assert poses[-1]["run_time"] - first["run_time"] > 4.0 and count < 60


def test_a_frozen_page_is_disconnected_and_a_killed_one_is_forgotten(
    robot: Up, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(web_server, "PING_INTERVAL", 1.0)
    monkeypatch.setattr(web_server, "PING_WAIT", 1.0)
    monkeypatch.setenv("NAVLOOM_RUNTIME_DIR", robot.environment["NAVLOOM_RUNTIME_DIR"])
    with served(tmp_path, ROBOT) as site:
        link = until(lambda: site.dashboard.robots.get(ROBOT))
        frozen, killed = slow_page(site), site.browser("view").socket(f"/ws/{ROBOT}")
        until(lambda: len(link._outboxes) == 2)
        killed.socket.shutdown(socket.SHUT_RDWR)
        until(lambda: len(link._outboxes) == 1)
        until(lambda: len(link._outboxes) == 0)
        frozen.socket.close()


def test_the_robots_own_processes_load_nothing_of_the_dashboard(site: Served, robot: Up) -> None:
    assert site.browser("view").ask("/").status == 200
    assert not robot.loaded.exists(), robot.loaded.read_text()  # type: ignore[attr-defined]

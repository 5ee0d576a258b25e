"""A live robot that is driven at a wall by hand stops before it: the gate sees the wall, whatever else has failed."""

from __future__ import annotations

import json
import math
import os
import signal
import threading
from pathlib import Path
from typing import Any

import pytest
from live_rig import Up, up
from test_live_robot import _navigator

WALL = """
bounds = [-6.0, -6.0, 6.0, 6.0]

[[box]]
name = "wall"
x = [2.0, 2.2]
y = [-5.0, 5.0]
"""
ROBOT = """
[robot]
footprint = {{ length = 0.5, width = 0.4 }}
height = 0.6
half_track = 0.2
max_linear = 0.8
max_angular_deg = 60.0
motor_lag = 0.1
dead_time = 0.05

[world]
ref = "{world}"

[platform]
plugin = "sensors_sim"
motor_time_constant = 0.1
dead_time = 0.05

[[sensor]]
name = "laser"
kind = "laser_2d"
beams = 181
field_of_view_deg = 270.0
range_max = 10.0
sigma = 0.03

[mapper]
plugin = "known_map"

[navigation]
start = {{ x = {x}, y = {y}, heading_deg = {heading} }}
drive = false
"""
NEAR = 0.15
"""The robot has driven up to the wall if it is nearer than this, m."""


def config(folder: Path, angle: float) -> str:
    """Config of a robot on a line that meets the middle of the wall at an angle to its normal, degrees."""
    world = folder / "wall.toml"
    world.write_text(WALL, "utf-8")
    path = folder / f"at_{angle:g}.toml"
    away = distance(angle)
    start_y = -away * math.tan(math.radians(angle))
    path.write_text(ROBOT.format(world=world, x=2.0 - away, y=start_y, heading=angle), "utf-8")
    return str(path)


def distance(angle: float) -> float:
    """Distance between start and wall, m: less at steep angles, so that the wall is long enough."""
    return 2.0 if angle <= 60.0 else 0.8


def duration(angle: float) -> float:
    """Time that the robot drives at 0.6 m/s, more than it needs to reach the wall, s."""
    return distance(angle) / math.cos(math.radians(angle)) / 0.6 + 5.0


def driven_at_the_wall(robot: Up, seconds: float = 8.0) -> dict[str, Any]:
    """Drive straight ahead by hand until the robot is near the wall, at most three times; gives the simulator's truth.

    On a loaded host, messages come late, and the robot stops on its way. The truth is of 1 s after the drive, when the
    robot has braked.
    """
    last: dict[str, Any] = {}
    for _ in range(3):
        done = robot.run("teleop", "--vx", "0.6", "--for", f"{seconds:g}")
        assert done.returncode in (0, 1), done.stderr
        told = robot.run("echo", "platform/truth", "--count", "20", "--json")
        assert told.returncode == 0, told.stderr
        last = json.loads(told.stdout.splitlines()[-1])
        last = last.get("message", last)
        if last["clearance"] < NEAR:
            break
    return last


def assert_stopped_before_it(truth: dict[str, Any]) -> None:
    assert not truth["touching"] and 0.0 < truth["clearance"] < NEAR, truth
    assert abs(truth["twist"]["vx"]) < 0.02


def test_a_robot_driven_at_a_wall_by_hand_stops_before_it(tmp_path: Path) -> None:
    with up(config(tmp_path, 30.0)) as robot:
        robot.wait_for("every node is there")
        assert_stopped_before_it(driven_at_the_wall(robot))


JUMPS = '''
"""A localizer whose pose jumps by 2 m after 3 s: the gate does not look at it."""

from dataclasses import replace

from navloom import hookimpl
from navloom.navigation.dead_reckoning import OdometryLocalizer


class Jumping(OdometryLocalizer):
    name = "jumping"

    def localize(self, given):
        said = super().localize(given)
        if said.stamp_ns < 3_000_000_000:
            return said
        return replace(said, pose=replace(said.pose, x=said.pose.x + 2.0))


@hookimpl
def navloom_register(registry):
    registry.add(Jumping)
'''


def jumping_localizer(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Make the localizer appear installed to processes that this one starts."""
    about = folder / "jumping_localizer-1.0.dist-info"
    about.mkdir()
    (folder / "jumping_localizer.py").write_text(JUMPS, "utf-8")
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: jumping_localizer\nVersion: 1.0\n", "utf-8")
    (about / "entry_points.txt").write_text("[navloom]\nlocalizer.jumping = jumping_localizer\n", "utf-8")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, [str(folder), os.environ.get("PYTHONPATH")])))


ANGLES = range(0, 81, 4)
"""Angles to the normal of the wall, degrees."""
PROCESSES = {
    "robot": ["platform"],
    "where": ["localizer"],
    "think": ["mapper", "planner", "goal"],
    "drive": ["reference", "controller", "avoider", "recovery"],
    "safe": ["gate"],
}
APART = [part for name, roles in PROCESSES.items() for part in ("--set", f"live.processes.{name}={json.dumps(roles)}")]


@pytest.mark.slow
@pytest.mark.parametrize("angle", ANGLES)
def test_it_stops_at_any_angle(tmp_path: Path, angle: int) -> None:
    with up(config(tmp_path, angle)) as robot:
        robot.wait_for("every node is there")
        assert_stopped_before_it(driven_at_the_wall(robot, duration(angle)))


@pytest.mark.slow
@pytest.mark.parametrize("angle", ANGLES)
def test_it_stops_though_its_localizer_is_killed_during_the_drive(tmp_path: Path, angle: int) -> None:
    with up(config(tmp_path, angle), *APART) as robot:
        robot.wait_for("every node is there")
        with _navigator(robot) as navigator:
            localizer = next(node for node in navigator.client.describe() if node.role == "localizer")
            killer = threading.Timer(1.5, os.kill, (localizer.pid, signal.SIGKILL))
            killer.start()
            last = driven_at_the_wall(robot, duration(angle))
            killer.join()
            assert_stopped_before_it(last)


@pytest.mark.slow
@pytest.mark.parametrize("angle", ANGLES)
def test_it_stops_though_its_pose_jumps_by_2_m(tmp_path: Path, angle: int, monkeypatch: pytest.MonkeyPatch) -> None:
    jumping_localizer(tmp_path, monkeypatch)
    with up(config(tmp_path, angle), "--set", "localizer.plugin=jumping") as robot:
        robot.wait_for("every node is there")
        assert_stopped_before_it(driven_at_the_wall(robot, duration(angle)))
        pose = robot.run("echo", "localizer/pose", "--count", "1", "--json")
        truth = robot.run("echo", "platform/truth", "--count", "1", "--json")
        said, true = (json.loads(done.stdout).get("message", json.loads(done.stdout))["pose"] for done in (pose, truth))
        assert math.hypot(said["x"] - true["x"], said["y"] - true["y"]) > 1.5

"""A live robot that is driven at a wall by hand stops before it: the gate looks, whatever else has died."""

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
start = {{ x = 0.0, y = {y}, heading_deg = {heading} }}
drive = false
"""


def config(folder: Path, angle: float) -> str:
    """A robot that starts 2 m before the wall, on a line that meets it at an angle off its normal, degrees."""
    world = folder / "wall.toml"
    world.write_text(WALL, "utf-8")
    path = folder / f"at_{angle:g}.toml"
    start_y = -min(4.0, 2.0 * math.tan(math.radians(angle)))
    path.write_text(ROBOT.format(world=world, y=start_y, heading=angle), "utf-8")
    return str(path)


def driven_at_the_wall(robot: Up, seconds: float = 8.0) -> dict[str, Any]:
    """Drive straight on by hand; gives the simulator's next word on where the robot is."""
    done = robot.run("teleop", "--vx", "0.6", "--for", f"{seconds:g}")
    assert done.returncode in (0, 1), done.stderr
    told = robot.run("echo", "platform/truth", "--count", "1", "--json")
    assert told.returncode == 0, told.stderr
    return json.loads(told.stdout)  # type: ignore[no-any-return]


def assert_stopped_before_it(last: dict[str, Any]) -> None:
    truth = last.get("message", last)
    assert not truth["touching"] and 0.0 < truth["clearance"] < 0.15, truth
    assert abs(truth["twist"]["vx"]) < 0.02


def test_a_robot_that_is_driven_at_a_wall_by_hand_stops_before_it(tmp_path: Path) -> None:
    with up(config(tmp_path, 30.0)) as robot:
        robot.wait_for("every node is there")
        assert_stopped_before_it(driven_at_the_wall(robot))


@pytest.mark.slow
@pytest.mark.parametrize("angle", [0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0])
def test_it_stops_at_any_angle_with_the_localizer_killed_under_way(tmp_path: Path, angle: float) -> None:
    with up(config(tmp_path, angle), "--set", 'live.processes.robot=["platform"]',
            "--set", 'live.processes.where=["localizer"]') as robot:  # fmt: skip
        robot.wait_for("every node is there")
        with _navigator(robot) as navigator:
            localizer = next(node for node in navigator.client.describe() if node["role"] == "localizer")
            killer = threading.Timer(1.5, os.kill, (localizer["pid"], signal.SIGKILL))
            killer.start()
            last = driven_at_the_wall(robot, 12.0)
            killer.join()
            assert_stopped_before_it(last)

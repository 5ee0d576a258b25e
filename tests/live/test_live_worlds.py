"""A live robot in a world where something moves, and what happens when the node that moves it ends."""

from __future__ import annotations

import os
import signal

import pytest
from live_rig import up

PLACES = (
    'live.processes={ robot = ["platform", "gate"], world = ["world"], '
    'rest = ["localizer", "mapper", "planner", "controller", "avoider", "recovery", "goal", "reference"] }'
)


@pytest.mark.slow
def test_the_robot_stops_while_the_node_that_moves_the_world_is_gone_and_drives_on_after_it() -> None:
    with up("building", "--set", "world.ref=crossing_person", "--set", PLACES) as robot:
        robot.wait_for("controller lyapunov_tracker drives")
        seen = len(robot.said)
        (victim,) = [node for node in robot.json("list") if node["role"] == "world"]
        os.kill(victim["pid"], signal.SIGKILL)
        stopped = robot.wait_for("stopped: world main is gone", after=seen)
        robot.wait_for(" drives", after=stopped)


@pytest.mark.slow
def test_the_robot_stops_when_the_node_that_moves_the_world_says_nothing() -> None:
    with up("building", "--set", "world.ref=crossing_person", "--set", PLACES) as robot:
        robot.wait_for("controller lyapunov_tracker drives")
        seen = len(robot.said)
        (victim,) = [node for node in robot.json("list") if node["role"] == "world"]
        os.kill(victim["pid"], signal.SIGSTOP)
        try:
            robot.wait_for("bodies", after=seen)
        finally:
            os.kill(victim["pid"], signal.SIGCONT)

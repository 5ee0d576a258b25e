"""The paper's run live, as in the README: `navloom up paper`, and its goal from another terminal."""

from __future__ import annotations

import contextlib
import subprocess

import pytest
from live_rig import COMMAND, Up, runtime_folder


@pytest.mark.slow
@pytest.mark.parametrize("realms", [("lab",), ("north", "south")], ids=["one-robot", "two-realms"])
def test_the_papers_goal_is_reached_by_every_robot_of_this_host(realms: tuple[str, ...]) -> None:
    with runtime_folder() as folder, contextlib.ExitStack() as ending:
        robots = {realm: Up(folder, ["paper", "--set", f"robot.realm={realm}"]) for realm in realms}
        for robot in robots.values():
            ending.callback(robot.end)
        for robot in robots.values():
            robot.wait_for("every node is there")

        goals = {
            realm: subprocess.Popen(
                [*COMMAND, "goal", "0", "7.6", "--robot", f"{realm}/r1"],
                env=robot.environment,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
            )
            for realm, robot in robots.items()
        }
        for goal in goals.values():
            ending.callback(goal.kill)
        for realm, goal in goals.items():
            said, _ = goal.communicate(timeout=180)
            assert goal.returncode == 0, (realm, said)
            assert said.splitlines()[-1].startswith("succeeded: the goal was reached"), said
        for realm, robot in robots.items():
            status = robot.json("status", "--robot", f"{realm}/r1")
            assert status["silent_nodes"] == []
        assert [robot.end() for robot in robots.values()] == [0] * len(realms)

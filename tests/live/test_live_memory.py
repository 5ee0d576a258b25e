"""A stop, a swap and a goal number survive the end of any process, killed or terminated."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest
from live_rig import Up, up
from navloom_live.operating.introspection import last
from navloom_live.operating.navigator import Navigator
from test_live_robot import BESIDE, _navigator

ONE = ["--set", 'live.processes = { all = ["platform", "localizer", "mapper", "planner", "goal", "reference", '
       '"controller", "avoider", "recovery", "gate"] }']  # fmt: skip


def driven(navigator: Navigator, x: float) -> object:
    """Send a goal, and wait until the robot drives; gives its handle."""
    handle = navigator.go(x, 0.0)
    assert next(f for f in handle.updates(timeout=60) if f.state == "driving" and f.distance > 0.5)
    return handle


def end(robot: Up, navigator: Navigator, role: str, number: signal.Signals) -> int:
    """Send a signal to the process of a role, and wait until its end is reported; gives the lines up to there."""
    node = next(node for node in navigator.client.describe() if node.role == role)
    seen = len(robot.said)
    os.kill(node.pid, number)
    return robot.wait_for(f"process {node.process} ", after=seen)


@pytest.fixture
def config(tmp_path: Path) -> str:
    path = tmp_path / "beside.toml"
    path.write_text(BESIDE, "utf-8")
    return str(path)


def test_a_killed_robot_of_one_process_restarts_stopped_and_ends_its_goal_with_an_error(config: str) -> None:
    with up(config, *ONE) as robot:
        robot.wait_for("every node is there")
        with _navigator(robot) as navigator:
            handle = driven(navigator, 4.2)
            navigator.stop()
            stopped = robot.wait_for("stopped: by an operator")
            end(robot, navigator, "gate", signal.SIGKILL)
            result = handle.wait(30)  # type: ignore[attr-defined]
            assert (result.outcome, result.reason) == ("error", "restarted: the goal node began anew")
            second = navigator.go(2.0, 0.0)
            assert second.goal_id > handle.goal_id  # type: ignore[attr-defined]
            assert next(f for f in second.updates(timeout=60) if f.state == "driving")
            assert last(navigator.client, "gate", "main", "status").reason == "operator"  # type: ignore[union-attr]
            navigator.resume()
            robot.wait_for("controller lyapunov_tracker drives", after=stopped)


@pytest.mark.slow  # 47 s; the test above shows the same after a kill
def test_a_stop_survives_a_terminated_gate_and_a_swap_survives_a_killed_avoider(config: str) -> None:
    with up(config) as robot:
        robot.wait_for("every node is there")
        with _navigator(robot) as navigator:
            handle = driven(navigator, 4.2)
            assert navigator.swap("avoider", "other") == 1
            seen = end(robot, navigator, "avoider", signal.SIGKILL)
            stopped = robot.wait_for("stopped: ", after=seen - 1)
            robot.wait_for("controller lyapunov_tracker drives", after=stopped)
            avoiders = {node.instance: node for node in navigator.client.describe() if node.role == "avoider"}
            assert avoiders["other"].active and avoiders["other"].enabled
            navigator.stop()
            robot.wait_for("stopped: by an operator", after=stopped)
            ended = end(robot, navigator, "gate", signal.SIGTERM)
            robot.wait_for("stopped: by an operator", after=ended)
            navigator.resume()
            robot.wait_for("controller lyapunov_tracker drives", after=ended)
            # A live result is the robot's own: no truth is on the wire.
            assert handle.wait(60).outcome == "succeeded"  # type: ignore[attr-defined]

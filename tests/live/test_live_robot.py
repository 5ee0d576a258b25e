"""A live robot in its default processes, used as from two terminals."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from live_rig import COMMAND, EMPTY, Up, is_running, runtime_folder, up
from navloom.cli import main
from navloom_live.operating.navigator import Navigator

PAPER = ["paper", "--set", "navigation.drive=false", "--set", "world.ref=paper_gates"]
SPLIT = {
    "platform": "robot", "localizer": "robot", "mapper": "think", "planner": "think", "goal": "think",
    "reference": "drive", "controller": "drive", "avoider": "drive", "recovery": "drive", "gate": "safe",
}  # fmt: skip
BESIDE = (
    EMPTY
    + """speed = [0.1, 0.1]

[[alternative]]
name = "other"
role = "avoider"
plugin = "improved_vfh"
shadow = false
"""
)
WRONG = [
    (["swap", "avoidr", "other"], "'avoidr' is no role that can be swapped; did you mean 'avoider'?"),
    (["params", "get", "avoider.othr"], "no avoider 'othr' answers; did you mean 'other'?"),
    (["params", "get", "gate"], "no plugin of role 'gate' answers; known are avoider, controller"),
]


def test_a_goal_from_another_terminal_is_reached_and_everything_ends(tmp_path: Path) -> None:
    with up(*PAPER) as robot:
        robot.wait_for("every node is there")
        nodes = robot.json("list")
        assert sorted(node["role"] for node in nodes) == sorted({*SPLIT})
        assert {node["role"]: node["process"] for node in nodes} == SPLIT
        pids = {node["pid"] for node in nodes}
        assert len(pids) == 4 and all(is_running(pid) for pid in pids)
        _look_in(robot)
        done = robot.run("goal", "0", "2.0", timeout=90)
        assert done.returncode == 0, done.stdout + done.stderr
        assert done.stdout.splitlines()[-1].startswith("succeeded: the goal was reached")
        assert any(line.startswith("driving, ") and "m/s by " in line for line in done.stdout.splitlines())
        began = time.monotonic()
        assert robot.run("down").returncode == 0
        assert robot.process.wait(10) == 0
        assert time.monotonic() - began < 10
        assert not [pid for pid in pids if is_running(pid)]


def _look_in(robot: Up) -> None:
    """Check the commands that only observe, on a stopped robot."""
    status = robot.json("status")
    assert status["robot"] == "lab/r1" and status["gate_status"]["reason"] == "no_trajectory"
    assert status["silent_nodes"] == [] and status["goal_result"] is None
    lines = robot.run("echo", "platform/odometry", "--count", "2", "--fields", "pose.x,stamp_ns", "--json").stdout
    first, second = map(json.loads, lines.splitlines())
    assert set(first["message"]) == {"pose.x", "stamp_ns"}
    assert second["message"]["stamp_ns"] > first["message"]["stamp_ns"]
    assert second["envelope"]["sequence"] > first["envelope"]["sequence"]
    found = robot.json("hz", "*/odometry", "--for", "2")["platform/sensors_sim/odometry"]
    assert found["messages"] > 5 and found["malformed"] == 0 and found["bytes_per_s"] > 100
    wrong = robot.run("echo", "gate/comand")
    assert wrong.returncode == 2 and "did you mean 'gate/command'?" in wrong.stderr
    assert robot.json("doctor")["nodes"] == len(SPLIT)
    nobody = robot.run("doctor", "--connect", "tcp/127.0.0.1:9")
    assert nobody.returncode == 1 and "cannot be joined" in nobody.stdout and "navloom router" in nobody.stdout


class _navigator:
    """A Navigator on a robot whose runtime folder is not that of this process."""

    def __init__(self, robot: Up) -> None:
        self._folder = robot.environment["NAVLOOM_RUNTIME_DIR"]

    def __enter__(self) -> Navigator:
        self._before = os.environ.get("NAVLOOM_RUNTIME_DIR")
        os.environ["NAVLOOM_RUNTIME_DIR"] = self._folder
        self._inner = Navigator()
        return self._inner.__enter__()

    def __exit__(self, *error: object) -> None:
        self._inner.__exit__(None, None, None)
        if self._before is None:
            del os.environ["NAVLOOM_RUNTIME_DIR"]
        else:
            os.environ["NAVLOOM_RUNTIME_DIR"] = self._before


def test_an_operator_sets_parameters_swaps_stops_drives_and_cancels(tmp_path: Path) -> None:
    config = tmp_path / "beside.toml"
    config.write_text(BESIDE, "utf-8")
    with up(str(config)) as robot:
        robot.wait_for("every node is there")
        again = robot.run("up", str(config))
        assert again.returncode == 2
        assert f"robot lab/r1 is up already (process {robot.process.pid}, since 2" in again.stderr

        # rejected at once, with the reason
        done = robot.run("goal", "-500", "0")
        assert done.returncode == 2 and "rejected: (-500, 0) is outside the world empty" in done.stdout
        # parameters are set all together or not at all
        before = robot.json("params", "get", "avoider.other")
        assert robot.run("params", "set", "controller", "k3=1.25", "k1=0.8").returncode == 0
        wrong = robot.run("params", "set", "controller", "k3=2.0", "k1=-1")
        assert wrong.returncode == 2 and "controller.k1: got -1, expected more than 0" in wrong.stderr
        now = robot.json("params", "get", "controller")
        assert (now["k1"], now["k3"]) == (0.8, 1.25)
        assert robot.json("params", "get", "avoider.other") == before

        with _navigator(robot) as navigator:
            handle = navigator.go(4.2, 0.0)
            updates = handle.updates(timeout=60)
            assert next(f for f in updates if f.state == "driving" and 0.0 < f.distance < 4.0)
            # a swap during the drive, to an instance that has not run before
            assert robot.json("swap", "avoider", "other")["epoch"] == 1
            wrong = robot.run("swap", "avoider", "othr")
            assert wrong.returncode == 2 and "there is no avoider 'othr'; there are improved_vfh, other" in wrong.stderr
            # stopped until resumed
            stopped = robot.run("stop")
            assert stopped.returncode == 0
            robot.wait_for("stopped: by an operator")
            assert next(f for f in updates if handle.gate is not None and handle.gate.reason == "operator")
            refused = robot.run("teleop", "--vx", "0.2")
            assert refused.returncode == 1 and "is stopped: by an operator; `navloom resume`" in refused.stderr
            resumed = len(robot.said)
            assert robot.run("resume").returncode == 0
            robot.wait_for("controller lyapunov_tracker drives", after=resumed)
            # an operator drives, then the robot drives itself again
            by_hand = len(robot.said)
            assert robot.run("teleop", "--vx", "-0.2", "--for", "0.5").returncode == 0
            after = robot.wait_for("an operator drives", after=by_hand)
            robot.wait_for("controller lyapunov_tracker drives", after=after)
            # pre-empted, then cancelled
            second = navigator.go(-3.0, 0.0)
            assert handle.wait(30).outcome == "cancelled"
            assert robot.run("cancel").returncode == 0
            assert second.wait(30).reason == "by the operator"
            assert not navigator.cancel()
            assert navigator.drive_to(float("nan"), 0.0).reason == "x is nan, expected a finite number"
            for arguments, text in WRONG:
                wrong = robot.run(*arguments)
                assert wrong.returncode == 2 and text in wrong.stderr, wrong.stderr
            second_gate = robot.run("node", str(config), "gate")
            assert second_gate.returncode == 2 and "gate main of robot lab/r1: runs already" in second_gate.stderr
            listening = navigator.listen(["gate/selection", "platform/odometry"])
            told = listening.take(1.0)  # a late joiner gets the last selection first
            assert ("gate", "main", "selection") in [one[:3] for one in told]
            assert any(one.port == "odometry" for _ in range(20) for one in listening.take(0.1))
            assert robot.run("place", "-1", "-1.5", "30").returncode == 0  # negative numbers are no options
            at = robot.json("status")["pose"]
            assert (round(at["x"], 2), round(at["y"], 2), round(at["heading_deg"])) == (-1.0, -1.5, 30)
            assert navigator.place(1.0, 2.0, 0.5) == ""
            poses = navigator.listen(["localizer/pose"])
            (seen,) = {(round(one.message.pose.x, 2), round(one.message.pose.y, 2)) for one in poses.take(1.0)[-1:]}
            assert seen == (1.0, 2.0)
            _go_down_during_a_goal(robot, navigator)


def _go_down_during_a_goal(robot: Up, navigator: Navigator) -> None:
    """Check that the commands `goal` and `up` both end with the result of the goal that went down."""
    before = navigator.go(-3.0, 0.0)
    following = subprocess.Popen(
        [*COMMAND, "goal", "-3.0", "0", "--json"], env=robot.environment, stdout=subprocess.PIPE, text=True
    )
    try:
        assert before.wait(30).outcome == "cancelled"  # the next goal has pre-empted it
        assert robot.run("down").returncode == 0
        out, _ = following.communicate(timeout=30)
    finally:
        following.kill()
        following.wait()
    reason = f"robot lab/r1 went down, and goal {before.goal_id + 1} with it"
    end = {"goal_id": before.goal_id + 1, "outcome": "error", "reason": reason, "place": None}
    assert (following.returncode, json.loads(out)) == (1, end)
    assert robot.process.wait(10) == 1
    assert robot.process.stdout is not None
    assert f"error: {reason}, at (" in robot.process.stdout.read()


@pytest.mark.slow
def test_a_killed_process_restarts_and_the_goal_is_reached(tmp_path: Path) -> None:
    config = tmp_path / "beside.toml"
    config.write_text(BESIDE, "utf-8")
    with up(str(config)) as robot:
        robot.wait_for("every node is there")
        with _navigator(robot) as navigator:
            navigator.set_parameters("controller", "lyapunov_tracker", ["k3 = 1.5"])
            handle = navigator.go(4.2, 0.0)
            assert next(f for f in handle.updates(timeout=60) if f.state == "driving" and 0.0 < f.distance < 4.0)
            victim = next(node for node in navigator.client.describe() if node.role == "controller")
            seen = len(robot.said)
            os.kill(victim.pid, signal.SIGKILL)
            robot.wait_for("process drive was ended by SIGKILL; it restarts in", after=seen)
            stopped = robot.wait_for("stopped: ", after=seen)
            robot.wait_for("controller lyapunov_tracker drives", after=stopped)
            assert handle.wait(60).outcome == "succeeded"  # a live result is the robot's own: no truth is on the wire
            # parameters that were set survive the process
            assert navigator.get_parameters("controller", "lyapunov_tracker")["k3"] == 1.5


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["goal", "0", "0"], "no robot of this user is up on this host: start one with `navloom up CONFIG`"),
        (["stop", "--robot", "lab/r9"], "--robot lab/r9: it is not up on this host; none is up"),
        (["up", "paper", "--host", "base"], "--host base: the config has no [live.hosts]"),
        (["up", "paper", "--set", 'live.processes={a=["platform"]}'], "processes leave out localizer"),
        (["up", "paper", "--set", 'live.router="tcp/127.0.0.1:99999"'], "live.router: endpoint 'tcp/127.0.0.1:99999'"),
        (["node", "paper", "contrller"], "node 'contrller': no such node or process; did you mean 'controller'?"),
    ],
    ids=["no-robot", "unknown-robot", "no-hosts", "nodes-left-out", "bad-port", "no-such-node"],
)
def test_a_wrong_request_gives_one_message(
    arguments: list[str], text: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["navloom", *arguments])
    with runtime_folder() as folder, pytest.raises(SystemExit) as ended:
        monkeypatch.setenv("NAVLOOM_RUNTIME_DIR", str(folder))
        main()
    said = capsys.readouterr()
    assert ended.value.code == 2 and said.out == ""
    assert text in said.err and said.err.startswith("navloom: ") and said.err.count("\n") == 1


def test_a_node_without_a_router_says_that_it_waits_and_ends_on_sigterm() -> None:
    with runtime_folder() as folder:
        process = subprocess.Popen(
            [*COMMAND, "node", "paper", "localizer", "--connect", "tcp/127.0.0.1:9"],
            env={**os.environ, "NAVLOOM_RUNTIME_DIR": str(folder)},
            stderr=subprocess.PIPE,
            text=True,
        )
        assert process.stderr is not None
        said = next(line for line in process.stderr if "waiting for it" in line)
        assert "nothing listens there" in said
        process.send_signal(signal.SIGTERM)
        assert "Traceback" not in process.stderr.read()
        assert process.wait(10) == 0

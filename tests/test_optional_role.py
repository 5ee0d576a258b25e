"""An optional role: a config may leave it out, and everything else knows it from its declaration."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

HERE = Path(__file__).parent
FRONTIER = '''"""A toy explorer."""

from pydantic import Field

from navloom import Explorer, Params, Point2D


class FrontierParams(Params):
    """Where it looks."""

    ahead: float = Field(2.0, gt=0.0, le=10.0, description="How far ahead of the robot it looks, m.")


class Frontier(Explorer[FrontierParams]):
    """Looks ahead of the robot."""

    name = "frontier"

    def explore(self, given):
        pose = given.estimate.pose
        return Point2D(pose.x + self.params.ahead, pose.y)
'''
ALL = '["platform", "localizer", "mapper", "planner", "controller", "avoider", "recovery", "goal", "reference", "gate"]'
WITH = ("--plugin", "frontier.py", "--set", "explorer.plugin=frontier")
Navloom = Callable[..., tuple[int, str]]


@pytest.fixture(scope="module")
def navloom(tmp_path_factory: pytest.TempPathFactory) -> Navloom:
    """The command line, in processes whose framework has the role: its code and its output, or its last error."""
    folder = tmp_path_factory.mktemp("explorer")
    (folder / "sitecustomize.py").write_text("import with_explorer\n", "utf-8")
    (folder / "frontier.py").write_text(FRONTIER, "utf-8")
    (folder / "further.py").write_text(FRONTIER.replace("frontier", "further").replace("(2.0", "(4.0"), "utf-8")
    env = {**os.environ, "PYTHONPATH": os.pathsep.join([str(folder), str(HERE)])}

    def call(*words: str) -> tuple[int, str]:
        done = subprocess.run(
            [sys.executable, "-m", "navloom", *words], env=env, cwd=folder, capture_output=True, text=True, check=False
        )
        return done.returncode, done.stdout or done.stderr

    return call


def run(navloom: Navloom, *words: str) -> dict[str, Any]:
    code, out = navloom("run", "paper", "--set", "run.stop_after=2", "--json", *words)
    assert code == 1, out  # the run ends before the goal
    found: dict[str, Any] = json.loads(out)
    return found


def test_a_robot_without_the_role_drives_as_in_a_framework_without_it(navloom: Navloom) -> None:
    plain = subprocess.run(
        [sys.executable, "-m", "navloom", "run", "paper", "--set", "run.stop_after=2", "--json"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert run(navloom)["trace_sha256"] == json.loads(plain.stdout)["trace_sha256"]


def test_its_table_brings_the_node_which_is_recorded_and_replayed(navloom: Navloom) -> None:
    run(navloom, *WITH, "--record", "run.mcap")
    code, out = navloom("replay", "run.mcap", "--plugin", "frontier.py", "--check", "--json")
    nodes = {node["node"]: node for node in json.loads(out)["nodes"]}
    assert (code, nodes["explorer frontier"]["differing"]) == (0, 0)
    assert nodes["explorer frontier"]["steps"] == nodes["localizer odometry"]["steps"]  # one a tick


def test_its_process_is_the_one_that_it_declares(navloom: Navloom) -> None:
    code, out = navloom("up", "paper", "--set", "run.stop_after=2", "--set", "robot.name=exploring", "--barrier",
                        "--json", *WITH)  # fmt: skip
    assert code == 1, out
    lockstep = run(navloom, *WITH, "--set", "robot.name=exploring")
    assert json.loads(out)["trace_sha256"] == lockstep["trace_sha256"]


def test_its_alternatives_run_in_shadow_and_are_compared(navloom: Navloom) -> None:
    (shadow,) = run(navloom, *WITH, "--plugin", "further.py", "--shadow", "explorer=further")["shadows"]
    assert (shadow["role"], shadow["instance"]) == ("explorer", "further")
    assert shadow["differing_share"] == 1.0  # 4 m ahead is not 2 m ahead


def test_a_recording_without_it_has_none_to_replace(navloom: Navloom) -> None:
    run(navloom, "--record", "without.mcap")
    code, out = navloom("replay", "without.mcap", "--plugin", "frontier.py", "--node", "explorer=frontier")
    assert (code, "the recording's config has no [explorer]" in out) == (2, True)


def test_its_failure_does_not_end_the_goal(navloom: Navloom, tmp_path: Path) -> None:
    broken = tmp_path / "broken.py"
    broken.write_text(FRONTIER.replace("pose =", "raise RuntimeError  #"), "utf-8")
    found = run(navloom, "--plugin", str(broken), "--set", "explorer.plugin=frontier")
    assert found["outcome"] == run(navloom)["outcome"] == "timeout"


def test_processes_need_not_name_it(navloom: Navloom) -> None:
    code, out = navloom("config", "show", "paper", "--json", *WITH, "--set", f"live.processes={{all={ALL}}}")
    assert code == 0, out
    values = {row["place"]: row["value"] for row in json.loads(out)["values"]}
    assert values["live.processes.nodes"] == ["explorer"]


def test_a_config_without_its_table_has_none_to_shadow(navloom: Navloom) -> None:
    code, out = navloom("run", "paper", "--plugin", "frontier.py", "--shadow", "explorer=frontier")
    assert code == 2
    assert 'alternative.0.role: got "explorer"' in out


def test_a_table_of_a_role_without_default_must_name_a_plugin(navloom: Navloom) -> None:
    code, out = navloom("run", "paper", "--set", "explorer.ahead=3")
    assert code == 2
    assert "explorer.plugin: is missing" in out


def test_commands_list_it(navloom: Navloom) -> None:
    code, out = navloom("plugins", "explorer", "--plugin", "frontier.py", "--json")
    assert code == 0
    assert json.loads(out)["verb"] == "explore(self, given: ExplorerInput) -> Point2D | None"


def test_its_plugins_are_checked(navloom: Navloom) -> None:
    code, out = navloom("check", "explorer.frontier", "--plugin", "frontier.py")
    assert code == 0, out
    assert "37 checks passed, 0 failed" in out

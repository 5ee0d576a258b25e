"""The configs and the script in docs/ros2.md are valid."""

import re
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from navloom.cli import main
from navloom_ros import Node, Types
from navloom_ros.serving.goals import Goals
from ros_network import Router

PAGE = (Path(__file__).parents[3] / "docs" / "ros2.md").read_text("utf-8")


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)


@pytest.fixture
def config(tmp_path):
    path = tmp_path / "turtlebot.toml"
    path.write_text(blocks("toml")[0], "utf-8")
    return path


@pytest.fixture
def said(monkeypatch, capsys):
    """Exit code and standard error of a command."""

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["navloom", *map(str, arguments)])
        try:
            main()
        except SystemExit as ended:
            return ended.code or 0, capsys.readouterr().err
        return 0, capsys.readouterr().err

    return run


def test_the_config_of_a_turtlebot_fits(config, said):
    assert said("config", "check", config) == (0, "")


def test_the_config_with_a_map_and_a_namespace_fits(config, said):
    config.write_text(blocks("toml")[1], "utf-8")
    config.with_name("map.pgm").write_bytes(b"P5\n80 80\n255\n" + bytes([254]) * 6400)
    config.with_name("map.yaml").write_text(
        "image: map.pgm\nresolution: 0.05\norigin: [-2.0, -2.0, 0.0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n",
        "utf-8",
    )
    assert said("config", "check", config) == (0, "")


def test_a_map_and_paths_of_ros_fit_into_it(config, said):
    ours = re.sub(r"\[mapper\].*?(?=\[navigation\])", blocks("toml")[2], blocks("toml")[0], flags=re.DOTALL)
    config.write_text(ours, "utf-8")
    assert said("config", "check", config) == (0, "")


def test_a_real_robot_is_not_moved_by_simulated_time(config, said):
    code, told = said("run", config, "--set", "navigation.goal.x=1.0", "--set", "navigation.goal.y=0.0")
    assert code == 2
    assert told.strip().endswith(
        "platform.plugin: ros2_base drives a real robot, which simulated time must not move; `navloom up` drives it"
    )


def test_a_base_without_a_timeout_is_refused_where_it_stands(config, said):
    config.write_text(config.read_text("utf-8").replace("base_timeout_s = 0.5", "base_timeout_s = 0.0"), "utf-8")
    code, told = said("config", "check", config)
    assert code == 2 and "without_base_timeout = true" in told and f"{config}:" in told


def test_the_script_for_nav2_runs(capsys):
    scope = {}
    exec(blocks("python")[0], scope)
    reached = SimpleNamespace(
        result=SimpleNamespace(outcome="succeeded", reason="", code="reached"), cancel=lambda: None
    )
    with Router() as router, Node("nav2", router=router.endpoint, types=Types("jazzy")) as node:
        goals = Goals(node, "map", (RuntimeError,), print)
        goals.robot = SimpleNamespace(go=lambda *place: reached)
        scope["patrol"](router.endpoint)
        goals.close()
    assert capsys.readouterr().out.startswith("succeeded the goal was reached\n")

"""Every file of examples/ runs, as a reader runs it."""

from __future__ import annotations

import json
import re
import socket
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from dist_rig import put_on_path
from live_rig import up
from navloom import Envelope, GateStatus, Message, StepRecord
from navloom.cli import main
from navloom.config import load_config
from navloom.plugins import one_file
from navloom.runs.episode import run_episode

pytestmark = pytest.mark.once
TOP = Path(__file__).resolve().parents[1]
EXAMPLES = TOP / "examples"
RUN = {f"people/{name}" for name in ("navloom_people.py", "pyproject.toml", "people.toml")}
"""Files that a test declares to run: those of tests/strangers, and with `runs` those of this module."""

Test = Callable[..., None]


def runs(*files: str) -> Callable[[Test], Test]:
    """Declare which files a test runs."""
    RUN.update(files)
    return lambda test: test


def script(name: str, *arguments: str, timeout: float = 120.0) -> list[str]:
    """Lines that a script prints; it must end with exit code 0."""
    command = [sys.executable, str(EXAMPLES / name), *arguments]
    done = subprocess.run(command, cwd=TOP, capture_output=True, text=True, timeout=timeout, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


@pytest.fixture
def turtle(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Installs the distribution of examples/turtle, as an editable install from its pyproject.toml does."""
    put_on_path(EXAMPLES / "turtle", tmp_path / "site", monkeypatch)


def test_every_file_is_declared_by_a_test() -> None:
    files = [path.relative_to(EXAMPLES) for path in EXAMPLES.rglob("*") if path.is_file()]
    kept = {path.as_posix() for path in files if "__pycache__" not in path.parts}
    assert kept == RUN


@runs("README.md")
def test_the_page_names_every_example_with_a_command_that_exists() -> None:
    text = (EXAMPLES / "README.md").read_text("utf-8")
    linked = set(re.findall(r"\]\(([^)]+)\)", text))
    for name in RUN - {"README.md"}:
        assert name in linked, name
    for name in linked | set(re.findall(r"examples/([\w./]+)", text)):
        assert (EXAMPLES / name).exists(), name


@runs("own_controller.py")
def test_the_example_controller_keeps_closer_to_its_trajectory_than_the_shipped_one() -> None:
    own, shipped = script("own_controller.py")
    assert own.startswith("bearing: succeeded") and shipped.startswith("lyapunov_tracker: succeeded")
    beside = [float(line.split("at most ")[1].split()[0]) for line in (own, shipped)]
    assert beside[0] < beside[1]


@runs("turtle/pyproject.toml", "turtle/navloom_turtle.py", "turtle/turtle.toml")
@pytest.mark.usefixtures("turtle")
def test_the_example_robot_is_listed_and_drives_to_its_goal(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def navloom(*words: str) -> str:
        monkeypatch.setattr(sys, "argv", ["navloom", *words])
        with pytest.raises(SystemExit) as ended:
            main()
        out, err = capsys.readouterr()
        assert not ended.value.code, err
        return out

    listed = json.loads(navloom("plugins", "--json"))
    assert [load["distribution"] for load in listed if load["name"] == "turtle"] == ["navloom-turtle"]
    result = json.loads(navloom("run", str(EXAMPLES / "turtle" / "turtle.toml"), "--json"))
    assert (result["truly_reached"], result["recoveries"]) == (True, 0)
    assert 1.5 < result["path_length_m"] < 2.0  # the straight way is 1.80 m, less the goal's tolerance
    assert "1 checks passed, 0 failed" in navloom("check", "platform.turtle", "--only", "reset_as_new")


def drives(name: str, monkeypatch: pytest.MonkeyPatch, *changes: str) -> dict[str, Any]:
    """Summary of a drive in an example whose platform, used as a file, brings its own simulator."""
    folder = EXAMPLES / name
    monkeypatch.setenv(one_file.FILES, "[]")
    one_file.use_files([folder / f"navloom_{name}.py"])
    return run_episode(load_config(str(folder / f"{name}.toml"), changes)).summary()


def files_of(name: str, scene: str) -> list[str]:
    return [f"{name}/{file}" for file in ("README.md", "pyproject.toml", f"navloom_{name}.py", f"{name}.toml", scene)]


@runs(*files_of("irsim_robot", "hall.yaml"))
def test_a_robot_in_ir_sim_drives_to_its_goal(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("irsim", reason="ir-sim is not installed: uv run --group foreign-worlds")
    result = drives("irsim_robot", monkeypatch)
    assert (result["outcome"], result["truly_reached"], result["collisions"]) == ("succeeded", True, 0)
    assert result["optimal_length_m"] == pytest.approx(8.14, abs=0.02) and result["path_length_m"] < 10.0


@runs(*files_of("mujoco_robot", "course.xml"))
def test_a_robot_in_mujoco_drives_past_a_post(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("mujoco", reason="mujoco is not installed: uv run --group foreign-worlds")
    result = drives("mujoco_robot", monkeypatch, "navigation.goal.x=3.0", "navigation.goal.y=0.0")
    assert (result["outcome"], result["truly_reached"], result["collisions"]) == ("succeeded", True, 0)
    assert 3.0 < result["optimal_length_m"] < 3.2
    assert 0.0 < result["pose_error_m"]["max"] < 0.05  # wheels slip a little: odometry is not the truth


@pytest.mark.parametrize(
    ("floor", "bounds"), [("6 4 0.1", (-5.0, -4.0, 7.0, 4.0)), ("0 0 0.1", (-3.0, -3.0, 23.5, 12.5))]
)
def test_the_bounds_of_a_mujoco_scene_are_those_of_its_floor(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, floor: str, bounds: tuple[float, ...]
) -> None:
    pytest.importorskip("mujoco", reason="mujoco is not installed: uv run --group foreign-worlds")
    monkeypatch.syspath_prepend(str(EXAMPLES / "mujoco_robot"))
    from navloom_mujoco_robot import MujocoParams, MujocoRobot

    scene = tmp_path / "hall.xml"
    scene.write_text(f"""<mujoco><worldbody>
      <geom name="floor" type="plane" size="{floor}" pos="1 0 0"/>
      <geom name="post" type="cylinder" size="0.3 0.4" pos="20 9 0.4"/>
      <body name="robot"><geom type="box" size="0.2 0.2 0.1" group="1"/></body>
    </worldbody></mujoco>""")
    assert MujocoRobot.own_world(MujocoParams(scene=str(scene))).bounds == pytest.approx(bounds)


SERIAL = ("navloom_serial_base.py", "serial_protocol.py", "play_base.py", "serial_base.toml", "pyproject.toml")


@runs(*(f"serial_base/{name}" for name in SERIAL))
def test_a_base_on_a_serial_line_is_driven_live_to_its_goal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, port = EXAMPLES / "serial_base", tmp_path / "base"
    put_on_path(folder, tmp_path / "site", monkeypatch)
    command = [sys.executable, str(folder / "play_base.py"), str(port)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as base:
        assert base.stdin is not None and base.stdout is not None
        assert base.stdout.readline() == f"a base is at {port}\n"
        with up(str(folder / "serial_base.toml"), "--set", f"platform.port={port}") as robot:
            robot.wait_for("every node is there")
            done = robot.run("goal", "0.8", "0.2")
        assert "succeeded: the goal was reached" in done.stdout, done.stderr
        base.stdin.write("press\n")
        base.stdin.flush()
        assert base.stdout.readline() == "press: wheels at 0.00 and 0.00 m/s\n"
        base.stdin.close()


LIDAR = ("navloom_udp_lidar.py", "lidar_packets.py", "play_lidar.py", "lidar_cart.toml", "pyproject.toml")


@runs(*(f"udp_lidar/{name}" for name in LIDAR))
def test_a_lidar_on_a_cart_becomes_a_map(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = EXAMPLES / "udp_lidar"
    put_on_path(folder, tmp_path / "site", monkeypatch)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with subprocess.Popen([sys.executable, str(folder / "play_lidar.py"), str(port), "60"]) as lidar:
        config = tmp_path / "cart.toml"
        config.write_text((folder / "lidar_cart.toml").read_text("utf-8").replace("port = 2368", f"port = {port}"))
        with up(str(config)) as robot:
            robot.wait_for("every node is there")
            done = robot.run("echo", "mapper/map", "--count", "1")
        lidar.kill()
    assert done.returncode == 0 and "grid" in done.stdout, done.stderr


@runs("mission.py")
@pytest.mark.usefixtures("turtle")
def test_a_mission_drives_a_live_robot_over_all_places(monkeypatch: pytest.MonkeyPatch) -> None:
    with up(str(EXAMPLES / "turtle" / "turtle.toml")) as robot:
        robot.wait_for("every node is there")
        monkeypatch.setenv("NAVLOOM_RUNTIME_DIR", robot.environment["NAVLOOM_RUNTIME_DIR"])
        first, second, total = script("mission.py", "0.8,0.4", "0.4,0.8", "--robot", "turtle")
    assert first.startswith("(0.8, 0.4): succeeded") and second.startswith("(0.4, 0.8): succeeded")
    assert total == "2 of 2 places reached"


class Drivers:
    """Observer that keeps which instance drives, and since which run time, s; the gate publishes each change."""

    wants = frozenset({("gate", "status")})
    wants_steps = False

    def __init__(self) -> None:
        self.changes: list[tuple[float, str]] = []

    def on_message(self, role: str, instance: str, active: bool, port: str, message: Message, at: Envelope) -> None:
        assert isinstance(message, GateStatus)
        self.changes.append((at.stamp_ns * 1e-9, message.instance))

    def on_step(self, record: StepRecord) -> None:
        raise AssertionError("not asked for")

    def spells(self, instance: str) -> list[tuple[float, float]]:
        """Begin and end of each spell in which an instance drove, s."""
        ends = [time for time, _ in self.changes[1:]]
        return [(start, end) for (start, who), end in zip(self.changes, ends, strict=False) if who == instance]


@runs("swap_while_avoiding.toml", "warehouse.toml")
def test_both_avoiders_drive_and_the_shadow_says_what_it_would_have_done() -> None:
    drivers = Drivers()
    episode = run_episode(load_config(str(EXAMPLES / "swap_while_avoiding.toml")), observers=[drivers])
    result = episode.summary()
    assert (result["truly_reached"], result["swaps"], result["collisions"]) == (True, 1, 0)
    first, second = drivers.spells("improved_vfh"), drivers.spells("careful")
    assert first[-1][1] == pytest.approx(11.05, abs=0.051) and second[0][0] == first[-1][1]  # at the event, in one tick
    assert first[-1][1] - first[-1][0] > 1.0 and second[0][1] - second[0][0] > 1.0
    (forces,) = [shadow for shadow in result["shadows"] if shadow["instance"] == "forces"]
    assert forces["differing_share"] > 0.5 and not drivers.spells("forces")


@runs("circle_swap.toml")
def test_ten_robots_swap_places_without_contact(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    config, out = str(EXAMPLES / "circle_swap.toml"), str(tmp_path / "out")
    monkeypatch.setattr(sys, "argv", ["navloom", "run", config, "--json", "--out", out])
    with pytest.raises(SystemExit) as ended:
        main()
    assert not ended.value.code
    result = json.loads(capsys.readouterr().out)
    assert (result["reached"], result["collisions"]) == (10, 0)
    assert list(result["members"]) == [f"robot{k}" for k in range(1, 11)]
    assert {"run.png", "result.json", "trace.bin"} <= {Path(file).name for file in result["written"]["out"]}
    own = json.loads((tmp_path / "out" / "robot2" / "result.json").read_text())
    assert own["trace_sha256"] == result["members"]["robot2"]["trace_sha256"]


@runs("barn_published.toml")
def test_each_published_method_drives_under_the_conditions_of_its_score() -> None:
    """The organisers' DWA and ours are capped at 0.5 m/s, and nothing checks commands against the scans."""
    config = str(EXAMPLES / "barn_published.toml")
    methods = [table["name"] for table in tomllib.loads(Path(config).read_text())["method"]]
    assert methods == ["move_base", "dwa", "vfh_swept", "mppi"]
    for name in methods[:2]:
        episode = run_episode(load_config(config, ["run.stop_after=3"], method=name))
        assert max(command[1] for command in episode.recorder.commands) == pytest.approx(0.5, abs=1e-6)
    assert all(load_config(config, method=name).config.gate.monitor is False for name in methods)


@runs("study.py")
def test_a_study_by_script_prints_a_row_a_method_and_world() -> None:
    head, *rows = script("study.py", "1")
    assert head.split()[0] == "controller"
    assert [row.split()[:3] for row in rows] == [
        [method, world, "100%"] for method in ("lyapunov_tracker", "pure_pursuit") for world in ("doorway", "clutter:0")
    ]

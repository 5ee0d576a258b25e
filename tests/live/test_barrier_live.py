"""Under the barrier, the trace equals that of lockstep, however the nodes are spread over processes."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from live_rig import runtime_folder
from navloom.config import load_config
from navloom.runs.episode import run_episode
from navloom_live.drives.barrier_run import run_barrier

ROLES = ["platform", "localizer", "mapper", "planner", "controller", "avoider", "recovery"]
SPREADS = {
    1: {"all": [*ROLES, "goal", "reference", "gate"]},
    3: {
        "robot": ["platform", "localizer", "gate"],
        "think": ["mapper", "planner", "goal"],
        "drive": ["reference", "controller", "avoider", "recovery", "avoider.other"],
    },
    6: {
        "a": ["platform"],
        "b": ["localizer", "gate"],
        "c": ["mapper", "planner"],
        "d": ["goal", "reference"],
        "e": ["controller", "recovery", "avoider.other"],
        "f": ["avoider"],
    },
}  # fmt: skip

ROLES_APART = {"robot": ["platform", "gate"], "rest": [*ROLES[1:], "goal", "reference"]}

EVENTFUL = """
[run]
seed = 3
stop_after = {stop}

[world]
ref = "paper_gates_obstacle"

[platform]
plugin = "sensors_sim"

[[sensor]]
name = "laser"
kind = "pitched_laser"
geometry = "paper"

[[sensor]]
name = "sonars"
kind = "sonar_ring"
layout = "p3dx"

[navigation]
start = {{ x = 0.0, y = 0.0, heading_deg = 90.0 }}
goal = {{ x = 0.0, y = 7.6 }}

[[alternative]]
name = "other"
role = "avoider"
plugin = "improved_vfh"
shadow = {shadow}

[controller]
plugin = "lyapunov_tracker"
latency = 0.05

[[event]]
at = 2.6
do = "swap"
role = "avoider"
name = "other"

[[event]]
at = 3.2
do = "set"
role = "controller"
values = {{ k3 = 1.0 }}

[[event]]
at = 4.0
do = "goal"
x = 0.5
y = 3.0

[[event]]
at = 4.5
do = "stop"

[[event]]
at = 5.0
do = "resume"
"""


def spread(processes: int) -> str:
    inside = ", ".join(f"{name} = {nodes}" for name, nodes in SPREADS[processes].items())
    return f"live.processes={{ {inside} }}".replace("'", '"')


@pytest.fixture
def folder(monkeypatch: pytest.MonkeyPatch) -> object:
    with runtime_folder() as path:
        monkeypatch.setenv("NAVLOOM_RUNTIME_DIR", str(path))
        yield path


@pytest.mark.parametrize("processes", [*(pytest.param(n, marks=pytest.mark.slow) for n in (1, 3)), 6])
def test_the_trace_is_that_of_lockstep_with_swap_latency_stop_and_new_parameters(
    processes: int, folder: Path, tmp_path: Path
) -> None:
    config = tmp_path / "eventful.toml"
    config.write_text(EVENTFUL.format(stop=7.0, shadow="true" if processes == 3 else "false"), "utf-8")
    loaded = load_config(str(config), [spread(processes)])
    expected = run_episode(loaded).summary()
    got = run_barrier(loaded).summary()
    assert got["swaps"] == 1 and expected["ticks"] > 130
    assert {key: got[key] for key in got if key not in VARYING} == {
        key: expected[key] for key in expected if key not in VARYING
    }
    assert not [name for name in os.listdir(folder / "lab.r1") if name.endswith(".sock")]


def test_the_trace_of_a_displaced_robot_is_that_of_lockstep(folder: Path) -> None:
    events = "event=[{at=2.0,do='displace',over=0.5,by={x=0.2,y=0.1}},{at=3.0,do='slip',by={heading_deg=10}}]"
    loaded = load_config("building", ["localizer.plugin=odometry", "run.stop_after=4.0", events])
    episode = run_episode(loaded)
    assert episode.trail.carried.sum() == 11
    assert run_barrier(loaded).log.trace_sha256 == episode.log.trace_sha256


@pytest.mark.parametrize("home", ["robot", "world"])
def test_the_trace_of_a_world_that_moves_is_that_of_lockstep(home: str, folder: Path) -> None:
    """The node `world` in the process of the platform, where it is by default, and in one of its own."""
    places = ROLES_APART | ({"world": ["world"]} if home == "world" else {})
    inside = ", ".join(f"{name} = {nodes}" for name, nodes in places.items()).replace("'", '"')
    changes = ["world.ref=crossing_person", "run.stop_after=4.0", f"live.processes={{ {inside} }}"]
    loaded = load_config("building", changes)
    assert run_barrier(loaded).log.trace_sha256 == run_episode(loaded).log.trace_sha256


def test_a_time_offset_is_added_live_as_in_lockstep(folder: Path) -> None:
    late = ["sensor.laser.stamp_delay=0.12", "sensor.laser.time_offset=-0.12", "run.stop_after=2.0"]
    loaded = load_config("building", late)
    expected = run_episode(loaded).log.trace_sha256
    assert run_barrier(loaded).log.trace_sha256 == expected
    assert run_episode(load_config("building", [late[0], late[2]])).log.trace_sha256 != expected


VARYING = {"wall_s", "tick_us", "planner_ms", "mapper_ms", "shadows"}
"""Keys of a summary that may differ: measured times, and shadows, which the barrier does not wait for."""


@pytest.mark.slow
@pytest.mark.parametrize("processes", [1, 3, 6])
def test_five_of_five_runs_of_the_paper_have_the_trace_of_lockstep(processes: int, folder: Path) -> None:
    if processes == 1:
        loaded = load_config("paper", [spread(1)])
    else:
        loaded = load_config("paper", [spread(processes).replace(', "avoider.other"', "")])
    expected = run_episode(loaded).log.trace_sha256
    assert [run_barrier(loaded).log.trace_sha256 for _ in range(5)] == [expected] * 5

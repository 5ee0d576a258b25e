"""Checks of a task before its first tick: delays that add up, places where the robot does not fit, real robots."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from navloom.config import ConfigError
from navloom.engine.build import assemble
from navloom.engine.system import System
from navloom.engine.task_checks import PlaceProblem, check_live, check_task, is_real, place_problem
from navloom.geometry.world import Box, World
from toys import discovery, toy_config


def system_of(folder: Path, *changes: str, more: str = "") -> System:
    return assemble(toy_config(folder, *changes, more=more), discovery())


def problems(folder: Path, *changes: str, more: str = "") -> str:
    """What a check says of a config; empty for nothing."""
    try:
        check_task(system_of(folder, *changes, more=more))
    except ConfigError as error:
        return str(error)
    return ""


# --- delays: a tick is 0.05 s, and commands may be 0.1 s old at the gate ----------------------------------------------


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (["controller.latency=0.1"], ""),
        (["controller.latency=0.051"], ""),  # two ticks
        (["controller.latency=0.101"], "controller.latency: is 0.101: the controller's commands are up to 0.15 s old"),
        (["localizer.latency=0.05", "controller.latency=0.05"], ""),
        (["localizer.latency=0.06", "controller.latency=0.05"],
         "localizer.latency: is 0.06: the controller's commands are up to 0.15 s old when they reach the gate, which "
         "stops beyond gate.stop_deadline = 0.1 s; make the localizer faster, or raise the deadline"),
        (["localizer.latency=0.05", "controller.latency=0.1"], "controller.latency: is 0.1: the controller's"),
        (["controller.rate_hz=10.0", "localizer.rate_hz=10.0"], ""),  # the longer of the two rests
        (["controller.rate_hz=10.0", "localizer.latency=0.1"],
         "localizer.latency: is 0.1: the controller's commands are up to 0.15"),
        (["localizer.rate_hz=5.0"], "localizer.rate_hz: is 5: the controller's commands are up to 0.15 s old"),
        (["avoider.latency=0.15"], "avoider.latency: is 0.15: the avoider's commands are up to 0.15 s old"),
        (["avoider.latency=0.15", 'navigation.handover="never"'], ""),
        (["controller.latency=0.15", "gate.stop_deadline=0.15"], ""),
        (["mapper.latency=9.9"], ""),
        (["planner.latency=1.0", "navigation.plan_timeout=1.0"],
         "planner.latency: is 1 s; expected less than navigation.plan_timeout = 1 s"),
        (["mapper.latency=1.0", "navigation.map_timeout=1.0"],
         "mapper.latency: is 1 s; expected less than navigation.map_timeout = 1 s"),
        (["navigation.speed=[0.5,0.5]"], ""),
        (["navigation.speed=[0.51,0.6]"],
         "navigation.speed: begins with 0.51 m/s, more than robot.max_linear = 0.5 m/s"),
    ],
)  # fmt: skip
def test_delays_and_speeds(tmp_path: Path, changes: list[str], said: str) -> None:
    found = problems(tmp_path, *changes)
    assert said in found if said else found == ""


def test_delays_of_both_drivers_are_told_once(tmp_path: Path) -> None:
    found = problems(tmp_path, "controller.latency=0.15", "avoider.latency=0.2")
    assert found.count("when they reach the gate") == 1 and "the controller's commands" in found


def test_all_problems_are_told_at_once(tmp_path: Path) -> None:
    found = problems(
        tmp_path,
        "planner.latency=50.0",
        "mapper.latency=50.0",
        "navigation.speed=[0.6,0.7]",
        "navigation.goal.x=99.0",
    )
    for word in ("planner.latency", "mapper.latency", "navigation.speed", "navigation.goal: (99, 0) is outside"):
        assert word in found


# --- limits of a live gate --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ([], ""),
        (["gate.stop_deadline=0.051", "gate.sensor_timeout=0.051"], ""),
        (["gate.stop_deadline=0.05"], "gate.stop_deadline: is 0.05 s; expected more than run.period = 0.05 s"),
        (["gate.sensor_timeout=0.05"], "gate.sensor_timeout: is 0.05 s; expected more than run.period = 0.05 s"),
    ],
)
def test_a_live_gate_waits_for_more_than_a_period(tmp_path: Path, changes: list[str], said: str) -> None:
    system = system_of(tmp_path, *changes)
    check_task(system)
    if not said:
        check_live(system)
        return
    with pytest.raises(ConfigError) as caught:
        check_live(system)
    assert said in str(caught.value) and "give 0.1 s or more" in str(caught.value)


@pytest.mark.parametrize(("timeout", "is_refused"), [(0.5, True), (1.49, True), (1.5, False), (2.0, False)])
def test_a_live_node_may_wait_for_a_dead_reader_until_its_link_is_closed(
    tmp_path: Path, timeout: float, is_refused: bool
) -> None:
    system = system_of(tmp_path, f"live.hang_timeout={timeout}")
    check_task(system)
    if not is_refused:
        check_live(system)
        return
    with pytest.raises(ConfigError) as caught:
        check_live(system)
    assert str(caught.value).count(f"live.hang_timeout: is {timeout:g} s; expected 1.5 s or more") == 1


# --- goals and real robots --------------------------------------------------------------------------------------------


def test_a_simulated_run_needs_a_goal(tmp_path: Path) -> None:
    missing = "navigation.goal: is missing, and the world names none; give one, as in goal = { x = 0.0, y = 7.6 }"
    system = system_of(tmp_path)
    object.__setattr__(system, "goal", None)
    with pytest.raises(ConfigError) as caught:
        check_task(system)
    assert missing in str(caught.value)
    check_live(system)
    assert missing in problems(tmp_path, "navigation.drive=false")
    event = '[[event]]\nat = 2.0\ndo = "goal"\nx = 1.0\ny = 0.0\n'
    assert problems(tmp_path, "navigation.drive=false", more=event) == ""


def real(folder: Path, *changes: str) -> System:
    system = system_of(folder, *changes)
    key = ("platform", system.config.platform.instance)
    part: Any = system.parts[key]
    driver = type("Driver", (part.cls,), {"is_simulated": False})
    system.parts[key] = replace(part, cls=driver)  # type: ignore[index]
    return system


def test_simulated_time_does_not_move_a_real_robot(tmp_path: Path) -> None:
    assert not is_real(system_of(tmp_path))
    system = real(tmp_path)
    assert is_real(system)
    with pytest.raises(ConfigError, match="toy_robot drives a real robot, which simulated time must not move"):
        check_task(system)
    check_live(system)


def test_a_real_robot_has_a_size(tmp_path: Path) -> None:
    system = real(tmp_path)
    loaded = system.loaded
    sizeless = SimpleNamespace(
        config=loaded.config, error=loaded.error, gives=lambda key: key != "robot.footprint" and loaded.gives(key)
    )
    object.__setattr__(system, "loaded", sizeless)
    with pytest.raises(ConfigError, match=r"robot\.footprint: is missing, and toy_robot is a real robot"):
        check_live(system)


# --- places -----------------------------------------------------------------------------------------------------------

HALL = World("hall", (Box("wall", (2.0, 3.0), (-4.0, 4.0)),), None, None, None, (-5.0, -5.0, 5.0, 5.0))


@pytest.mark.parametrize(
    ("x", "y", "said"), [(-1.0, 0.0, False), (4.0, 0.0, False), (-1.01, 0.0, True), (4.01, 0.0, True),
                         (0.0, -2.0, False), (0.0, 3.0, False), (0.0, -2.01, True), (0.0, 3.01, True)]
)  # fmt: skip
def test_a_place_at_the_edge_of_the_world_is_within_it(tmp_path: Path, x: float, y: float, said: bool) -> None:
    world = replace(HALL, obstacles=(), bounds=(-1.0, -2.0, 4.0, 3.0))
    system: Any = SimpleNamespace(world=world, robot=system_of(tmp_path).robot)
    found = place_problem(system, x, y, None)
    text = f"({x:g}, {y:g}) is outside the world hall, which reaches from (-1, -2) to (4, 3) m"
    assert found == (PlaceProblem(text, is_outside=True) if said else None)


def test_without_a_world_every_place_is_free(tmp_path: Path) -> None:
    assert place_problem(SimpleNamespace(world=None, robot=system_of(tmp_path).robot), 1e9, 0.0, None) is None  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("gap", "heading", "fits"),
    [
        (0.31, None, True),  # any heading will do: the disc within the footprint, of 0.3 m
        (0.29, None, False),
        (0.31, 0.0, False),  # the front is at 0.5 m
        (0.51, 0.0, True),
        (0.31, 90.0, True),
        (0.29, 90.0, False),
        (0.3, 90.0, False),  # touching is not fitting
    ],
)
def test_a_robot_fits_with_the_heading_that_is_asked_for(
    tmp_path: Path, gap: float, heading: float | None, fits: bool
) -> None:
    """A footprint of 1.0 x 0.6 m before a wall at x = 2."""
    system = system_of(tmp_path, "robot.footprint={length=1.0,width=0.6}")
    found = place_problem(
        SimpleNamespace(world=HALL, robot=system.robot),  # type: ignore[arg-type]
        2.0 - gap, 0.5, None if heading is None else math.radians(heading),
    )  # fmt: skip
    text = f"the robot does not fit at ({2.0 - gap:g}, 0.5): occupied by wall"
    assert found == (None if fits else PlaceProblem(text))

"""What a config leaves out is stated once, by its tables and by the roles; commands and tools agree with them."""

from __future__ import annotations

import inspect
import typing

import pytest
from navloom.cli.plan import plan
from navloom.config.schema import Config
from navloom.config.tables import MapTable, RobotTable
from navloom.engine.build import robot_spec
from navloom.roles import ROLES
from navloom.testing import planner_input, wall_ahead
from navloom_recording.cli.replay import Plugin, replay
from navloom_recording.missing_plugins import TRIED
from navloom_study.cli.map import map_recording


def default_of(command: object, name: str) -> object:
    return inspect.signature(command).parameters[name].default  # type: ignore[arg-type]


def test_commands_have_the_defaults_of_the_config() -> None:
    config = Config()  # type: ignore[call-arg]  # the roles' tables are filled in
    assert default_of(plan, "resolution") == MapTable().resolution == 0.05
    assert default_of(plan, "planner") == config.planner.plugin
    assert default_of(map_recording, "mapper") == config.mapper.plugin


def test_maps_of_unit_tests_have_the_cells_of_a_config() -> None:
    assert planner_input(wall_ahead()).map.grid.resolution == MapTable().resolution


def test_a_robot_without_a_config_is_that_of_the_table() -> None:
    robot = robot_spec(RobotTable())
    assert (robot.max_linear, robot.max_deceleration, robot.height) == (0.5, 1.0, 1.2)


@pytest.mark.parametrize("role", ROLES)
def test_every_role_declares_its_facts(role: str) -> None:
    facts = ROLES[role].facts
    assert facts.called.endswith(".")
    assert facts.is_optional or facts.default_plugin


def test_replay_has_an_option_for_each_role_that_it_names_as_one() -> None:
    hints = typing.get_type_hints(replay, include_extras=True)
    assert {name for name, hint in hints.items() if hint == Plugin} == set(TRIED) <= set(ROLES)

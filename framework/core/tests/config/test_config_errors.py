"""All problems of a config at once: place and line, value, expectation and the nearest fix."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Literal

import pytest
from navloom.config import ConfigError, check_params, load_config
from navloom.config.toml_lines import line_of
from navloom.engine.build import robot_spec
from navloom.plugins import Discovery
from navloom.roles import Params
from pydantic import Field

BAD = """\
[run]
seed = "7"
sed = 3
period = -1.0

[robot]
max_linear = true
name = 7

[controller]
k3 = "fast"

[navigation]
handover = "allways"
speed = [0.4,
         "x"]
"""
SAID = [
    ":2: run.seed: got '7', expected a whole number; leave the quotes out: seed = 7",
    ":3: run.sed: unknown key; did you mean 'seed'?",
    ":4: run.period: got -1.0, expected at least 0.001",
    ":7: robot.max_linear: got true, expected a number",
    ':8: robot.name: got 7, expected text in quotes, as in "text"; write name = "7"',
    ":11: controller.k3: got 'fast', expected a number",
    ":14: navigation.handover: got 'allways', expected 'when_blocked', 'always' or 'never'; did you mean 'always'?",
    ":15: navigation.speed.1: got 'x', expected a number",
]


def test_all_problems_are_reported_at_once_with_their_lines(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(BAD, "utf-8")
    with pytest.raises(ConfigError) as caught:
        load_config(str(path))
    assert str(caught.value).splitlines() == [f"{path}{line}" for line in SAID]


def test_contradictions_of_instances_and_sensors_are_reported_at_once(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    text = 2 * '[[sensor]]\nname = "a"\nkind = "x"\n' + '[avoider]\nsensors = ["b"]\n'
    path.write_text(text + '[[alternative]]\nrole = "platform"\nplugin = "x"\n', "utf-8")
    with pytest.raises(ConfigError) as caught:
        load_config(str(path))
    assert str(caught.value).splitlines() == [
        f'{path}:5: sensor.1.name: two tables [[sensor]] are named "a"',
        f'{path}:8: avoider.sensors: names "b"; sensors are a, a',
        f"{path}:10: alternative.0.role: is a platform: the platform is never shadowed or swapped",
        f"{path}:11: alternative.0.plugin: no plugin 'platform.x' is installed; known are "
        f"{', '.join(Discovery().names('platform'))}",
    ]


@pytest.mark.parametrize(
    "change",
    ['run.seed="7"', "run.seed=true", "run.seed=7.5", 'robot.height="1"', "robot.height=true", "navigation.drive=1",
     'navigation.drive="true"', "robot.name=7"],
)  # fmt: skip
def test_no_value_is_converted_to_another_type(change: str) -> None:
    with pytest.raises(ConfigError, match=rf"--set {change.partition('=')[0]}: got .*, expected"):
        load_config("paper", [change])


def test_set_takes_numbers_switches_and_bare_texts() -> None:
    config = load_config("paper", ["run.seed=7", "robot.height=1", "navigation.drive=false", "robot.name=r2"]).config
    assert (config.run.seed, config.robot.height, config.navigation.drive, config.robot.name) == (7, 1.0, False, "r2")


class Own(Params):
    gain: float = Field(1.0, gt=0.0)
    beams: int = 3
    smooth: bool = True
    span: tuple[float, float] = (0.0, 1.0)
    limit: float | Literal["none"] = "none"
    folder: Path = Path("maps")


def test_a_plugins_parameters_are_as_strict() -> None:
    with pytest.raises(ConfigError) as caught:
        check_params(Own, {"gain": "1", "beams": 3.0, "smooth": 0, "span": [0, "1"], "limit": True}, "planner")
    assert str(caught.value).splitlines() == [
        "planner.gain: got '1', expected a number; leave the quotes out: gain = 1",
        "planner.beams: got 3.0, expected a whole number; write beams = 3",
        "planner.smooth: got 0, expected true or false; write smooth = false",
        "planner.span.1: got '1', expected a number; leave the quotes out: span = 1",
        "planner.limit: got true, expected a number or 'none'",
    ]


def test_values_without_a_toml_type_are_accepted() -> None:
    own = check_params(Own, {"gain": 2, "span": [1, 2.5], "folder": "here", "limit": 4}, "planner")
    assert (own.gain, own.span, own.folder, own.limit) == (2.0, (1.0, 2.5), Path("here"), 4.0)


TEXT = "# words\n[run]\nseed = 1\n\n[robot]\nfootprint = { polygon = [\n  [1, 1],\n] }\n"
TEXT += '[[sensor]]\nname = "a"\n[[sensor]]\n'


@pytest.mark.parametrize(
    ("place", "line"),
    [("run", 2), ("run.seed", 3), ("robot.footprint.polygon.0", 6), ("sensor.0.name", 10), ("sensor.1", 11),
     ("sensor.1.kind", 11), ("run.sed", 2), ("nowhere", None)],
)  # fmt: skip
def test_a_place_has_the_line_on_which_it_begins(place: str, line: int | None) -> None:
    assert line_of(TEXT, place) == line


def test_a_file_without_a_footprint_names_the_assumed_size(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text("[run]\nseed = 3\n", "utf-8")
    (notice,) = load_config(str(path)).notices()
    size = "{ length = 0.8, width = 0.8 }, in m"
    assert notice == f"{path}: robot.footprint: is missing; default {size}: give your robot's size"
    assert load_config("paper").notices() == []
    assert load_config(str(path), ["robot.footprint.length=1.0", "robot.footprint.width=1.0"]).notices() == []


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (['robot.drive="ackermann"'], 'drive = "ackermann" needs wheelbase and max_steering_deg'),
        (['robot.drive="ackermann"', "robot.wheelbase=0.5"], 'drive = "ackermann" needs max_steering_deg'),
        (["robot.wheelbase=0.5"], 'drive = "differential" has no steered wheels: expected no wheelbase, or drive'),
    ],
)
def test_the_keys_of_steered_wheels_belong_to_an_ackermann_robot(given: list[str], said: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(said)):
        load_config("explore", given)


def test_the_turn_radius_of_an_ackermann_robot_is_its_wheelbase_over_the_tangent_of_its_steering() -> None:
    given = ['robot.drive="ackermann"', "robot.wheelbase=0.5", "robot.max_steering_deg=45"]
    assert robot_spec(load_config("explore", given).config.robot).turn_radius == pytest.approx(0.5)

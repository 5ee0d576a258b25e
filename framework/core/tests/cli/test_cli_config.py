"""`navloom config check` and `show` as a user reads them."""

from __future__ import annotations

import json
import random
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from navloom.config import ConfigError, load_config, shipped_configs
from navloom.config.config_tree import leaves
from navloom.engine.build import assemble
from navloom.engine.task_checks import check_live, check_task
from navloom.plugins import PluginError

CommandLine = Callable[..., tuple[int, str, str]]
LASER = '[world]\nref = "doorway"\n[[sensor]]\nname = "laser"\nkind = "laser_2d"\n'


def values(in_process: CommandLine, *words: str) -> dict[str, tuple[Any, str]]:
    """Value and source of each key that `config show` prints."""
    code, said, error = in_process("config", "show", *words, "--json")
    assert code == 0, error
    return {value["place"]: (value["value"], value["source"]) for value in json.loads(said)["values"]}


def test_a_config_that_cannot_drive_does_not_fit(in_process: CommandLine, tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(LASER, "utf-8")
    for words in (("config", "check"), ("run",)):
        code, said, error = in_process(*words, str(path))
        assert (code, said) == (2, "")
        assert error.splitlines()[-1].startswith(
            f"navloom: {path}: mapper.plugin: ipabd, the default, needs a sensor that gives Sweep, and there is none "
            "among laser_2d: add a [[sensor]] of kind pitched_laser, or take another mapper, as known_map or "
        )


def test_a_value_that_only_its_plugin_refuses_does_not_fit(in_process: CommandLine) -> None:
    code, said, error = in_process("config", "check", "building", "--set", "sensor.laser.rate_hz=7")
    assert (code, said) == (2, "") and "sensor laser: rate_hz = 7, expected the tick rate, 20" in error


def test_check_and_run_say_which_size_is_assumed(in_process: CommandLine, tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(LASER + '[mapper]\nplugin = "known_map"\n', "utf-8")
    notice = f"{path}: robot.footprint: is missing; default {{ length = 0.8, width = 0.8 }}, in m"
    code, said, _ = in_process("config", "check", str(path))
    assert code == 0 and said.startswith(notice) and said.endswith("fits; 7 plugins, 1 sensor\n")
    _, _, error = in_process("run", str(path), "--set", "navigation.goal.x=99.0", "--set", "navigation.goal.y=0.0")
    assert error.startswith(f"navloom: {notice}")


def test_show_prints_each_value_and_its_source(in_process: CommandLine) -> None:
    shown = values(in_process, "building", "--set", "sensor.laser.beams=99")
    assert shown["sensor.0.beams"] == (99, "--set")
    assert shown["sensor.0.range_max"] == (20.0, "file")
    assert shown["sensor.0.dropout"] == (0.0, "default")  # of the platform
    assert shown["avoider.sensors"] == (["laser"], "default")
    assert shown["mapper.name"] == ("layered", "default")
    assert shown["navigation.goal.y"] == (6.0, "world")
    assert shown["map.ref"] == ("world", "default")


def test_show_tells_how_sure_a_start_is_and_where_a_simulated_robot_truly_stands(in_process: CommandLine) -> None:
    search = ("--set", "localizer.plugin=global_matching")
    guess = values(in_process, "building", *search, "--set", "navigation.start={x=1,y=2,spread=0.7}")
    assert guess["navigation.start.spread"] == (0.7, "--set")
    assert guess["navigation.start.heading_spread_deg"] == (pytest.approx(15.0), "default")
    unknown = values(in_process, "building", *search, "--set", "navigation.start=unknown")
    assert unknown["navigation.start"] == ("unknown", "--set") and unknown["world.start.heading_deg"] == (90.0, "world")
    assert unknown["navigation.localizer_timeout"] == (120.0, "derived from localizer and recovery")


def test_each_line_of_show_can_be_given_to_set(in_process: CommandLine) -> None:
    code, said, _ = in_process("config", "show", "paper")
    assert code == 0
    for line in said.splitlines()[1:]:
        value = line.split(maxsplit=1)[1].rpartition("  ")[0].strip()
        assert value == "-" or "value" in tomllib.loads(f"value = {value}"), line


STRANGE: list[Any] = ["", "x", "7", True, -1, 0, 10**30, 1e300, 1e-300, float("nan"), float("inf"), [], [1, "a"], {},
                      {"x": 1}, [[]], None]  # fmt: skip


def mutated(name: str, number: int) -> dict[str, Any]:
    """A shipped config in which one to three values are replaced, removed, or joined by an unknown key."""
    draw = random.Random(f"{name} {number}")
    tree: dict[str, Any] = tomllib.loads(shipped_configs()[name])
    for _ in range(draw.randint(1, 3)):
        place, _ = draw.choice(list(leaves(tree)))
        table: Any = tree
        *keys, last = place.split(".")
        for key in keys:
            table = table[int(key)] if isinstance(table, list) else table[key]
        do, value = draw.choice(("put", "put", "put", "leave", "join")), draw.choice(STRANGE)
        if do == "leave" or value is None:
            del table[last]
        else:
            table[f"{last}x" if do == "join" else last] = value
    return tree


def as_toml(value: Any) -> str:
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{key} = {as_toml(inner)}' for key, inner in value.items())} }}"
    if isinstance(value, list):
        return f"[{', '.join(map(as_toml, value))}]"
    return str(value) if isinstance(value, float) else json.dumps(value)


@pytest.mark.parametrize("name", sorted(shipped_configs()))
def test_a_damaged_config_gives_one_typed_error(name: str, tmp_path: Path) -> None:
    path, refused = tmp_path / "robot.toml", 0
    for number in range(60):
        tree = mutated(name, number)
        path.write_text("\n".join(f"{key} = {as_toml(value)}" for key, value in tree.items()), "utf-8")
        try:
            check_task(assemble(load_config(str(path))))
        except (ConfigError, PluginError) as error:
            refused += 1
            assert str(error) and "Traceback" not in str(error)
            for word in ("pydantic", "input should", "Extra inputs", "value_error", "validation error"):
                assert word.lower() not in str(error).lower()
    assert refused > 30


@pytest.mark.parametrize("limit", ["stop_deadline", "sensor_timeout"])
def test_a_live_robot_whose_gate_would_stop_it_in_every_tick_is_refused(limit: str) -> None:
    changes = ["run.period=0.2", "gate.stop_deadline=0.4", "gate.sensor_timeout=0.5"]
    check_live(assemble(load_config("paper", changes)))
    refused = assemble(load_config("paper", [*changes, f"gate.{limit}=0.2"]))
    check_task(refused)  # lockstep has no time between two ticks
    with pytest.raises(
        ConfigError, match=rf"gate\.{limit}: is 0.2 s; expected more than run\.period = 0.2 s.*give 0.4 s"
    ):
        check_live(refused)


def test_show_names_what_a_parameter_is_derived_from(in_process: CommandLine) -> None:
    """0.5 m wide: half the inscribed radius is 0.125 m. 0.5 m/s and 1 m/s²: v²/b is 0.25 m."""
    shown = values(in_process, "building", "--set", "controller.plugin=graceful")
    assert shown["controller.min_look_ahead"] == (0.125, "derived from footprint and drive")
    assert shown["controller.approach_distance"] == (0.25, "derived from max_linear and max_deceleration")


def test_a_given_value_is_not_derived(in_process: CommandLine) -> None:
    given = ("--set", "controller.plugin=graceful", "--set", "controller.approach_distance=0.4")
    assert values(in_process, "building", *given)["controller.approach_distance"] == (0.4, "--set")


def test_show_resolves_a_word_of_the_config(in_process: CommandLine) -> None:
    shown = values(in_process, "building", "--set", "planner.inflation_radius=inscribed")
    assert shown["planner.inflation_radius"] == (0.25, "--set, derived from footprint")


def test_the_speeds_of_the_reference_follow_from_the_robot(in_process: CommandLine) -> None:
    shown = values(in_process, "building", "--set", "robot.max_linear=2.0", "--set", "robot.max_acceleration=1.5")
    assert shown["navigation.speed"] == ([0.8, 1.6], "derived from max_linear")
    assert shown["navigation.lateral_acceleration"] == (pytest.approx(0.9), "derived from max_acceleration")


def test_set_can_take_back_what_the_file_gives(in_process: CommandLine) -> None:
    """`explore` gives speeds for its own robot of 2 m/s."""
    slow = ("--set", "robot.max_linear=0.15")
    assert in_process("config", "check", "explore", *slow)[0] == 2
    shown = values(in_process, "explore", *slow, "--set", "navigation.speed=default")
    assert shown["navigation.speed"] == (pytest.approx([0.06, 0.12]), "derived from max_linear")


def test_a_slow_robot_needs_no_speed_of_its_own(in_process: CommandLine) -> None:
    code, _, error = in_process("config", "check", "building", "--set", "robot.max_linear=0.15")
    assert code == 0, error


@pytest.mark.parametrize("name", sorted(shipped_configs()))
def test_show_toml_prints_a_shipped_config_to_begin_from(in_process: CommandLine, tmp_path: Path, name: str) -> None:
    code, said, _ = in_process("config", "show", name, "--toml")
    assert code == 0 and said.startswith(shipped_configs()[name])
    added = said.removeprefix(shipped_configs()[name]).splitlines()
    assert added and all(line.startswith("# ") and "derived from " in line for line in added)
    path = tmp_path / "mine.toml"
    path.write_text(said, "utf-8")
    assert load_config(str(path)).sha256() == load_config(name).sha256()


@pytest.mark.parametrize("words", [("--json",), ("--set", "run.seed=1"), ("--method", "a")])
def test_show_toml_refuses_options_that_it_would_ignore(in_process: CommandLine, words: tuple[str, ...]) -> None:
    code, said, error = in_process("config", "show", "paper", "--toml", *words)
    assert (code, said) == (2, "")
    assert f"--toml with {words[0]}: it prints the file as it is" in error


METHODS = """
[mapper]
plugin = "known_map"

[navigation]
start = { x = 0.0, y = 0.0 }
goal = { x = 1.0, y = 0.0 }

[[method]]
name = "good"
set = { avoider.plugin = "vff" }

[[method]]
name = "bad"
set = { avoider.plugin = "vfff" }

[[method]]
name = "worse"
set = { avoider.cel = 1 }
"""


def test_show_tells_which_values_a_method_gives(in_process: CommandLine, tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(LASER + METHODS, "utf-8")
    found = values(in_process, str(path), "--method", "good")
    assert found["avoider.plugin"] == ("vff", "method good")
    assert values(in_process, str(path))["avoider.plugin"][1] == "default"


def test_check_checks_every_method(in_process: CommandLine, tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(LASER + METHODS, "utf-8")
    code, said, error = in_process("config", "check", str(path))
    assert (code, said) == (2, "")
    assert "method bad: avoider.plugin: " in error
    assert "method worse: avoider.cel: unknown key" in error
    assert in_process("config", "check", str(path), "--method", "good")[0] == 0

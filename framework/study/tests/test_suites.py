"""Suites: what their file may hold, and what a file of methods may not change, however it spells it."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path

import pytest
from navloom.config import ConfigError
from navloom.plugins import Discovery
from navloom_study.suites import suite_run
from navloom_study.suites.method_files import read_methods
from navloom_study.suites.suite import read_suite, read_suite_table, suite_named
from navloom_study.suites.suite_run import SuitePlan, family_names, plan_suite, run_suite

TINY = """
name = "tiny-1"
about = "One empty world."
primary = "success"
config = "explore"
seeds = "0:2"
baseline = "dwa"
methods = ["avoider=dwa,vff"]

[[part]]
name = "empty"
worlds = ["empty"]
"""


@pytest.fixture
def tiny(tmp_path: Path) -> Path:
    path = tmp_path / "tiny-1.toml"
    path.write_text(TINY, "utf-8")
    return path


def planned(tiny: Path, methods: str) -> SuitePlan:
    file = tiny.with_name("mine.toml")
    file.write_text(methods, "utf-8")
    return plan_suite(read_suite(tiny), [], read_methods(file))


@pytest.mark.parametrize(
    ("settings", "named"),
    [
        ("robot.max_linear = 9.0", "robot"),
        ('"robot.max_linear" = 9.0', "robot"),
        ("robot = { max_linear = 9.0 }", "robot"),
        ("gate.monitor = false", "gate"),
        ("platform.motor_time_constant = 0.0", "platform"),
        ('platform.plugin = "sensors_sim"', "platform"),
        ("sensor = []", "sensor"),
        ("sensor.laser.sigma = 0.0", "sensor"),
        ('world.ref = "empty"', "world"),
        ('map.ref = "world"', "map"),
        ("avoider.latency = 0.0", "avoider.latency"),
        ('"avoider.latency" = 0.1', "avoider.latency"),
        ("navigation.goal_tolerance = 2.0", "navigation.goal_tolerance"),
        ('"navigation.goal_tolerance" = 2.0', "navigation.goal_tolerance"),
        ("navigation = { goal = { x = 1.0, y = 1.0 } }", "navigation.goal"),
        ("navigation.localizer_timeout = 500.0", "navigation.localizer_timeout"),
        ("run.stop_after = 900.0", "run"),
        ('event = [{ at = 1.0, do = "cancel" }]', "event"),
        ("member = []", "member"),
        ('plugins.blocked = ["platform.sensors_sim"]', "plugins"),
        ("alternative = []", "alternative"),
        ('node = [{ name = "platform", plugin = "people_tracker" }]', '"platform" is a name of the framework'),
        ('node = [{ name = "gate", plugin = "people_tracker" }]', '"gate" is a name of the framework'),
        ('node = [{ name = "ears", plugin = "people_tracker", latency = 0.2 }]', "node.latency"),
        ('node.ears = { plugin = "people_tracker", latency = 0.2 }', "node.ears.latency"),
        ('mapper.plugin = "known_map"', "mapper.known_map needs a map of the world, and tiny-1 gives none"),
        ('localizer.plugin = "mcl"', "localizer.mcl needs a map of the world"),
        ('avoider.plugin = "orca", avoider.inputs = { tracks = "world.bodies" }', "avoider.inputs.tracks"),
        ('avoider.preset = "nope"', "nope"),
    ],
)
def test_a_method_that_changes_the_suite_is_refused_by_name(tiny: Path, settings: str, named: str) -> None:
    with pytest.raises(ConfigError) as refused:
        planned(tiny, f'[[method]]\nname = "mine"\nset = {{ {settings} }}\n')
    assert named in str(refused.value)


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ('[robot]\nmax_linear = 9.0\n[[method]]\nname = "m"\n', "mine.toml:1: robot: belongs to the suite"),
        ('gate.monitor = false\n[[method]]\nname = "m"\n', "gate: belongs to the suite"),
        ('[[method]]\nname = "dwa"\n', "tiny-1 has a method of its own with that name"),
        ('[[method]]\nname = "m"\n[[method]]\nname = "m"\n', "mine.toml:4: method.1.name: m is there twice"),
        ("", "method: is missing"),
        ('[[method]]\nname = "../m"\n', "method.0.name"),
    ],
)
def test_a_file_of_methods_holds_nothing_else(tiny: Path, text: str, named: str) -> None:
    with pytest.raises(ConfigError) as refused:
        planned(tiny, text)
    assert named in str(refused.value)


def test_a_method_sets_what_a_method_may(tiny: Path) -> None:
    plan = planned(
        tiny,
        '[[method]]\nname = "mine"\nset = { avoider.plugin = "vff@printed", planner.plugin = "astar", '
        'navigation.speed = [0.2, 0.5], node = [{ name = "people", plugin = "people_tracker" }] }\n',
    )
    (method,) = plan.studies["empty"].methods
    config = method.loaded.config
    assert (config.avoider.plugin, config.planner.plugin, config.navigation.speed) == ("vff", "astar", (0.2, 0.5))
    assert [key[:4] for key in plan.tasks()] == [("mine", "empty", "empty", 0), ("mine", "empty", "empty", 1)]


def test_a_condition_holds_over_a_method(tiny: Path) -> None:
    tiny.write_text(TINY + "set = { robot.max_linear = 0.7 }\n", "utf-8")
    (method,) = planned(tiny, '[[method]]\nname = "mine"\n').studies["empty"].methods
    assert method.loaded.config.robot.max_linear == 0.7


@pytest.mark.parametrize(
    ("more", "named"),
    [
        ('set = { avoider.plugin = "vff" }\n', "part.0.set.avoider.plugin: a method sets it"),
        ('[[part]]\nname = "empty"\nworlds = ["empty"]\n', "empty is there twice"),
        ("wrong = 1\n", "part.0.wrong"),
        ('[data]\n"no/such.npz" = "00"\n', "NAVLOOM_DATA"),
    ],
)
def test_a_suite_that_does_not_fit_is_refused(
    tiny: Path, more: str, named: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("NAVLOOM_DATA", raising=False)
    tiny.write_text(TINY + more, "utf-8")
    with pytest.raises(ConfigError, match=r"tiny-1") as refused:
        read_suite(tiny)
    assert named in str(refused.value)


def test_the_hash_of_a_suite_follows_what_an_episode_depends_on(tiny: Path) -> None:
    before = read_suite(tiny).sha256
    tiny.write_text(TINY.replace("One empty", "An empty"), "utf-8")
    assert read_suite(tiny).sha256 == before
    tiny.write_text(TINY.replace('"0:2"', '"0:3"'), "utf-8")
    assert read_suite(tiny).sha256 != before


SHIPPED = sorted(Discovery().names("suite"))


def test_the_suites_of_the_project_are_installed() -> None:
    assert {
        "barn-1",
        "crowd-1",
        "doors-1",
        "dynamic-1",
        "localise-1",
        "paper-1",
        "sensors-1",
        "start-1",
        "static-1",
    } <= {*SHIPPED}


@pytest.mark.parametrize("name", SHIPPED)
def test_every_method_of_a_shipped_suite_can_drive_in_all_its_conditions(name: str) -> None:
    """One that a condition refuses would end the whole study, before its first episode."""
    table, _ = read_suite_table(Discovery().suite(name))
    own = family_names(table.methods)
    assert table.baseline in own
    if table.data and "NAVLOOM_DATA" not in os.environ:
        pytest.skip(f"{name} reads {', '.join(table.data)} in the folder NAVLOOM_DATA, which is not set")
    plan = plan_suite(suite_named(name, Discovery()), own, {})
    assert {method for method, *_ in plan.tasks()} == {*own}


def test_the_file_of_a_suite_is_shown(in_process: Callable[..., tuple[int, str, str]]) -> None:
    code, said, _ = in_process("plugins", "suite.doors-1")
    assert code == 0
    assert 'config = "paper"' in said and 'worlds = ["door:1.6"]' in said
    assert json.loads(in_process("plugins", "suite.doors-1", "--json")[1])["primary"] == "success"


def test_progress_tells_the_time_that_is_left_for_all_parts(tiny: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 2 parts with 2 episodes each, one episode took 10 s."""
    tiny.write_text(TINY + '[[part]]\nname = "again"\nworlds = ["empty"]\n', "utf-8")
    told: list[tuple[int, int, float | None]] = []

    def study(*_: object, progress: Callable[[int, int, float | None], None], **__: object) -> None:
        progress(1, 2, 10.0)
        raise InterruptedError

    monkeypatch.setattr(suite_run, "run_study", study)
    with pytest.raises(InterruptedError):
        run_suite(plan_suite(read_suite(tiny), ["dwa"], {}), progress=lambda *given: told.append(given))
    assert told == [(1, 4, 30.0)]

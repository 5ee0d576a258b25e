"""A wrong answer is blamed on the plugin that made it, with the file and line of its verb or of its own mistake."""

from __future__ import annotations

import inspect
import linecache
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path as FilePath
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from navloom import (
    Avoidance,
    AvoiderInput,
    Controller,
    ControllerInput,
    Localizer,
    LocalizerInput,
    Mapper,
    MapperInput,
    MapUpdate,
    OccupancyGrid,
    Odometry,
    Params,
    Path,
    PlanFailure,
    Planner,
    PlannerInput,
    PlatformInput,
    PlatformOutput,
    Point2D,
    Pose2D,
    PoseEstimate,
    RangeScan,
    Recovery,
    RecoveryInput,
    RecoveryStep,
    Registry,
    RobotSpec,
    SensorSpec,
    TrackingCommand,
    Twist2D,
    hookimpl,
)
from navloom.cli.run import tell_faults
from navloom.geometry.world import Raster, World
from navloom.logs import Level, set_up_logging
from navloom.messages import Command, Sweep
from navloom.plugins import Discovery, PluginError
from navloom.runs.episode import Episode, run_episode
from toys import QUIET, Bystander, Chaser, Robot, toy_config

SOURCE = FilePath(__file__).name
STILL = Twist2D(0.0, 0.0, 0.0)
ORIGIN = Pose2D(0.0, 0.0, 0.0)
WALL_CLOCK_NS = 1_700_000_000_000_000_000


class Case(Params):
    case: str = ""


# --- the plugins: right until a case makes them wrong ---------------------------------------------------------------


class WrongRobot(Robot):
    name = "wrong_robot"
    sensor_kinds = {"ear": RangeScan, "tilt": Sweep}

    class Params(Robot.Params, Case):
        pass

    def advance(self, given: PlatformInput) -> PlatformOutput:
        right = super().advance(given)
        right = replace(right, scans={"ear": right.scans["ear"]})
        return said(self, given.time_ns, right, given)


class WrongLocalizer(Localizer):
    name = "wrong_localizer"
    Params = Case

    def localize(self, given: LocalizerInput) -> PoseEstimate:
        odometry = given.odometry
        right = PoseEstimate(odometry.stamp_ns, odometry.pose, odometry.twist, np.eye(3))
        return said(self, odometry.stamp_ns, right, given)


class WrongMapper(Mapper):
    name = "wrong_mapper"
    accepts = (RangeScan,)
    Params = Case

    def update(self, given: MapperInput) -> MapUpdate | None:
        grid = OccupancyGrid(np.zeros((40, 40), np.int8), 0.5, Pose2D(-5.0, -10.0, 0.0))
        right = MapUpdate(given.stamp_ns, grid, np.empty((0, 4)), ())
        return said(self, given.stamp_ns, right, given)


class WrongPlanner(Planner):
    name = "wrong_planner"
    Params = Case

    def plan(self, given: PlannerInput) -> Path | PlanFailure:
        start, goal = given.request.start, given.request.goal
        right = Path(given.request.request_id, np.array([(start.x, start.y), (goal.x, goal.y)]), 3.0, None)
        return said(self, WALL_CLOCK_NS, right, given)


class WrongController(Chaser):
    name = "wrong_controller"

    class Params(Chaser.Params, Case):
        pass

    def control(self, given: ControllerInput) -> TrackingCommand:
        return said(self, given.stamp_ns, super().control(given), given)


class WrongAvoider(Bystander):
    name = "wrong_avoider"

    class Params(Bystander.Params, Case):
        is_trapped: bool = False

    def avoid(self, given: AvoiderInput) -> Avoidance:
        right = Avoidance(given.desired, "trapped" if self.params.is_trapped else "clear", QUIET)
        return said(self, given.stamp_ns, right, given)


class WrongRecovery(Recovery):
    name = "wrong_recovery"
    Params = Case

    def recover(self, given: RecoveryInput) -> RecoveryStep:
        return said(self, WALL_CLOCK_NS, RecoveryStep(STILL, "running", False), given)


class Vandal(Controller):
    """Writes into its input."""

    name = "vandal"

    def control(self, given: ControllerInput) -> TrackingCommand:
        self.context.robot.footprint[:] = 0.0
        return TrackingCommand(STILL, 0.0, 0.0, 0.0)


PLUGINS = (WrongRobot, WrongLocalizer, WrongMapper, WrongPlanner, WrongController, WrongAvoider, WrongRecovery)
VERBS = {
    "platform": WrongRobot.advance,
    "localizer": WrongLocalizer.localize,
    "mapper": WrongMapper.update,
    "planner": WrongPlanner.plan,
    "controller": WrongController.control,
    "avoider": WrongAvoider.avoid,
    "recovery": WrongRecovery.recover,
}


def said(plugin: Any, stamp_ns: int, right: Any, given: Any) -> Any:
    """The right answer or, from the time of the case on, the wrong one."""
    case = CASES.get(plugin.params.case)
    return right if case is None or stamp_ns < case.since * 1e9 else case.wrong(right, given)


# --- the table ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Wrong:
    """A wrong answer.

    Attributes:
        role: Role of the plugin that gives it.
        wrong: Makes it from the right answer and the input.
        text: Text in the message.
        own_line: Text of the plugin's own line that is blamed; empty where the verb is blamed.
        since: Run time from which on it is given, s.
    """

    role: str
    wrong: Callable[[Any, Any], Any]
    text: str
    own_line: str = ""
    since: float = 0.5


def grid(rows: int, cell: int, resolution: float) -> Any:
    return np.full((rows, 40), cell, np.int8), resolution, Pose2D(-5.0, -10.0, 0.0)


def remade(right: MapUpdate, **changed: Any) -> MapUpdate:
    return replace(right, **changed)


def heard(right: PlatformOutput, **changed: Any) -> PlatformOutput:
    return replace(right, scans={"ear": replace(right.scans["ear"], **changed)})


def swept(right: PlatformOutput, request_id: int, name: str = "tilt") -> PlatformOutput:
    stamp, one = right.odometry.stamp_ns, np.ones(1)
    sweep = Sweep(stamp, request_id, np.ones((1, 1)), one, one, one, "paper", 0.0, 0.0, 1.0, 0.1, 4.0)
    return replace(right, scans={name: sweep})


CASES = {
    "no output": Wrong("platform", lambda right, given: None, "advance() returned None, expected PlatformOutput"),
    "no contact": Wrong(
        "platform", lambda right, given: replace(right, contact=None), "advance() gave contact=None, expected Contact"
    ),
    "pose for odometry": Wrong(
        "platform",
        lambda right, given: replace(right, odometry=right.odometry.pose),
        "advance() gave odometry=Pose2D(",
    ),
    "pose for truth": Wrong(
        "platform",
        lambda right, given: replace(right, truth=right.odometry.pose),
        "expected Truth or None",
    ),
    "list of scans": Wrong(
        "platform",
        lambda right, given: replace(right, scans=list(right.scans.values())),
        "expected messages by sensor name, as {'laser': scan}",
    ),
    "sweep for scan": Wrong(
        "platform",
        lambda right, given: swept(right, 0, "ear"),
        "advance() gave Sweep for the sensor 'ear', expected RangeScan",
    ),
    "none for scan": Wrong(
        "platform",
        lambda right, given: replace(right, scans={"ear": None}),
        "advance() gave None for the sensor 'ear', expected RangeScan",
    ),
    "unknown sensor": Wrong(
        "platform",
        lambda right, given: replace(right, scans={"nose": right.scans["ear"]}),
        "advance() gave a scan of 'nose', expected one of ear, tilt",
    ),
    "sweep nobody asked for": Wrong(
        "platform", lambda right, given: swept(right, 7), "advance() gave a sweep for request 7, expected 0"
    ),
    "odometry of the past": Wrong(
        "platform",
        lambda right, given: replace(right, odometry=replace(right.odometry, stamp_ns=0)),
        "advance() gave odometry stamped 0.000 s, expected 0.450 s or later",
    ),
    "odometry on the wall clock": Wrong(
        "platform",
        lambda right, given: replace(right, odometry=replace(right.odometry, stamp_ns=WALL_CLOCK_NS)),
        "advance() gave odometry stamped 1700000000.000 s, expected run clock in ns, which is at 0.500 s",
    ),
    "odometry before the start": Wrong(
        "platform",
        lambda right, given: replace(right, odometry=Odometry(-1, right.odometry.pose, STILL)),
        "Odometry.stamp_ns: got -1, expected a run clock in ns, at least 0",
        own_line="Odometry(-1",
    ),
    "odometry in degrees": Wrong(
        "platform",
        lambda right, given: replace(right, odometry=Odometry(given.time_ns, Pose2D(0.0, 0.0, 90.0), STILL)),
        "Pose2D.heading: got 90.0, expected rad in [-π, π]; degrees?",
        own_line="Pose2D(0.0, 0.0, 90.0)",
    ),
    "scan of the past": Wrong(
        "platform",
        lambda right, given: heard(right, stamp_ns=0),
        "advance() gave a scan of 'ear' stamped 0.000 s, expected 0.450 s or later",
    ),
    "scan of the future": Wrong(
        "platform",
        lambda right, given: heard(right, stamp_ns=given.time_ns + 2_000_000_000),
        "advance() gave a scan of 'ear' stamped 2.500 s, expected run clock in ns, which is at 0.500 s",
    ),
    "range_min beyond range_max": Wrong(
        "platform",
        lambda right, given: heard(right, range_min=5.0, range_max=4.0),
        "advance() gave a scan of 'ear' with range_min 5 and range_max 4, expected range_max above range_min: "
        "a reading of range_max or more is no echo",
    ),
    "odometry for pose": Wrong(
        "localizer", lambda right, given: given.odometry, "localize() returned Odometry(", since=0.5
    ),
    "old pose": Wrong(
        "localizer",
        lambda right, given: replace(right, stamp_ns=0),
        "localize() gave a pose stamped 0.000 s, expected the odometry's stamp, 0.500 s",
    ),
    "pose of another time": Wrong(
        "localizer",
        lambda right, given: replace(right, stamp_ns=given.odometry.stamp_ns + 1_000_000),
        "localize() gave a pose stamped 0.501 s, expected the odometry's stamp, 0.500 s",
    ),
    "pose in degrees": Wrong(
        "localizer",
        lambda right, given: replace(right, pose=Pose2D(0.0, 0.0, 90.0)),
        "Pose2D.heading: got 90.0, expected rad in [-π, π]; degrees?",
        own_line="Pose2D(0.0, 0.0, 90.0)",
    ),
    "negative variance": Wrong(
        "localizer",
        lambda right, given: replace(right, covariance=-np.eye(3)),
        "localize() gave variances [-1.0, -1.0, -1.0], expected values of at least 0",
    ),
    "grid for update": Wrong("mapper", lambda right, given: right.grid, "update() returned OccupancyGrid(", since=0.0),
    "resolution 0": Wrong(
        "mapper",
        lambda right, given: remade(right, grid=OccupancyGrid(*grid(40, 0, 0.0))),
        "OccupancyGrid.resolution: got 0.0, expected a number above 0",
        own_line="OccupancyGrid(*grid(40, 0, 0.0))",
        since=0.0,
    ),
    "resolution below 0": Wrong(
        "mapper",
        lambda right, given: remade(right, grid=OccupancyGrid(*grid(40, 0, -0.1))),
        "OccupancyGrid.resolution: got -0.1, expected a number above 0",
        own_line="OccupancyGrid(*grid(40, 0, -0.1))",
        since=0.0,
    ),
    "cells of -5": Wrong(
        "mapper",
        lambda right, given: remade(right, grid=OccupancyGrid(*grid(40, -5, 0.5))),
        "OccupancyGrid.cells: holds -5, expected values from -1 to 100",
        own_line="OccupancyGrid(*grid(40, -5, 0.5))",
        since=0.0,
    ),
    "no cells": Wrong(
        "mapper",
        lambda right, given: remade(right, grid=OccupancyGrid(*grid(0, 0, 0.5))),
        "update() gave a grid of shape (0, 40), expected at least one cell",
        since=0.0,
    ),
    "map on the wall clock": Wrong(
        "mapper",
        lambda right, given: remade(right, stamp_ns=WALL_CLOCK_NS),
        "update() gave a map stamped 1700000000.000 s, expected run clock in ns, which is at 0.000 s",
        since=0.0,
    ),
    "map of the past": Wrong(
        "mapper",
        lambda right, given: remade(right, stamp_ns=0),
        "update() gave a map stamped 0.000 s, expected the stamp of its newest data, which was 1.950 s",
        since=2.0,
    ),
    "no path": Wrong("planner", lambda right, given: None, "plan() returned None, expected Path or PlanFailure"),
    "path of another request": Wrong(
        "planner",
        lambda right, given: replace(right, request_id=right.request_id + 1),
        "plan() answered request 2, expected request 1, which was asked",
    ),
    "failure of another request": Wrong(
        "planner",
        lambda right, given: PlanFailure(0, "no_path", Point2D(0.0, 0.0), "nothing"),
        "plan() answered request 0, expected request 1, which was asked",
    ),
    "path from elsewhere": Wrong(
        "planner",
        lambda right, given: replace(right, points=right.points + [(-1.0, 0.0), (0.0, 0.0)]),
        "plan() gave a path that starts at (-1.00, 0.00), expected (0.00, 0.00), as asked, within 0.71 m",
    ),
    "path to elsewhere": Wrong(
        "planner",
        lambda right, given: replace(right, points=right.points + [(0.0, 0.0), (0.0, 0.8)]),
        "plan() gave a path that ends at (3.00, 0.80), expected (3.00, 0.00), as asked, within 0.71 m",
    ),
    "path without points": Wrong(
        "planner",
        lambda right, given: Path(right.request_id, np.empty((0, 2)), 0.0, None),
        "Path.points: got shape (0, 2), expected at least one element",
        own_line="Path(right.request_id, np.empty((0, 2))",
    ),
    "no command": Wrong("controller", lambda right, given: None, "control() returned None, expected TrackingCommand"),
    "command of another role": Wrong(
        "controller", lambda right, given: Command(STILL), "control() returned Command(", since=0.5
    ),
    "error in degrees": Wrong(
        "controller",
        lambda right, given: TrackingCommand(STILL, 0.0, 0.0, 45.0),
        "TrackingCommand.e3: got 45.0, expected rad in [-π, π]; degrees?",
        own_line="TrackingCommand(STILL, 0.0, 0.0, 45.0)",
    ),
    "twist for avoidance": Wrong("avoider", lambda right, given: right.twist, "avoid() returned Twist2D(", since=0.5),
    "no avoidance": Wrong("avoider", lambda right, given: None, "avoid() returned None, expected Avoidance"),
    "no recovery": Wrong("recovery", lambda right, given: None, "recover() returned None, expected RecoveryStep"),
    "command for recovery": Wrong("recovery", lambda right, given: Command(STILL), "recover() returned Command("),
}


@hookimpl
def navloom_register(registry: Registry) -> None:
    for plugin in (*PLUGINS, Vandal):
        registry.add(plugin)
    registry.world_scheme("torn", torn_world)


def torn_world(argument: str, base: FilePath) -> World:
    if argument == "none":
        return None  # type: ignore[return-value]
    if argument == "value":
        raise ValueError("no such place")
    return {}[argument]


def discovery() -> Discovery:
    sys.modules.setdefault("navloom_test_blame", sys.modules[__name__])
    names = [*(f"{plugin.role}.{plugin.name}" for plugin in (*PLUGINS, Vandal)), "scheme.torn"]
    ours = [EntryPoint(name, "navloom_test_blame", "navloom") for name in names]
    return Discovery(found=[*entry_points(group="navloom"), *ours])


ROLES = '[localizer]\nplugin = "wrong_localizer"\n[recovery]\nplugin = "wrong_recovery"\n'
TILT = '[[sensor]]\nname = "tilt"\nkind = "tilt"\n'


def drive(folder: FilePath, *overrides: str, more: str = "") -> Episode:
    """A run of 3 m with the plugins above and these overrides."""
    roles = [f"{role}.plugin=wrong_{role}" for role in ("mapper", "planner", "controller", "avoider")]
    config = toy_config(folder, "platform.plugin=wrong_robot", *roles, *overrides, more=ROLES + TILT + more)
    return run_episode(config, discovery=discovery())


# --- the tests ------------------------------------------------------------------------------------------------------


def test_without_a_case_the_plugins_reach_the_goal(tmp_path: FilePath) -> None:
    episode = drive(tmp_path)
    assert (episode.summary()["truly_reached"], episode.log.faults) == (True, [])


def test_the_table_covers_every_role_with_at_least_25_wrong_answers() -> None:
    assert len(CASES) >= 25 and {case.role for case in CASES.values()} == set(VERBS)


@pytest.mark.parametrize("name", CASES)
def test_the_plugin_that_made_a_wrong_answer_is_blamed_by_its_line(tmp_path: FilePath, name: str) -> None:
    case = CASES[name]
    trap = ["avoider.is_trapped=true", "navigation.handover=always"] if case.role == "recovery" else []
    episode = drive(tmp_path, f"{case.role}.case={name}", *trap)
    (fault,) = episode.log.faults
    assert episode.result.outcome == "error" and episode.result.reason == fault
    instance = "wrong_robot" if case.role == "platform" else f"wrong_{case.role}"
    assert fault.startswith(f"{case.role} {instance} failed: ") and case.text in fault
    others = {plugin.name for plugin in PLUGINS} - {instance} | {f"{v.__name__}()" for r, v in VERBS.items()}
    others.discard(f"{VERBS[case.role].__name__}()")
    assert not [other for other in others if other in fault]
    (line,) = re.findall(rf"\({re.escape(SOURCE)}:(\d+)\)$", fault)
    if case.own_line:
        assert case.own_line in linecache.getline(__file__, int(line))
    else:
        assert int(line) == inspect.getsourcelines(VERBS[case.role])[1]


def test_a_shadow_that_writes_into_the_footprint_breaks_alone(tmp_path: FilePath) -> None:
    more = '[[alternative]]\nname = "shady"\nrole = "controller"\nplugin = "vandal"\nshadow = true\n'
    episode = drive(tmp_path, more=more)
    assert episode.summary()["truly_reached"]
    (fault,) = episode.log.faults
    assert re.fullmatch(
        rf"controller shady failed: ValueError: assignment destination is read-only \({re.escape(SOURCE)}:\d+\)", fault
    )
    assert episode.system.robot.footprint.max() == 0.4


def test_a_plugin_cannot_write_into_its_input() -> None:
    outline = np.array([(0.4, 0.4), (-0.4, 0.4), (-0.4, -0.4), (0.4, -0.4)])
    robot = RobotSpec(outline, 1.2, 0.05, 0.3, 0.5, 0.4, 0.5, 1.0)
    raster = Raster("hall", np.zeros((2, 2), np.bool_), 0.1)
    assert not robot.footprint.flags.writeable and not raster.occupied.flags.writeable
    outline[0, 0] = 9.0
    assert robot.footprint[0, 0] == 0.4
    with pytest.raises(TypeError, match="does not support item assignment"):
        SensorSpec("ear", "ear", {"beams": 3}).settings["beams"] = 4  # type: ignore[index]


class Looker(WrongRecovery):
    name = "wrong_recovery"

    def recover(self, given: RecoveryInput) -> RecoveryStep:
        given.trail[0, 0] = 7.0
        return super().recover(given)


def test_the_trail_of_a_recovery_cannot_be_written(tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(WrongRecovery, "recover", Looker.__dict__["recover"])
    episode = drive(tmp_path, "avoider.is_trapped=true", "navigation.handover=always")
    (fault,) = episode.log.faults
    assert fault.startswith("recovery wrong_recovery failed: ValueError: assignment destination is read-only")


@pytest.fixture
def turning(monkeypatch: pytest.MonkeyPatch) -> Callable[[float, float], None]:
    """Makes the avoider command a speed, m/s, and a turn rate, rad/s."""

    def turn(speed: float, rate: float) -> None:
        wrong = Wrong("avoider", lambda right, given: replace(right, twist=Twist2D(speed, 0.0, rate)), "")
        monkeypatch.setitem(CASES, "turns", wrong)

    return turn


def limited(episode: Episode) -> list[dict[str, Any]]:
    """Warnings about commands beyond the limits."""
    return [warning for warning in episode.summary()["warnings"] if warning["kind"] == "limits"]


TURNS = ("avoider.case=turns", "robot.max_angular_deg=25.0", "run.stop_after=3.0")


def test_a_command_far_beyond_the_limits_is_limited_with_one_warning(
    tmp_path: FilePath, turning: Callable[[float, float], None]
) -> None:
    turning(0.1, 20.0)
    episode = drive(tmp_path, *TURNS)
    (warning,) = limited(episode)
    line = inspect.getsourcelines(WrongAvoider.avoid)[1]
    # 20 rad/s of 25 degrees a second, which are 0.436 rad/s.
    assert warning["plugin"] == "wrong_avoider"
    assert warning["text"] == (
        "avoider wrong_avoider asked for 46 times the turn limit: degrees? "
        f"It gave 20 rad/s of 0.436 ({SOURCE}:{line}); the gate limits it"
    )
    assert episode.log.faults == [] and episode.result.outcome == "timeout"


def test_run_prints_the_warning(capsys: pytest.CaptureFixture[str]) -> None:
    set_up_logging(Level.INFO, as_json=False)
    tell_faults(SimpleNamespace(log=SimpleNamespace(faults=[], failed=[])), {"warnings": [{"text": "46 times"}]})
    assert "46 times" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("speed", "rate", "notes"),
    [(0.1, 9.9 * 0.4363, []), (0.1, -10.1 * 0.4363, ["10 times the turn limit"]), (-6.0, 0.0, ["12 times the speed"])],
)
def test_a_command_of_ten_times_a_limit_gives_a_warning(
    tmp_path: FilePath, turning: Callable[[float, float], None], speed: float, rate: float, notes: list[str]
) -> None:
    turning(speed, rate)
    told = limited(drive(tmp_path, *TURNS))
    assert [wanted in one["text"] for wanted, one in zip(notes, told, strict=True)] == [True] * len(notes)


def test_a_plugin_that_keeps_no_context_drives_as_before(tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(WrongController, "__init__", lambda self, params, context: setattr(self, "params", params))
    assert drive(tmp_path).summary()["truly_reached"]


def test_a_world_scheme_that_breaks_is_blamed_by_name_and_line() -> None:
    line = inspect.getsourcelines(torn_world)[1] + 5
    with pytest.raises(PluginError) as caught:
        discovery().world("torn:hall", FilePath())
    assert str(caught.value) == f"world scheme 'torn' fails at 'torn:hall': KeyError: 'hall' ({SOURCE}:{line})"


def test_a_world_scheme_that_gives_no_world_is_blamed_by_name() -> None:
    with pytest.raises(PluginError, match="world scheme 'torn' gives NoneType for 'torn:none', expected World"):
        discovery().world("torn:none", FilePath())


def test_a_world_scheme_that_refuses_a_reference_is_not_blamed() -> None:
    with pytest.raises(ValueError, match=r"^no such place$"):
        discovery().world("torn:value", FilePath())

"""The start pose that the robot believes in, the true one, and which localizers can search for it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
from navloom.config import Config, ConfigError
from navloom.engine.build import assemble
from navloom.engine.plugin_factory import make_plugins
from navloom.engine.starts import starts_of
from navloom.engine.trace import read_trace
from navloom.geometry.world import Place, World
from navloom.messages import Drive, Feedback, OperatorRequest, Pose2D, PoseEstimate, RecoveryRequest
from navloom.roles import ANYWHERE
from navloom.runs.episode import run_episode
from toys import discovery, toy_config

OWN = World("room", start=Place(1.0, 2.0, 0.5))
FINDER = ("localizer.plugin=toy_finder", "recovery.plugin=toy_turner")
HOME = Pose2D(0.0, 0.0, 0.0)


def config(told: object = None, **world: object) -> Config:
    plugins = {role: {"plugin": "x"} for role in ("platform", "mapper", "planner", "controller", "avoider")}
    navigation = {} if told is None else {"start": told}
    return Config.model_validate({**plugins, "navigation": navigation, "world": {"ref": "room", **world}})


def test_without_a_start_it_is_the_worlds_and_known() -> None:
    own = Pose2D(1.0, 2.0, 0.5)
    assert starts_of(config(), OWN) == (own, None, own)


def test_a_start_of_the_config_is_told_and_true_as_before() -> None:
    given = Pose2D(-1.0, 3.0, 0.0)
    assert starts_of(config({"x": -1, "y": 3}), OWN) == (given, None, given)


@pytest.mark.parametrize(
    ("spreads", "sigma"),
    [
        ({"spread": 1.0, "heading_spread_deg": 30.0}, (1.0, math.radians(30.0))),
        ({"spread": 1.0}, (1.0, math.radians(15.0))),
        ({"heading_spread_deg": 30.0}, (0.5, math.radians(30.0))),
    ],
)
def test_a_spread_makes_it_a_guess(spreads: dict[str, float], sigma: tuple[float, float]) -> None:
    assert starts_of(config({"x": -1, "y": 3, **spreads}), OWN)[1] == sigma


def test_an_unknown_start_tells_nothing_of_the_truth() -> None:
    assert starts_of(config("unknown"), OWN) == (HOME, ANYWHERE, Pose2D(1.0, 2.0, 0.5))


def test_the_world_of_a_config_may_say_where_the_robot_truly_stands() -> None:
    start = {"x": 4.0, "y": 5.0, "heading_deg": 90.0}
    told, sigma, true = starts_of(config({"x": 0, "y": 0, "spread": 2.0}, start=start), OWN)
    assert (told, sigma) == (HOME, (2.0, math.radians(15.0))) and true == Pose2D(4.0, 5.0, math.pi / 2)


def test_the_offset_is_added_to_the_true_start() -> None:
    _, _, true = starts_of(config("unknown", start_offset={"x": 0.25, "heading_deg": 90.0}), OWN)
    assert (true.x, true.y) == (1.25, 2.0) and true.heading == pytest.approx(0.5 + math.pi / 2)


def test_an_unknown_start_in_a_world_without_one_is_refused_with_the_remedy() -> None:
    with pytest.raises(ConfigError, match=r'is "unknown", and the world bare has no start: .* \[world\] start = \{ x'):
        starts_of(config("unknown"), World("bare"))


def test_a_real_robot_whose_start_is_unknown_needs_no_true_one() -> None:
    assert starts_of(config("unknown"), None)[:2] == (HOME, ANYWHERE)


@pytest.mark.parametrize(("start", "what"), [("unknown", "is unknown"), ("{x=0,y=0,spread=1}", "is a guess")])
def test_a_localizer_that_cannot_search_refuses_such_a_start_and_those_that_can_are_named(
    start: str, what: str, tmp_path: Path
) -> None:
    loaded = toy_config(tmp_path, f"navigation.start={start}", "world.start={x=0,y=0}")
    with pytest.raises(ConfigError) as refused:
        assemble(loaded, discovery())
    (problem,) = refused.value.problems
    assert f"navigation.start: {what}, and localizer odometry cannot search" in problem and '"toy_finder"' in problem


def test_an_event_that_no_localizer_can_follow_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r'event\.0\.do: "relocalise" makes the robot search, and localizer odometry'):
        assemble(toy_config(tmp_path, more='[[event]]\nat = 1.0\ndo = "relocalise"\n'), discovery())


def test_only_the_localizer_learns_how_sure_the_start_is(tmp_path: Path) -> None:
    loaded = toy_config(tmp_path, *FINDER, "navigation.start={x=1,y=0,spread=2,heading_spread_deg=90}")
    system = assemble(loaded, discovery())
    make_plugins(system)
    told = {role: system.plugin(role, name).context.start_sigma for role, name in system.parts}
    assert told.pop("localizer") == (2.0, math.pi / 2) and set(told.values()) == {None}


def traced(tmp_path: Path, *overrides: str, more: str = "") -> list[tuple[int, Any]]:
    file = tmp_path / "trace.bin"
    with file.open("wb") as out:
        run_episode(toy_config(tmp_path, *FINDER, *overrides, more=more), discovery=discovery(), trace=out)
    return [(entry.envelope.tick, entry.message) for entry in read_trace(file)]


def test_a_robot_that_starts_anywhere_looks_around_finds_itself_and_reaches_its_goal(tmp_path: Path) -> None:
    loaded = toy_config(tmp_path, *FINDER, "navigation.start=unknown", "world.start={x=0,y=0}")
    episode = run_episode(loaded, discovery=discovery())
    assert episode.summary()["outcome"] == "succeeded" and episode.summary()["truly_reached"]


def test_the_recovery_is_asked_while_the_localizer_searches_and_the_drive_begins_after_that(tmp_path: Path) -> None:
    entries = traced(tmp_path, "navigation.start=unknown", "world.start={x=0,y=0}")
    asked = [(tick, one.active, one.reason) for tick, one in entries if isinstance(one, RecoveryRequest)]
    found = next(tick for tick, one in entries if isinstance(one, PoseEstimate) and one.state == "tracking")
    # In the second tick, when the goal has heard which instances are active. 3 rad at 0.5 rad/s take 6 s: 120 ticks.
    assert asked == [(1, True, "searching"), (found, False, "")] and 120 <= found <= 125
    drives = [tick for tick, one in entries if isinstance(one, Drive) and one.path_id]
    assert min(drives) > found
    states = {one.state for tick, one in entries if isinstance(one, Feedback) and 2 <= tick < found}
    assert states == {"searching"}


@pytest.mark.parametrize(
    ("more", "requested"),
    [
        ('do = "relocalise"', OperatorRequest("relocalise")),
        ('do = "place"\nx = 0.5\ny = 0.0\nheading_deg = 0.0\nspread = 0.7', None),
    ],
)
def test_an_event_has_the_localizer_search_and_the_goal_waits(
    more: str, requested: OperatorRequest | None, tmp_path: Path
) -> None:
    entries = traced(tmp_path, more=f"[[event]]\nat = 2.0\n{more}\n")
    request = next(one for tick, one in entries if tick == 40 and isinstance(one, OperatorRequest))
    if requested is None:
        assert (request.do, request.spread, request.heading_spread) == ("place", 0.7, math.radians(15.0))
    else:
        assert request == requested
    states = {tick: one.state for tick, one in entries if isinstance(one, PoseEstimate)}
    assert (states[39], states[40]) == ("tracking", "searching") and states[max(states)] == "tracking"

"""From a finished episode to its trail."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from navloom.engine.build import assemble
from navloom.geometry.world import Box, Place, World
from navloom.messages import (
    Command,
    Envelope,
    GateStatus,
    GoalResult,
    HandOver,
    Message,
    Point2D,
    Pose2D,
    Reference,
    Selection,
    StopReason,
    Truth,
    Twist2D,
)
from navloom.runs.episode import Episode, run_episode
from navloom.runs.episode_recorder import Recorder
from navloom.runs.episode_trail import WayLengths, _truly, ways_of
from navloom.runs.metrics import measure
from toys import discovery, toy_config


@pytest.fixture(scope="module")
def toy(tmp_path_factory: pytest.TempPathFactory) -> Episode:
    """A run of the toys, 3 m straight ahead; they need no warm-up."""
    return run_episode(toy_config(tmp_path_factory.mktemp("toy")), discovery=discovery())


def test_a_trail_has_one_entry_a_tick(toy: Episode) -> None:
    trail = toy.trail
    assert trail.time.tolist() == pytest.approx([0.05 * tick for tick in range(toy.log.ticks)])
    for name in ("x", "y", "heading", "vx", "wz", "clearance", "cross_track", "command_vx", "command_wz", "engaged"):
        assert getattr(trail, name).shape == trail.time.shape, name
    assert trail.tick_ns.size == toy.log.ticks and (trail.tick_ns < np.array(toy.log.tick_ns)).all()


def test_a_trail_agrees_with_the_drive(toy: Episode) -> None:
    trail = toy.trail
    assert (trail.outcome, trail.reason) == ("succeeded", "the goal was reached")
    # 3 m to the goal, and the tolerance of 0.2 m need not be driven.
    assert (trail.optimal, trail.reference) == pytest.approx((2.8, 3.0))
    assert trail.goal_distance == pytest.approx(3.0 - trail.x[-1]) and trail.goal_distance <= 0.21
    assert (trail.period, trail.limit, trail.max_linear) == (0.05, 60.0, 0.5)
    assert (trail.max_deceleration, trail.reaction) == (1.0, 0.10)
    assert not trail.engaged.any() and not trail.stopped_by_gate.any()
    # The platform drives with the command of the tick before.
    assert trail.vx[1:].tolist() == trail.command_vx[:-1].tolist()
    assert np.isnan(trail.cross_track[0]) and np.nanmax(np.abs(trail.cross_track)) < 1e-9


def test_the_metrics_agree_with_the_summary_of_the_run(toy: Episode) -> None:
    found, summary = measure(toy.trail), toy.summary()
    assert found["path_length"] == summary["path_length_m"]
    assert found["spl"] == pytest.approx(summary["spl"])
    assert found["time"] == summary["sim_time_s"]
    assert found["cross_track_max"] == summary["cross_track_max_m"]
    assert found["success"] == 1.0 and found["collisions"] == summary["collisions"] == 0


def test_truth_decides_whether_a_robot_that_reports_success_has_arrived(tmp_path: Path) -> None:
    """A robot that is 1 m to the left of its estimated place arrives 1 m beside its goal."""
    episode = run_episode(toy_config(tmp_path), discovery=discovery())
    moved = [(t, x, y + 1.0, *rest) for t, x, y, *rest in episode.recorder.truth]
    episode.recorder.truth[:] = moved
    trail, summary = episode.trail, episode.summary()
    assert episode.result.outcome == "succeeded" and trail.outcome == "false_success"
    assert "from the goal by ground truth" in trail.reason and not trail.succeeded
    found = measure(trail)
    assert (found["success"], found["false_success"], summary["truly_reached"]) == (0.0, 1.0, False)
    assert summary["outcome"] == "succeeded" and summary["goal_error_m"] == pytest.approx(
        math.hypot(1.0, 0.2), abs=0.03
    )
    assert found["pose_error_max"] == pytest.approx(1.0) and summary["pose_error_m"]["rms"] == pytest.approx(1.0)


def test_a_run_ends_when_the_robot_stands_and_its_time_when_it_came_within_the_tolerance(toy: Episode) -> None:
    trail, summary = toy.trail, toy.summary()
    away = np.hypot(trail.x - 3.0, trail.y)
    first = float(trail.time[np.argmax(away <= 0.2)])
    assert trail.arrived == first == measure(trail)["time"] == summary["sim_time_s"]
    braking = trail.command_vx[trail.time >= first - 1e-9]
    assert np.diff(braking).min() >= -0.05 - 1e-9 and braking[-1] == trail.vx[-1] == 0.0  # 1 m/s² · 0.05 s
    assert trail.duration > first + 0.3


@pytest.mark.parametrize(("wanted_deg", "tolerance_deg", "outcome"), [
    (4.9, 5.0, "succeeded"), (9.9, 5.0, "succeeded"), (10.1, 5.0, "false_success"), (-27.0, 5.0, "false_success"),
    (24.9, 20.0, "succeeded"), (25.1, 20.0, "false_success"), (1.9, 1.0, "succeeded"), (2.1, 1.0, "false_success"),
])  # fmt: skip
def test_truth_looks_at_the_heading_asked_for(
    tmp_path: Path, wanted_deg: float, tolerance_deg: float, outcome: str
) -> None:
    """The robot believes that it has turned; its true heading is 0. The allowance is 5°, or a smaller tolerance."""
    episode = run_episode(
        toy_config(tmp_path, f"navigation.heading_tolerance_deg={tolerance_deg}"), discovery=discovery()
    )
    (number,) = episode.recorder.goals
    wanted = math.radians(wanted_deg)
    episode.recorder.goals[number] = replace(episode.recorder.goals[number], heading=wanted)
    trail, found = episode.trail, measure(episode.trail)
    assert trail.outcome == outcome
    assert found["heading_error"] == episode.summary()["heading_error_rad"] == pytest.approx(abs(wanted))
    assert (found["false_success"], episode.summary()["truly_reached"]) == (outcome != "succeeded", trail.succeeded)


@pytest.mark.parametrize(("tolerance", "distance", "outcome"), [
    (0.2, 0.299, "succeeded"), (0.2, 0.301, "false_success"),
    (0.01, 0.019, "succeeded"), (0.01, 0.021, "false_success"),
])  # fmt: skip
def test_the_allowance_of_truth_is_0_1_m_but_no_more_than_the_tolerance(
    tolerance: float, distance: float, outcome: str
) -> None:
    result = GoalResult(1, "succeeded", "", Point2D(0.0, 0.0))
    assert _truly(result, distance, None, tolerance, 0.1)[0] == outcome


def test_with_via_points_plan_and_shortest_way_are_of_all_legs(tmp_path: Path) -> None:
    """From the origin to 1.5 m, then to 3 m ahead: two plans; the last 0.2 m are tolerance."""
    episode = run_episode(toy_config(tmp_path, "navigation.via=[{ x = 1.5, y = 0.0 }]"), discovery=discovery())
    summary, plans = episode.summary(), episode.recorder.plans
    assert summary["outcome"] == "succeeded" and len(plans) == 2
    # The second leg begins where the robot came within the tolerance of the first.
    assert plans[0].length == pytest.approx(1.5) and plans[1].length > 1.5
    assert summary["plan_length_m"] == plans[0].length + plans[1].length
    assert (summary["optimal_length_m"], summary["optimal_to_tolerance_m"]) == pytest.approx((3.0, 2.8))


def test_a_way_beside_the_straight_one_is_through_its_via_point(tmp_path: Path) -> None:
    system = assemble(toy_config(tmp_path, "navigation.via=[{ x = 0.0, y = 4.0 }]"), discovery())
    assert ways_of(system).to_goal == pytest.approx(4.0 + 5.0)


def test_no_robot_that_arrives_drives_less_than_the_shortest_way_to_the_tolerance(toy: Episode) -> None:
    summary = toy.summary()
    assert summary["optimal_to_tolerance_m"] <= summary["path_length_m"] < summary["optimal_length_m"]
    to_goal = toy.trail.path_length_to_goal  # without the way on which it brakes
    assert summary["optimal_to_tolerance_m"] <= to_goal < summary["path_length_m"]
    assert summary["spl"] == pytest.approx(summary["optimal_to_tolerance_m"] / to_goal)


def test_the_reference_length_is_the_world_s_for_the_world_s_own_task(toy: Episode) -> None:
    system = toy.system
    assert system.goal is not None
    own = World("own", start=Place(0.0, 0.0), goal=Place(3.0, 0.0), goal_tolerance=0.5, reference_length=4.5)
    assert ways_of(replace(system, world=own)) == WayLengths(pytest.approx(3.0), pytest.approx(2.8), 4.5)
    nearby = replace(own, start=Place(-0.25, 0.0))
    assert ways_of(replace(system, world=nearby)).reference == 4.5
    other = replace(own, goal=Place(9.0, 0.0))
    assert ways_of(replace(system, world=other)).reference == pytest.approx(3.0)


def test_a_stop_by_the_gate_counts_from_the_tick_in_which_it_acts(tmp_path: Path) -> None:
    events = '[[event]]\nat = 2.0\ndo = "stop"\n[[event]]\nat = 5.0\ndo = "resume"\n'
    trail = run_episode(toy_config(tmp_path, more=events), discovery=discovery()).trail
    stopped = trail.time[trail.stopped_by_gate]
    assert stopped[0] == pytest.approx(2.4) and stopped[-1] == pytest.approx(4.95)  # 0.4 m/s by 1 m/s²
    assert trail.gate_stops == 1 and trail.outcome == "succeeded"
    assert not trail.command_vx[trail.stopped_by_gate].any()
    assert measure(trail)["stopped_time"] == pytest.approx(3.0, abs=0.3)


def test_the_shortest_way_is_computed_once_for_each_world(toy: Episode, monkeypatch: pytest.MonkeyPatch) -> None:
    from navloom_optimal import shortest_path

    calls: list[object] = []
    original = shortest_path.optimal_path
    monkeypatch.setattr(shortest_path, "optimal_path", lambda *given: calls.append(given) or original(*given))
    world = World("new", (Box("box", (1.0, 2.0), (-1.0, 1.0)),))
    toy_system, monkeypatched = toy.system, monkeypatch
    monkeypatched.setattr(toy_system, "world", world)
    first, second = ways_of(toy_system), ways_of(toy_system)
    assert first == second and first.to_goal is not None and first.to_goal > 3.0 and len(calls) == 1
    monkeypatched.setattr(toy_system, "world", None)
    assert ways_of(toy_system) == WayLengths() and len(calls) == 1


def said(stamp: float, message: Message) -> tuple[Message, Envelope]:
    return message, Envelope("lab/r1/x/main/y", 1, round(stamp / 0.05), round(stamp * 1e9), 0, 0)


def truth(x: float, clearance: float, touching: bool = False) -> Truth:
    return Truth(Pose2D(x, 0.0, 0.0), Twist2D(0.1, 0.0, 0.2), clearance, "box" if touching else "", touching)


def fed(toy: Episode, world: World | None, messages: Sequence[tuple[Message, Envelope]]) -> Episode:
    """An episode of the toys' robot with a recorder that received these messages."""
    recorder = Recorder()
    for message, at in messages:
        recorder.on_message("role", "main", True, "port", message, at)
    log = replace(toy.log, results=[GoalResult(1, "collision", "bump", Point2D(0.0, 0.0))], control_ns=[])
    return Episode(replace(toy.system, world=world, goal=None), log, recorder)


def test_messages_are_matched_by_their_stamps(toy: Episode) -> None:
    def reference(e: float) -> Reference:
        pose, way = Pose2D(0.0, 0.0, 0.0), np.zeros((1, 2))
        return Reference(1, 0.0, 1.0, pose, 0.4, 0.0, e, Point2D(1.0, 0.0), way, 0.4)

    idle = GateStatus("none", "", True, False, StopReason("no_trajectory"), ())
    held = GateStatus("none", "", True, True, StopReason("operator"), ())
    trail = fed(
            toy,
            None,
            [
                said(0.0, truth(0.0, 1.0)), said(0.0, idle),
                said(0.05, truth(0.1, 1.0)), said(0.05, Command(Twist2D(0.3, 0.0, -0.1))), said(0.05, reference(0.7)),
                said(0.10, truth(0.2, 1.0)), said(0.10, HandOver(True, 0.5)), said(0.10, held),
                said(0.15, truth(0.3, 1.0)), said(0.15, HandOver(False, 9.0)), said(0.15, reference(0.9)),
            ],
    ).trail  # fmt: skip
    assert trail.cross_track.tolist() == pytest.approx([math.nan, 0.7, math.nan, 0.9], nan_ok=True)
    assert trail.command_vx.tolist() == [0.0, 0.3, 0.3, 0.3] and trail.command_wz.tolist() == [0.0, -0.1, -0.1, -0.1]
    assert trail.engaged.tolist() == [False, False, True, False]
    assert trail.stopped_by_gate.tolist() == [False, False, True, True]
    assert trail.wz.tolist() == [0.2] * 4 and trail.goal_distance is None and trail.optimal is None
    assert trail.tick_ns.tolist() == toy.log.tick_ns


def test_a_clearance_in_contact_is_minus_the_depth(toy: Episode) -> None:
    world = World("one", (Box("box", (1.0, 2.0), (-1.0, 1.0)),))
    messages = [
        said(0.0, truth(0.4, 0.2)),
        said(0.05, truth(0.6, 0.0, True)),
        said(0.10, truth(0.65, 0.0, True)),
        said(0.15, truth(0.55, 0.05)),
    ]
    trail = fed(toy, world, messages).trail
    assert trail.clearance.tolist() == pytest.approx([0.2, 0.0, -0.05, 0.05])
    assert trail.touches == 1


def test_a_run_without_truth_has_no_ticks_but_its_counts(toy: Episode) -> None:
    trail = fed(toy, None, []).trail
    assert trail.time.size == 0 and trail.outcome == "collision"
    found = measure(trail)
    assert found["success"] == 0.0 and found["path_length"] is None and found["collisions"] == 1.0


def test_a_recorder_keeps_the_streams_that_a_metric_reads_as_they_are() -> None:
    stream = ("gate", "selection")
    recorder, message = Recorder(reads=frozenset({stream})), Selection(1, 0, ("avoider main",))
    assert recorder.wants is not None and stream in recorder.wants
    for port, active, stamp_ns in (("selection", True, 1_500_000_000), ("selection", False, 2 * 10**9)):
        recorder.on_message("gate", "main", active, port, message, Envelope("lab/r1/gate/main/y", 1, 0, stamp_ns, 0, 0))
    assert recorder.streams == {stream: [(1.5, message)]}

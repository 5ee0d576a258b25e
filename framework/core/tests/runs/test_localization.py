"""Metrics of localizers: estimates beside true poses, with numbers to check by hand."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from navloom.runs.episode import run_episode
from navloom.runs.episode_trail import Trail, lost_trail
from navloom.runs.localization import Localization, beside_truth, corrections
from navloom.runs.metrics import measure
from toys import discovery, toy_config

LOST = {"period": 1.0, "limit": 120.0, "max_linear": 0.5, "max_deceleration": 1.0, "reaction": 0.1}


def drive(seconds: int = 10, **changes: Any) -> Localization:
    """A drive along x at 1 m/s in ticks of 1 s, known exactly and tracked."""
    time = np.arange(seconds + 1.0)
    true = np.column_stack([time, 0.0 * time, 0.0 * time])
    sure, spread = time >= 0.0, np.tile([0.01, 0.0, 0.04, 0.01], (len(time), 1))
    arrays = {
        "time": time, "truth": true, "estimate": true.copy(), "covariance": spread,
        "is_tracking": sure, "is_moving": sure, "correction": np.append(np.nan, 0.0 * time[1:]),
    }  # fmt: skip
    return Localization(**{**arrays, **changes})


def off(seconds: int = 10, x: Any = 0.0, y: Any = 0.0, turn: Any = 0.0) -> np.ndarray:
    """Estimates that are off by this in each tick."""
    time = np.arange(seconds + 1.0)
    return np.column_stack([time + x, 0.0 * time + y, 0.0 * time + turn])


def trail(known: Localization, **changes: Any) -> Trail:
    """Its trail, as far as these metrics read it."""
    x = known.truth[:, 0]
    same = dict.fromkeys(("y", "heading", "wz", "cross_track", "command_vx", "command_wz"), 0.0 * x)
    never = x < -1.0
    given = {
        "time": known.time, "x": x, "vx": 0.0 * x + 1.0, "clearance": 0.0 * x + 1.0, **same, "engaged": never,
        "stopped_by_gate": never, "outcome": "succeeded", "reason": "", "touches": 0, "recoveries": 0, "gate_stops": 0,
        "optimal": 9.0, "goal_distance": 0.1, "tick_ns": np.full(x.size, 1000), "localization": known, **LOST,
    }  # fmt: skip
    return Trail(**{**given, **changes})


def test_errors_are_those_of_the_ticks_that_track() -> None:
    """0.3 m and 0.1 rad off in five ticks that track; a kilometre off in the six that do not."""
    time = np.arange(11.0)
    known = drive(estimate=off(y=np.where(time < 5, 0.3, 1000.0), turn=0.1), is_tracking=time < 5)
    found = measure(trail(known))
    assert [found[f"pose_error_{name}"] for name in ("rms", "median", "max")] == pytest.approx([0.3] * 3)
    assert [found[f"pose_heading_{name}"] for name in ("rms", "median", "max")] == pytest.approx([0.1] * 3)
    assert found["not_tracking_time"] == 5.0


def test_a_heading_is_off_the_short_way_round() -> None:
    true, said = drive().truth.copy(), drive().truth.copy()
    true[:, 2], said[:, 2] = math.pi - 0.05, -math.pi + 0.05
    assert drive(truth=true, estimate=said).turn_error == pytest.approx(0.1)


def test_a_robot_is_found_where_true_tracking_begins_to_last() -> None:
    """In ticks of 0.5 s it tracks truly at 1 s for a moment, falsely until 2.5 s, and truly from 3 s on, at 6 m."""
    tick = np.arange(11.0)
    known = drive(time=0.5 * tick, estimate=off(y=np.where((tick == 2) | (tick >= 6), 0.2, 0.9)))
    found = measure(trail(known))
    assert (found["found_time"], found["found_distance"]) == (3.0, 6.0)


def test_a_robot_that_is_never_found_counts_with_the_time_that_it_had_and_the_whole_way() -> None:
    found = measure(trail(drive(estimate=off(y=0.21))))
    assert (found["found_time"], found["found_distance"]) == (120.0, 10.0)


@pytest.mark.parametrize(("ticks", "seconds"), [(1, 0.0), (2, 2.0), (3, 3.0)])
def test_tracking_is_false_if_it_lasts_longer_than_a_second(ticks: int, seconds: float) -> None:
    time = np.arange(11.0)
    known = drive(estimate=off(turn=np.where((time >= 4) & (time < 4 + ticks), math.radians(16.0), 0.0)))
    found = measure(trail(known))
    assert (found["false_tracking"], found["false_tracking_time"]) == (float(seconds > 0.0), seconds)


def test_half_a_metre_off_and_15_degrees_are_not_false() -> None:
    assert drive(estimate=off(x=0.5, turn=math.radians(15.0))).false_tracking == 0.0


def test_a_jump_is_a_correction_between_two_ticks_that_track_while_the_robot_moves() -> None:
    time = np.arange(11.0)
    correction = np.full(11, 0.01)
    correction[[3, 5, 8]] = (0.5, 0.7, 0.04)  # at 3 s it tracks again, at 5 s the robot stands
    found = measure(trail(drive(correction=correction, is_tracking=time != 2, is_moving=time != 5)))
    assert (found["jump_max"], found["jumps"]) == (0.04, 1.0)


def test_corrections_are_what_odometry_does_not_explain() -> None:
    """Odometry drives 1 m along its own y axis, the estimate 1.1 m along the map's x axis."""
    estimate = np.array([[5.0, 5.0, 0.0], [6.1, 5.0, 0.0]])
    odometry = np.array([[0.0, 0.0, math.pi / 2], [0.0, 1.0, math.pi / 2]])
    first, second = corrections(estimate, odometry)
    assert math.isnan(first) and second == pytest.approx(0.1)


def test_three_sigma_hold_along_the_main_axes_of_the_covariance() -> None:
    """0.1 m along the diagonal and 0.01 m across it: 0.29 m along is within, and 0.04 m across is not."""
    spread = np.tile([0.00505, 0.00495, 0.00505, 0.01], (11, 1))
    root = math.sqrt(0.5)
    assert drive(covariance=spread, estimate=off(x=0.29 * root, y=0.29 * root)).is_within.all()
    assert not drive(covariance=spread, estimate=off(x=0.04 * root, y=-0.04 * root)).is_within.any()
    assert not drive(covariance=spread, estimate=off(turn=0.31)).is_within.any()
    assert drive(covariance=spread).sigma == pytest.approx(0.1)


def test_sigmas_are_medians_of_what_tracks() -> None:
    found = measure(trail(drive()))
    assert [found[name] for name in ("sigma_median", "heading_sigma_median")] == pytest.approx([0.2, 0.1])
    assert found["within_3_sigma"] == 1.0


def test_estimates_count_where_the_truth_has_their_stamp() -> None:
    truth = np.array([[0.0, 1.0, 0.0, 0.0, 0.5, 1.0], [0.1, 1.1, 0.0, 0.0, 0.0, 1.0]])
    said = np.array([[0.05, 9.0, 9.0, 0.0, 1, 1, 0, 1, 1], [0.1, 1.4, 0.0, 0.0, 0, 1, 0, 1, 1]])
    known = beside_truth(truth, np.zeros(2), said, np.empty((0, 4)))
    assert known.time.tolist() == [0.1] and known.error == pytest.approx(0.3)
    assert (known.is_tracking.tolist(), known.is_moving.tolist()) == ([False], [False])


def test_without_truth_nothing_is_given() -> None:
    found = measure(lost_trail("succeeded", "by its own word", **LOST))
    names = ("pose_error_median", "pose_heading_rms", "found_time", "false_tracking", "jump_max", "within_3_sigma")
    assert [found[name] for name in names] == [None] * len(names)
    assert beside_truth(np.empty((0, 6)), np.empty(0), np.zeros((3, 9)), np.empty((0, 4))).time.size == 0


def test_a_run_is_measured_from_what_it_records(tmp_path: Path) -> None:
    found = measure(run_episode(toy_config(tmp_path), discovery=discovery()).trail)
    assert (found["found_time"], found["not_tracking_time"], found["false_tracking"]) == (0.0, 0.0, 0.0)
    assert found["jump_max"] == pytest.approx(0.0, abs=1e-9)

"""Metrics on trails whose numbers are known in closed form, and on the same trail at other periods."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from navloom import Trail
from navloom.runs.localization import Localization
from navloom.runs.metric_functions import DEAD_BAND, JERK_WINDOW, STILL_SPEED
from navloom.runs.metrics import measure
from navloom.runs.people_metrics import PEOPLE_METRICS
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Law = Callable[[Floats], Floats]
FINE = 0.001


def nothing(time: Floats) -> Floats:
    return 0.0 * time


def far(time: Floats) -> Floats:
    return 0.0 * time + 5.0


def trail(
    duration: float,
    v: Law,
    w: Law = nothing,
    clearance: Law = far,
    cross: Law = nothing,
    period: float = 0.05,
    **more: Any,
) -> Trail:
    """The trail of a unicycle at a speed and a turn rate over time, moved in steps of 1 ms, sampled at a period."""
    time = FINE * np.arange(round(duration / FINE) + 1)
    middle = time[:-1] + 0.5 * FINE
    heading = np.concatenate([[0.0], np.cumsum(w(middle) * FINE)])
    along = v(middle) * FINE
    between = 0.5 * (heading[:-1] + heading[1:])
    x = np.concatenate([[0.0], np.cumsum(along * np.cos(between))])
    y = np.concatenate([[0.0], np.cumsum(along * np.sin(between))])
    pick = slice(None, None, round(period / FINE))
    at = time[pick]
    arrays: dict[str, Any] = {
        "time": at, "x": x[pick], "y": y[pick], "heading": np.remainder(heading[pick] + math.pi, math.tau) - math.pi,
        "vx": v(at), "wz": w(at), "clearance": clearance(at), "cross_track": cross(at), "command_vx": v(at),
        "command_wz": w(at), "engaged": at >= 0.75 * duration, "stopped_by_gate": at < 0.0,
        "tick_ns": np.full(at.size, 1000),
    }  # fmt: skip
    true = np.column_stack([arrays["x"], arrays["y"], arrays["heading"]])
    beside = true + np.column_stack([0.0 * at, 0.1 * np.nan_to_num(cross(at)), 0.0 * at])
    arrays["localization"] = Localization(
        at, true, beside, np.tile([1.0, 0.0, 1.0, 1.0], (at.size, 1)), at >= 0.0, at >= 0.0, 0.0 * at
    )
    scalars: dict[str, Any] = {
        "outcome": "succeeded", "reason": "", "touches": 0, "recoveries": 0, "gate_stops": 0, "period": period,
        "optimal": 1.0, "goal_distance": 0.1, "limit": 100.0, "max_linear": 0.5, "max_deceleration": 1.0,
        "reaction": 0.1, "heading_error": 0.05,
    }  # fmt: skip
    return Trail(**{**arrays, **scalars, **more})


def constant(value: float) -> Law:
    return lambda time: 0.0 * time + value


def test_times_scores_and_spl_end_where_the_goal_was_reached_and_the_track_where_the_robot_stands() -> None:
    """20 s at 0.5 m/s, reached after 18 s: 9 m of 10 m; the clock of BARN runs from 0.1 m, after 0.2 s."""
    found = measure(trail(20.0, constant(0.5), optimal=7.2, arrived=18.0))
    assert (found["time"], found["path_length"]) == (18.0, pytest.approx(10.0))
    assert found["spl"] == pytest.approx(7.2 / 9.0)
    assert found["barn_2_8"] == pytest.approx(3.6 / 17.8)


def test_the_heading_error_is_that_of_the_trail() -> None:
    assert measure(trail(1.0, constant(0.5)))["heading_error"] == 0.05
    assert measure(trail(1.0, constant(0.5), heading_error=None))["heading_error"] is None


def test_line() -> None:
    found = measure(trail(20.0, constant(0.5), optimal=9.5))
    assert found["path_length"] == pytest.approx(10.0)
    assert found["spl"] == pytest.approx(0.95)
    assert found["time"] == 20.0
    assert found["turning"] == found["jerk"] == found["steering_flips"] == found["stopped_time"] == 0.0
    assert found["clearance_min"] == found["clearance_p5"] == 5.0
    assert found["avoider_share"] == pytest.approx(0.25, abs=0.003)


def test_circle() -> None:
    v, w = 0.4, math.tau / 12.0
    found = measure(trail(12.0, constant(v), constant(w)))
    assert found["path_length"] == pytest.approx(math.tau * v / w, rel=1e-4)
    assert found["turning"] == pytest.approx(w / v, rel=1e-4)
    assert found["steering_flips"] == 0.0
    # |a| of a mean over T is v w sinc(w T / 2), and a turns with w; the last window begins T before the end.
    half = 0.5 * w * JERK_WINDOW
    smoothed = v * w**2 * math.sin(half) / half
    assert found["jerk"] == pytest.approx(smoothed * (math.tau / w - JERK_WINDOW), rel=5e-3)
    assert found["jerk"] == pytest.approx(v * w**2 * math.tau / w, rel=0.05)


def test_figure_eight() -> None:
    v, w, lap = 0.4, math.tau / 12.0, 12.0
    found = measure(trail(2.0 * lap, constant(v), lambda time: np.where(time < lap, w, -w)))
    length = 2.0 * math.tau * v / w
    assert found["path_length"] == pytest.approx(length, rel=1e-4)
    assert found["turning"] == pytest.approx(w / v, rel=1e-4)
    assert found["steering_flips"] == pytest.approx(1.0 / length, rel=1e-4)
    # Both circles, less one window each; between them the acceleration changes from v w on one side to the other.
    half = 0.5 * w * JERK_WINDOW
    smoothed = (v * w**2 * 2.0 * (lap - JERK_WINDOW) + 2.0 * v * w) * math.sin(half) / half
    assert found["jerk"] == pytest.approx(smoothed, rel=5e-3)


def stop_and_go(time: Floats) -> Floats:
    """Three times: 1 s stopped, 0.8 s up to 0.4 m/s, 2 s at that speed, 0.8 s down; then 1 s stopped."""
    return np.interp(np.minimum(time, 13.8 - 1e-9) % 4.6, [0.0, 1.0, 1.8, 3.8, 4.6], [0.0, 0.0, 0.4, 0.4, 0.0])


def test_stop_and_go() -> None:
    found = measure(trail(14.8, stop_and_go))
    assert found["path_length"] == pytest.approx(3 * (0.8 * 0.4 + 2.0 * 0.4), rel=1e-4)
    # The acceleration goes 0, 0.5, 0, -0.5, 0 m/s² in each of three cycles.
    assert found["jerk"] == pytest.approx(3 * 4 * 0.5, rel=1e-3)
    assert found["stopped_time"] == pytest.approx(4 * 1.0 + 6 * STILL_SPEED / 0.5, abs=1e-6)
    assert found["turning"] == 0.0


def test_turning_on_the_spot_is_no_standstill_and_has_no_jerk() -> None:
    found = measure(trail(4.0, nothing, constant(0.3)))
    assert found["stopped_time"] == 0.0 and found["jerk"] == 0.0
    assert found["turning"] is None and found["steering_flips"] is None


def test_a_robot_that_drives_sideways_moves() -> None:
    """0.4 m/s to the left for 8 s: it never stands, and at 0.11 m of clearance it cannot stop in time (0.12 m)."""
    ticks = len(trail(8.0, nothing).time)
    found = measure(trail(8.0, nothing, clearance=constant(0.11), vy=np.full(ticks, 0.4)))
    assert found["stopped_time"] == 0.0 and found["danger_share"] == 1.0


def test_danger_is_a_gap_within_the_stopping_distance() -> None:
    # At v the robot needs 0.1 v + v² / 2: at 0.4 m/s that is 0.12 m, which the gap crosses after a quarter.
    found = measure(trail(8.0, constant(0.4), clearance=lambda time: 0.14 - 0.01 * time))
    assert found["danger_share"] == pytest.approx(0.75, abs=1e-9)
    assert measure(trail(8.0, constant(0.4), clearance=constant(0.13)))["danger_share"] == 0.0
    assert measure(trail(8.0, constant(0.4), clearance=constant(math.inf)))["danger_share"] == 0.0
    assert measure(trail(8.0, nothing, clearance=constant(0.0)))["danger_share"] == 1.0


def test_clearance_is_signed_and_its_percentile_is_over_time() -> None:
    found = measure(trail(10.0, constant(0.4), clearance=lambda time: 0.1 * time - 0.02))
    assert found["clearance_min"] == pytest.approx(-0.02)
    assert found["clearance_p5"] == pytest.approx(0.05 - 0.02)


def test_nothing_near_and_nothing_known_are_undefined() -> None:
    for unknown in (math.inf, math.nan):
        found = measure(trail(4.0, constant(0.4), clearance=constant(unknown)))
        assert found["clearance_min"] is None and found["clearance_p5"] is None
    assert measure(trail(4.0, constant(0.4), clearance=constant(math.nan)))["danger_share"] is None
    mostly = measure(trail(4.0, constant(0.4), clearance=lambda time: np.where(time < 0.1, 0.3, np.inf)))
    assert mostly["clearance_min"] == 0.3 and mostly["clearance_p5"] is None


def test_cross_track_of_a_sine() -> None:
    found = measure(trail(8.0, constant(0.4), cross=lambda time: 0.3 * np.sin(math.tau * time / 4.0)))
    assert found["cross_track_rms"] == pytest.approx(0.3 / math.sqrt(2.0), rel=2e-3)
    assert found["cross_track_max"] == pytest.approx(0.3)


def test_cross_track_skips_ticks_without_a_reference() -> None:
    found = measure(trail(8.0, constant(0.4), cross=lambda time: np.where(time < 4.0, np.nan, -0.2)))
    assert found["cross_track_rms"] == pytest.approx(0.2) and found["cross_track_max"] == pytest.approx(0.2)
    none = measure(trail(8.0, constant(0.4), cross=constant(math.nan)))
    assert none["cross_track_rms"] is None and none["cross_track_max"] is None
    once = measure(trail(8.0, constant(0.4), cross=lambda time: np.where(time == 4.0, 0.2, np.nan)))
    assert once["cross_track_rms"] == pytest.approx(0.2)


@pytest.mark.parametrize(("amplitude", "flips"), [(1.01 * DEAD_BAND, 3), (0.99 * DEAD_BAND, 0)], ids=["over", "within"])
def test_steering_within_the_dead_band_does_not_flip(amplitude: float, flips: int) -> None:
    found = measure(trail(20.0, constant(0.5), lambda time: amplitude * np.cos(math.tau * time / 12.0)))
    assert found["steering_flips"] == pytest.approx(flips / 10.0, rel=1e-3)


FASTEST = {"jerk": 0.02, "turning": 0.01, "path_length": 0.01, "cross_track_rms": 0.01, "spl": 0.01, "barn_2_8": 0.01}
"""Relative tolerance of what is resampled from 10 ms to 0.1 s; see docs/metrics.md."""
AT_MOST = {
    "stopped_time": 0.05,
    "clearance_min": 0.01,
    "clearance_p5": 0.01,
    "cross_track_max": 0.01,
    "pose_error_rms": 0.01,
    "pose_error_median": 0.01,
    "pose_error_p95": 0.02,
    "pose_error_max": 0.01,
}
"""The same in the metric's own unit."""


def test_a_change_of_direction_between_two_samples_is_a_standstill() -> None:
    """From 0.1 to -0.1 m/s in 0.1 s: 0.02 s below 0.02 m/s, of which the samples show nothing; and the turn as well."""
    swing = {"period": 0.1, "w": lambda time: 0.1 * np.cos(math.tau * time / 0.2)}
    assert measure(trail(0.1, lambda time: 0.1 - 2.0 * time, **swing))["stopped_time"] == pytest.approx(0.02)
    slow = measure(trail(0.1, lambda time: 0.0 * time + 0.01, **swing))["stopped_time"]
    assert slow == pytest.approx(0.02)
    crossed = trail(0.2, lambda time: 0.1 - 2.0 * np.minimum(time, 0.1), lambda time: 0.1 - time, period=0.1)
    # It stands from 0.04 to 0.06 s, and turns by less than 0.02 rad/s from 0.08 to 0.12 s.
    assert measure(crossed)["stopped_time"] == 0.0


@settings(max_examples=60, deadline=None)
@example(mean=0.1, swing=1.0, slow=0.1944, turn=0.43, pace=0.3841, phase=3.075, gap=0.5, period=0.1)
@example(mean=0.3712, swing=1.0, slow=0.2, turn=0.7789, pace=0.2762, phase=0.02, gap=0.1, period=0.1)
@given(
    mean=st.floats(0.1, 0.4),
    swing=st.floats(0.0, 1.0),
    slow=st.floats(0.03, 0.3),
    turn=st.floats(0.2, 0.8),
    pace=st.floats(0.05, 0.4),
    phase=st.floats(0.0, 6.0),
    gap=st.floats(0.05, 0.5),
    period=st.sampled_from([0.02, 0.05, 0.1]),
)
def test_resampling_changes_no_metric_by_more_than_its_tolerance(
    mean: float, swing: float, slow: float, turn: float, pace: float, phase: float, gap: float, period: float
) -> None:
    def sampled(step: float) -> dict[str, float | None]:
        return measure(
            trail(
                12.0,
                lambda time: mean * (1.0 + swing * np.sin(math.tau * slow * time)),
                lambda time: turn * np.sin(math.tau * pace * time + phase),
                lambda time: gap + 0.2 * np.sin(math.tau * slow * time + phase),
                lambda time: 0.2 * np.sin(math.tau * pace * time),
                step,
                optimal=2.0,
            )
        )

    fine, coarse = sampled(0.01), sampled(period)
    assume(fine["jerk"] is not None and fine["jerk"] > 0.05)
    assert fine.keys() == coarse.keys()
    among_people = {metric.name for metric in PEOPLE_METRICS}  # this robot meets nobody
    for name, value in fine.items():
        if name in among_people:
            assert value is coarse[name] is None
            continue
        assert value is not None and coarse[name] is not None
        if name in FASTEST:
            assert coarse[name] == pytest.approx(value, rel=FASTEST[name]), name
        elif name == "steering_flips":
            count = value * (fine["path_length"] or 0.0)
            assert coarse[name] * (coarse["path_length"] or 0.0) == pytest.approx(count, abs=1e-6)
        elif name == "danger_share":  # once in each swing of the gap it may begin and end between two samples
            assert coarse[name] == pytest.approx(value, abs=(12.0 * slow + 1.0) * period / 12.0)
        elif name == "avoider_share":
            assert coarse[name] == pytest.approx(value, abs=period / 12.0)
        else:
            assert coarse[name] == pytest.approx(value, abs=AT_MOST.get(name, 1e-9)), name

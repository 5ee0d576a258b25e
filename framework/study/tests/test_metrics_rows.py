"""Rows computed by hand, one for each outcome; what counts as a metric; plugins' metrics; wall times."""

from __future__ import annotations

import csv
import itertools
import math
import re
import sys
from dataclasses import replace
from importlib.metadata import EntryPoint
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from navloom.messages import OUTCOMES
from navloom.plugins import Discovery, PluginError, Registry, hookimpl
from navloom.runs.episode_trail import lost_trail
from navloom.runs.fleet_metrics import FLEET_METRICS
from navloom.runs.metrics import all_metrics, headlines, measure, timing
from navloom_study import METRICS, Metric, Trail


def straight(seconds: int, speed: float, **more: Any) -> Trail:
    """A drive along x in ticks of 1 s; limits: 0.5 m/s, 1 m/s² of braking, 0.1 s of reaction, 120 s."""
    time = np.arange(seconds + 1.0)
    flat = np.zeros_like(time)
    never = np.zeros(time.size, dtype=np.bool_)
    given: dict[str, Any] = {
        "time": time, "x": speed * time, "y": flat, "heading": flat, "vx": flat + speed, "wz": flat,
        "clearance": flat + 1.0, "cross_track": flat, "command_vx": flat + speed, "command_wz": flat, "engaged": never,
        "stopped_by_gate": never, "outcome": "succeeded", "reason": "", "touches": 0, "recoveries": 0, "gate_stops": 0,
        "period": 1.0, "optimal": 7.5, "goal_distance": 0.1, "limit": 120.0, "max_linear": 0.5,
        "max_deceleration": 1.0, "reaction": 0.1, "tick_ns": np.full(time.size, 1000),
    }  # fmt: skip
    return Trail(**{**given, **more})


LOST: dict[str, Any] = {"period": 1.0, "limit": 120.0, "max_linear": 0.5, "max_deceleration": 1.0, "reaction": 0.1}

ROWS: dict[str, tuple[Trail, dict[str, float | None]]] = {
    # 40 s at 0.2 m/s: 8 m for 7.5 m. OT = 7.5 m / 2 m/s = 3.75 s, and 39.5 s after the first 0.1 m are more than
    # 8 OT = 30 s. To stop from 0.2 m/s takes 0.02 + 0.02 m. Of 40 s, 10 s are driven 0.3 m to one side.
    "succeeded": (
        straight(40, 0.2, cross_track=np.where(np.arange(41) <= 10, -0.3, np.nan), gate_stops=1, recoveries=2),
        {"success": 1.0, "spl": 7.5 / 8.0, "barn_2_8": 0.125, "barn_4_8": 0.125, "time": 40.0, "path_length": 8.0,
         "goal_distance": 0.1, "clearance_min": 1.0, "clearance_p5": 1.0, "danger_share": 0.0, "cross_track_rms": 0.3,
         "cross_track_max": 0.3, "jerk": 0.0, "turning": 0.0, "steering_flips": 0.0, "stopped_time": 0.0,
         "avoider_share": 0.0, "recoveries": 2.0, "gate_stops": 1.0, "collisions": 0.0},
    ),
    # 5 m in 10 s; 11 gaps 0.5, 0.45, ... 0: the 5th percentile is midway between 0 and 0.05. At 0.5 m/s it takes
    # 0.05 + 0.125 m to stop, which the gap, falling 0.05 m/s, reaches 3.5 s before the end.
    "collision": (
        straight(10, 0.5, clearance=0.5 - 0.05 * np.arange(11), touches=1, gate_stops=1, goal_distance=2.5),
        {"success": 0.0, "spl": 0.0, "barn_2_8": 0.0, "barn_4_8": 0.0, "time": 120.0, "path_length": 5.0,
         "goal_distance": 2.5, "clearance_min": 0.0, "clearance_p5": 0.025, "danger_share": 0.35, "gate_stops": 1.0,
         "collisions": 1.0},
    ),
    # 120 s at 0.05 m/s, the command now left, now right of straight on: 6 m, 120 flips.
    "timeout": (
        straight(120, 0.05, command_wz=np.where(np.arange(121) % 2, 0.2, -0.2), goal_distance=1.5),
        {"success": 0.0, "spl": 0.0, "barn_2_8": 0.0, "time": 120.0, "path_length": 6.0, "steering_flips": 20.0,
         "stopped_time": 0.0},
    ),
    # 15 s at a standstill, after 3 recoveries; the avoider had 4 of 16 ticks.
    "stuck": (
        straight(15, 0.0, recoveries=3, engaged=np.arange(16) < 4, goal_distance=7.5),
        {"success": 0.0, "spl": 0.0, "time": 120.0, "path_length": 0.0, "turning": None, "steering_flips": None,
         "stopped_time": 15.0, "avoider_share": 0.25, "recoveries": 3.0, "jerk": 0.0},
    ),
    # No path, neither for the planner nor for the disc.
    "no_path": (
        straight(1, 0.0, optimal=None, cross_track=np.full(2, np.nan), goal_distance=7.5),
        {"success": 0.0, "spl": None, "barn_2_8": None, "barn_4_8": None, "time": 120.0, "cross_track_rms": None,
         "cross_track_max": None, "stopped_time": 1.0},
    ),
    # Turned about from 0 by 0.1 rad a tick in a drive of 2 m: 1 rad.
    "cancelled": (
        straight(10, 0.2, heading=0.1 * np.arange(11)),
        {"success": 0.0, "spl": 0.0, "time": 120.0, "path_length": 2.0, "turning": 0.5},
    ),
    # Refused before it moved: one tick.
    "rejected": (
        straight(0, 0.0, clearance=np.full(1, np.inf), goal_distance=7.5),
        {"success": 0.0, "spl": 0.0, "time": 120.0, "path_length": 0.0, "clearance_min": None, "clearance_p5": None,
         "danger_share": 0.0, "jerk": None, "stopped_time": 0.0, "avoider_share": 0.0, "goal_distance": 7.5},
    ),
    # Driven for 5 s, then 5 s at a standstill without knowing where.
    "lost": (
        straight(10, 0.0, x=np.minimum(np.arange(11) * 0.4, 2.0), vx=np.where(np.arange(11) <= 5, 0.4, 0.0),
                 goal_distance=5.5),
        {"success": 0.0, "spl": 0.0, "time": 120.0, "path_length": 2.0, "stopped_time": 4.0 + 0.02 / 0.4},
    ),
    # Stopped by the operator after 4 m of 20 s, driven half of the time.
    "stopped": (
        straight(20, 0.0, x=np.minimum(np.arange(21) * 0.4, 4.0), vx=np.where(np.arange(21) <= 10, 0.4, 0.0),
                 gate_stops=1),
        {"success": 0.0, "time": 120.0, "path_length": 4.0, "stopped_time": 9.0 + 0.02 / 0.4, "gate_stops": 1.0},
    ),
    # The worker died: only the outcome is known.
    "error": (
        lost_trail("error", "killed", optimal=7.5, **LOST),
        {"success": 0.0, "spl": 0.0, "barn_2_8": 0.0, "barn_4_8": 0.0, "time": 120.0, "path_length": None,
         "goal_distance": None, "clearance_min": None, "clearance_p5": None, "danger_share": None,
         "cross_track_rms": None, "cross_track_max": None, "jerk": None, "turning": None, "steering_flips": None,
         "stopped_time": None, "avoider_share": None, "recoveries": 0.0, "gate_stops": 0.0, "collisions": 0.0},
    ),
}  # fmt: skip


@pytest.mark.parametrize("outcome", OUTCOMES)
def test_a_row_of_each_outcome_agrees_with_one_computed_by_hand(outcome: str) -> None:
    trail, expected = ROWS[outcome]
    found = measure(replace(trail, outcome=outcome))
    assert list(found) == [metric.name for metric in METRICS]
    for name, value in expected.items():
        assert found[name] == (None if value is None else pytest.approx(value, abs=1e-12)), name


@pytest.mark.parametrize(
    ("seconds", "speed", "both"),
    [(6, 2.0, (0.5, 0.25)), (11, 0.1, (0.375, 0.25)), (21, 0.1, (0.1875, 0.1875)), (200, 0.04, (0.125, 0.125))],
    ids=["fast", "between", "slow", "very_slow"],
)
def test_barn_scores_are_clipped_at_both_ends(seconds: int, speed: float, both: tuple[float, float]) -> None:
    # OT = 7.5 m / 2 m/s = 3.75 s. The clock starts at 0.1 m: of 11 s at 0.1 m/s 10 s count.
    found = measure(straight(seconds, speed))
    assert (found["barn_2_8"], found["barn_4_8"]) == pytest.approx(both)


def test_barn_s_optimal_time_is_of_the_reference_length_at_2_m_a_second_whatever_the_robot_s_limit() -> None:
    # 12 m at 2 m/s are 6 s; 0.5 m/s reach 0.1 m after 0.2 s, and 30.2 - 0.2 s are 5 times as much.
    drive = straight(151, 0.5, time=0.2 * np.arange(152.0), x=0.1 * np.arange(152.0), reference=12.0)
    for limit in (0.5, 2.0):
        found = measure(replace(drive, max_linear=limit))
        assert (found["barn_2_8"], found["barn_4_8"]) == pytest.approx((0.2, 0.2))
    without_way = measure(replace(drive, optimal=None))
    assert without_way["barn_2_8"] == pytest.approx(0.2) and without_way["spl"] is None


def test_the_wait_before_a_drive_costs_time_and_no_score() -> None:
    waited = measure(straight(70, 0.4, x=0.4 * np.maximum(np.arange(71.0) - 50.0, 0.0)))
    found = measure(straight(20, 0.4))
    assert (waited["time"], found["time"]) == (70.0, 20.0)
    # 0.1 m are driven after a quarter of a second: 19.75 s count.
    assert waited["barn_2_8"] == found["barn_2_8"] == pytest.approx(3.75 / 19.75)


def test_a_success_without_truth_has_no_score_and_no_time() -> None:
    found = measure(lost_trail("succeeded", "by its own word", optimal=7.5, **LOST))
    assert found["success"] == 1.0 and found["false_success"] is None
    assert [found[name] for name in ("spl", "barn_2_8", "barn_4_8", "time")] == [None] * 4


def test_a_drive_shorter_than_the_shortest_way_within_the_tolerance_counts_as_the_shortest() -> None:
    assert measure(straight(10, 0.74))["spl"] == 1.0


def test_a_collision_without_truth_is_still_one() -> None:
    assert measure(lost_trail("collision", "bumper", **LOST))["collisions"] == 1.0


def test_a_goal_at_the_start_has_no_score() -> None:
    found = measure(straight(1, 0.0, optimal=0.0))
    assert found["spl"] is None and found["barn_2_8"] is None and found["success"] == 1.0


def test_metrics_have_names_units_and_say_when_they_are_undefined() -> None:
    assert len({metric.name for metric in METRICS}) == len(METRICS) == 55
    nothing = measure(lost_trail("error", "killed", **LOST))
    for metric in METRICS:
        assert metric.unit and metric.about.endswith(".")
        assert ("Undefined" in metric.about) == (nothing[metric.name] is None), metric.name


@pytest.mark.parametrize("value", [float("nan"), float("inf"), "far", [1.0]], ids=["nan", "inf", "text", "list"])
def test_a_value_that_is_no_finite_number_is_refused_by_name(value: Any) -> None:
    odd = Metric("odd", "1", None, lambda trail: value, "Odd.")
    with pytest.raises(ValueError, match=r"metric odd: gave .*, expected a (finite )?number"):
        measure(straight(1, 0.1), (odd,))


def test_wall_times_are_given_in_microseconds_and_a_slow_99th_percentile_is_marked() -> None:
    ticks = np.arange(1, 101) * 1_000_000
    found = timing(straight(1, 0.1, period=0.1, tick_ns=ticks))
    assert found["tick_us_p50"] == pytest.approx(50_500.0) and found["tick_us_p95"] == pytest.approx(95_050.0)
    assert found["tick_us_max"] == 100_000.0 and found["too_slow"] is False
    assert timing(straight(1, 0.1, period=0.09, tick_ns=ticks))["too_slow"] is True
    # Of the wall time, the method computed for half.
    busy = timing(straight(1, 0.1, period=0.09, tick_ns=ticks, tick_cpu_ns=ticks // 2))
    assert busy["tick_us_p99"] == 2.0 * busy["tick_cpu_us_p99"] and busy["too_slow"] is False
    assert timing(lost_trail("error", "killed", **LOST)) == {}


def entry(name: str, given: Any, monkeypatch: pytest.MonkeyPatch) -> EntryPoint:
    """An entry point whose module registers one metric."""
    module = ModuleType(f"fake_metric_{name}")

    @hookimpl
    def navloom_register(registry: Registry) -> None:
        registry.metric(given)

    module.navloom_register = navloom_register  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, module.__name__, module)
    return EntryPoint(f"metric.{name}", module.__name__, "navloom")


def test_a_plugins_metric_comes_after_the_built_in_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    ticks = Metric("ticks", "1", None, lambda trail: trail.time.size, "Ticks.")
    found, wrong = all_metrics(Discovery(found=[entry("ticks", ticks, monkeypatch)]))
    assert found == (*METRICS, ticks) and wrong == ()
    assert measure(straight(9, 0.1), found)["ticks"] == 10.0


class Plain:
    name = "plain"


@pytest.mark.parametrize(
    ("name", "given", "refusal"),
    [
        ("plain", Plain(), r"metric\.plain: registers .*, expected a navloom\.Metric"),
        ("spl", Metric("spl", "1", None, lambda trail: 0.0, "Mine."), r"metric\.spl: a column 'spl' is there already"),
        ("seed", Metric("seed", "1", None, lambda trail: 0.0, "Mine."), r"metric\.seed: a column 'seed' is there"),
        ("a", Metric("b", "1", None, lambda trail: 0.0, "Mine."), r"metric\.a registers metric\.b, expected metric\.a"),
        ("odd", Metric("Odd name", "1", None, lambda trail: 0.0, "Mine."), r"expected a navloom\.Metric with a name"),
        ("none", None, r"None: expected a navloom\.Metric"),
    ],
    ids=["class", "built_in", "column", "other", "name", "none"],
)
def test_an_object_that_is_no_metric_of_its_name_is_left_out_with_the_reason(
    name: str, given: Any, refusal: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    ticks = Metric("ticks", "1", None, lambda trail: trail.time.size, "Ticks.")
    points = [entry(name, given, monkeypatch), entry("ticks", ticks, monkeypatch)]
    found, (wrong,) = all_metrics(Discovery(found=points))
    assert found == (*METRICS, ticks) and re.search(refusal, wrong)


def test_short_tables_show_the_chief_metrics_and_all_of_other_distributions() -> None:
    assert headlines(["time", "jerk", "success", "halves"]) == ["success", "time", "halves"]


def test_a_metric_registered_twice_is_refused() -> None:
    registry, twice = Registry(), Metric("twice", "1", None, lambda trail: 0.0, "Twice.")
    registry.metric(twice)
    with pytest.raises(PluginError, match="metric 'twice' is registered twice"):
        registry.metric(twice)


DOCS = (Path(__file__).resolve().parents[3] / "docs" / "metrics.md").read_text("utf-8")


def test_the_docs_have_every_metric_with_its_unit_and_better_side() -> None:
    listed = re.findall(r"^\| `(\w+)` \| (\S+) \| (\w*) ?\|", DOCS, re.MULTILINE)
    assert listed == [(metric.name, metric.unit, metric.better or "") for metric in (*METRICS, *FLEET_METRICS)]


def test_the_docs_metric_registers_and_measures(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    reading, writing = re.findall(r"^```python\n(.*?)^```", DOCS, re.MULTILINE | re.DOTALL)
    scope: dict[str, Any] = {"__name__": "my_metric"}
    exec(compile(writing, "metrics.md", "exec"), scope)
    registry = Registry()
    scope["navloom_register"](registry)
    (metric,) = registry.metrics.values()
    assert isinstance(metric, Metric) and measure(straight(9, 0.2), (metric,)) == {"mean_speed": pytest.approx(0.2)}
    (tmp_path / "study").mkdir()
    columns = ["method", "world", "seed", "outcome", *(metric.name for metric in METRICS)]
    with (tmp_path / "study" / "episodes.csv").open("w", newline="") as file:
        table = csv.DictWriter(file, columns)
        table.writeheader()
        for method, seed in itertools.product(("improved_vfh", "vff"), range(6)):
            row = measure(straight(9, 0.2, outcome="succeeded" if method == "vff" else "stuck"))
            table.writerow({"method": method, "world": "hall", "seed": seed, "outcome": "", **row})
    monkeypatch.chdir(tmp_path)
    exec(compile(reading, "metrics.md", "exec"), {})
    # 6 of 6 is at least 0.025^(1/6) = 0.541, 0 of 6 at most 0.459: the two deviations of 0.459 add up in squares.
    scope_told, *numbers = capsys.readouterr().out.rsplit(maxsplit=4)
    low = 1.0 - math.sqrt(2.0) * (1.0 - 0.025 ** (1.0 / 6.0))
    assert scope_told == "for these worlds only"
    assert list(map(float, numbers)) == pytest.approx([1.0, low, 1.0, 2 / 2**6])

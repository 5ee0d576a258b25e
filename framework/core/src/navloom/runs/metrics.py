"""Metrics of episodes: numbers from a trail, each defined for failed episodes too. See docs/metrics.md."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from navloom.runs import localization_metrics, metric_functions
from navloom.runs.episode_trail import Trail
from navloom.runs.metric import NOT_NEGATIVE, SHARE, Metric
from navloom.runs.people_metrics import PEOPLE_METRICS

if TYPE_CHECKING:
    from navloom.plugins import Discovery

__all__ = ["METRICS", "Metric", "all_metrics", "headlines", "measure", "timing"]


def measure(trail: Trail, metrics: Iterable[Metric] | None = None) -> dict[str, float | None]:
    """Every metric of one episode by name, default the built-in ones; None if it is not defined.

    Raises:
        ValueError: A metric returned neither a finite number nor None.
    """
    found: dict[str, float | None] = {}
    for metric in METRICS if metrics is None else metrics:
        value = metric.compute(trail)
        if value is not None:
            try:
                value = float(value)
            except (TypeError, ValueError):
                raise ValueError(f"metric {metric.name}: gave {value!r}, expected a number or None") from None
            if not np.isfinite(value):
                raise ValueError(
                    f"metric {metric.name}: gave {value}, expected a finite number, or None where undefined"
                )
            if metric.is_share and value not in (0.0, 1.0):
                raise ValueError(f"metric {metric.name}: gave {value}, expected 1 or 0: it is declared as a share")
        found[metric.name] = value
    return found


def timing(trail: Trail) -> dict[str, float | bool]:
    """Wall time of the control steps: median, 95th and 99th percentile and maximum, µs, and whether they are too slow.

    `too_slow` is true if at least one step in a hundred computes for longer than the control period: by the thread's
    CPU time where it was measured, since on a busy machine wall time is not the method's. Empty without ticks.
    The values are not reproducible: they go to timing.json, never to the table.
    """
    if not trail.tick_ns.size:
        return {}
    p50, p95, p99, top = (float(np.percentile(trail.tick_ns, share)) * 1e-3 for share in (50, 95, 99, 100))
    told = {"tick_us_p50": p50, "tick_us_p95": p95, "tick_us_p99": p99, "tick_us_max": top}
    if trail.tick_cpu_ns.size:
        told["tick_cpu_us_p99"] = float(np.percentile(trail.tick_cpu_ns, 99)) * 1e-3
    return {**told, "too_slow": told.get("tick_cpu_us_p99", p99) > trail.period * 1e6}


def all_metrics(discovery: Discovery) -> tuple[tuple[Metric, ...], tuple[str, ...]]:
    """The built-in metrics, then those of plugins in order of name; and why others cannot be used, a message each."""
    from navloom.plugins import PluginError

    taken = {metric.name for metric in METRICS} | _COLUMNS
    found: list[Metric] = list(METRICS)
    wrong: list[str] = []
    for name in discovery.names("metric"):
        try:
            metric = discovery.metric(name)
        except PluginError as error:
            wrong.append(str(error))
            continue
        if not isinstance(metric, Metric):
            wrong.append(f"metric.{name}: registers {metric!r}, expected a navloom.Metric")
        elif name in taken:
            wrong.append(f"metric.{name}: a column {name!r} is there already: rename the metric")
        else:
            found.append(metric)
    return tuple(found), tuple(wrong)


def headlines(names: Sequence[str]) -> list[str]:
    """Which metrics of a study its short tables show: the chief built-in ones, and all that other distributions add."""
    built_in = {metric.name for metric in METRICS}
    return [name for name in _HEADLINES if name in names] + [name for name in names if name not in built_in]


_HEADLINES = ("success", "false_success", "spl", "time", "clearance_min", "collisions")
_COLUMNS = {"method", "world", "seed", "outcome", "reason", "trace_sha256"}

METRICS: tuple[Metric, ...] = (
    Metric(
        "success", "1", "higher", metric_functions.success,
        "1 if the goal was reached, according to the ground truth if there is one, else 0.",
        SHARE, is_share=True,
    ),
    Metric(
        "spl", "1", "higher", metric_functions.spl,
        "Success weighted by path length: shortest / max(driven, shortest), 0 for a failure, both up to the goal's "
        "tolerance. Undefined if no shortest path is known.",
        SHARE,
    ),
    Metric(
        "barn_2_8", "1", "higher", metric_functions.barn_2_8,
        "BARN score: success times OT / clip(AT, 2 OT, 8 OT), OT = the world's reference length, or else the shortest "
        "path, at 2 m/s, AT from the first 0.1 m; at best 0.5. Undefined if neither length is known.",
        (0.0, 0.5),
    ),
    Metric(
        "barn_4_8", "1", "higher", metric_functions.barn_4_8,
        "BARN score with the clip of 2022, 4 OT to 8 OT; at best 0.25. Undefined if neither length is known.",
        (0.0, 0.25),
    ),
    Metric(
        "time", "s", "lower", metric_functions.time_to_goal,
        "Time from the start of the run until the robot last came within the goal's tolerances; a failed episode "
        "counts with the longest time it was allowed.",
        NOT_NEGATIVE,
    ),
    Metric(
        "path_length", "m", None, metric_functions.path_length,
        "Distance driven, failed or not. Undefined without ground truth.",
        NOT_NEGATIVE,
    ),
    Metric(
        "goal_distance", "m", "lower", metric_functions.goal_distance,
        "Distance to the goal at the end of the episode. Undefined without a goal, or if a run left no data.",
        NOT_NEGATIVE,
    ),
    Metric(
        "clearance_min", "m", "higher", metric_functions.clearance_min,
        "Least gap between footprint and obstacles; 0 in contact, negative by the depth of an overlap. "
        "Undefined if nothing is near or without ground truth.",
    ),
    Metric(
        "clearance_p5", "m", "higher", metric_functions.clearance_p5,
        "5th percentile of the gap over time. Undefined if nothing is near or without ground truth.",
    ),
    Metric(
        "danger_share", "1", "lower", metric_functions.danger_share,
        "Share of the time in which the gap is at most the robot's stopping distance. "
        "Undefined without ground truth.",
        SHARE,
    ),
    Metric(
        "cross_track_rms", "m", "lower", metric_functions.cross_track_rms,
        "Root mean square over time of the distance from the trajectory. Undefined if none was driven.",
        NOT_NEGATIVE,
    ),
    Metric(
        "cross_track_max", "m", "lower", metric_functions.cross_track_max,
        "Largest distance from the trajectory. Undefined if none was driven.",
        NOT_NEGATIVE,
    ),
    Metric(
        "jerk", "m/s²", "lower", metric_functions.integrated_jerk,
        "Integral of the magnitude of jerk, of the acceleration in the plane averaged over 0.4 s. "
        "Undefined for less than 0.8 s of ground truth.",
        NOT_NEGATIVE,
    ),
    Metric(
        "turning", "rad/m", "lower", metric_functions.turning_per_metre,
        "Angle turned, either way, per metre driven. Undefined below 0.1 m.",
        NOT_NEGATIVE,
    ),
    Metric(
        "steering_flips", "1/m", "lower", metric_functions.steering_flips_per_metre,
        "How often the commanded turn rate changed sign by more than 0.05 rad/s either way, per metre driven. "
        "Undefined below 0.1 m.",
        NOT_NEGATIVE,
    ),
    Metric(
        "stopped_time", "s", "lower", metric_functions.stopped_time,
        "Time the robot neither drove 0.02 m/s nor turned 0.02 rad/s. Undefined without ground truth.",
        NOT_NEGATIVE,
    ),
    Metric(
        "avoider_share", "1", None, metric_functions.avoider_share,
        "Share of the time the avoider drove instead of the controller. Undefined without ground truth.",
        SHARE,
    ),
    Metric("recoveries", "1", "lower", metric_functions.recoveries, "Attempts of the recovery.", NOT_NEGATIVE),
    Metric(
        "gate_stops",
        "1",
        "lower",
        metric_functions.gate_stops,
        "How often the gate stopped a driving robot.",
        NOT_NEGATIVE,
    ),
    Metric(
        "collisions", "1", "lower", metric_functions.collisions,
        "Number of contacts; at least 1 if the outcome is collision.",
        NOT_NEGATIVE,
    ),
    Metric(
        "own_contacts", "1", "lower", metric_functions.own_contacts,
        "Contacts in which the robot's point moved faster than 0.05 m/s along the normal, or that would not have "
        "happened had the robot stood for the last second. Undefined without ground truth.",
        NOT_NEGATIVE,
    ),
    Metric(
        "others_contacts", "1", "lower", metric_functions.others_contacts,
        "All other contacts: what moves drove into the robot. Undefined without ground truth.",
        NOT_NEGATIVE,
    ),
    Metric(
        "false_success", "1", "lower", metric_functions.false_success,
        "1 if the robot reported that it had arrived, and was further from the goal or from the heading asked for than "
        "the tolerance plus 0.1 m or 5°, or than twice a smaller tolerance. Undefined without ground truth.",
        SHARE, is_share=True,
    ),
    Metric(
        "pose_error_rms", "m", "lower", localization_metrics.pose_error_rms,
        "Root mean square of the distance between estimated and true position, while the localizer tracks. Undefined "
        "if it never does, or without ground truth.",
        NOT_NEGATIVE,
    ),
    Metric(
        "pose_error_p95", "m", "lower", localization_metrics.pose_error_p95,
        "95th percentile of that distance. Undefined as `pose_error_rms`.",
        NOT_NEGATIVE, is_detail=True,
    ),
    Metric(
        "pose_error_max", "m", "lower", localization_metrics.pose_error_max,
        "Largest such distance. Undefined as `pose_error_rms`.",
        NOT_NEGATIVE, is_detail=True, role="localizer",
    ),
    Metric(
        "gate_limits", "1", "lower", metric_functions.gate_limits,
        "Number of times the gate's monitor began to slow or stop the robot because of what the sensors saw ahead.",
        NOT_NEGATIVE,
    ),
    Metric(
        "heading_error", "rad", "lower", metric_functions.heading_error,
        "Difference between the final heading and the one asked for. Undefined if none was, or without ground truth.",
        NOT_NEGATIVE,
    ),
    Metric(
        "pose_error_median", "m", "lower", localization_metrics.pose_error_median,
        "Median of the distance of `pose_error_rms`. Undefined as `pose_error_rms`.",
        NOT_NEGATIVE, is_detail=True, role="localizer",
    ),
    Metric(
        "pose_heading_rms", "rad", "lower", localization_metrics.pose_heading_rms,
        "Root mean square of the difference between estimated and true heading, while the localizer tracks. Undefined "
        "as `pose_error_rms`.",
        NOT_NEGATIVE, is_detail=True, role="localizer",
    ),
    Metric(
        "pose_heading_median", "rad", "lower", localization_metrics.pose_heading_median,
        "Median of that difference. Undefined as `pose_error_rms`.",
        NOT_NEGATIVE, is_detail=True, role="localizer",
    ),
    Metric(
        "pose_heading_max", "rad", "lower", localization_metrics.pose_heading_max,
        "Largest such difference. Undefined as `pose_error_rms`.",
        NOT_NEGATIVE, is_detail=True, role="localizer",
    ),
    Metric(
        "found_time", "s", "lower", localization_metrics.found_time,
        "Time until the localizer tracks within 0.2 m and 5° of the truth for 1 s; the longest time allowed if it "
        "never does. Undefined without ground truth.",
        NOT_NEGATIVE, is_detail=True, role="localizer",
    ),
    Metric(
        "found_distance", "m", "lower", localization_metrics.found_distance,
        "Distance driven until then, or in the whole episode. Undefined without ground truth.",
        NOT_NEGATIVE, is_detail=True, role="localizer",
    ),
    Metric(
        "not_tracking_time", "s", "lower", localization_metrics.not_tracking_time,
        "Time in which the localizer searched or was lost. Undefined without ground truth.",
        NOT_NEGATIVE, is_detail=True, role="localizer",
    ),
    Metric(
        "false_tracking", "1", "lower", localization_metrics.false_tracking,
        "1 if the localizer tracked more than 0.5 m or 15° off for more than 1 s, else 0. Undefined without ground "
        "truth.",
        SHARE, is_share=True, is_detail=True, role="localizer",
    ),
    Metric(
        "false_tracking_time", "s", "lower", localization_metrics.false_tracking_time,
        "Time in which it did so. Undefined without ground truth.",
        NOT_NEGATIVE, is_detail=True, role="localizer",
    ),
    Metric(
        "jump_max", "m", "lower", localization_metrics.jump_max,
        "Largest change of the estimated position from one tick to the next that odometry does not explain, while the "
        "robot moves and the localizer tracks. Undefined if there is no such tick, or without ground truth.",
        NOT_NEGATIVE, is_detail=True, role="localizer",
    ),
    Metric(
        "jumps", "1", "lower", localization_metrics.jumps,
        "Number of such changes of more than 2 cm. Undefined as `jump_max`.",
        NOT_NEGATIVE, is_detail=True, role="localizer",
    ),
    Metric(
        "within_3_sigma", "1", "higher", localization_metrics.within_3_sigma,
        "Share of the tracked ticks in which the true pose is within three standard deviations, along both main axes "
        "of the position's covariance and in heading. Undefined as `pose_error_rms`.",
        SHARE, is_detail=True, role="localizer",
    ),
    Metric(
        "sigma_median", "m", None, localization_metrics.sigma_median,
        "Median of the position's standard deviation along its longest axis, while the localizer tracks. Undefined as "
        "`pose_error_rms`.",
        NOT_NEGATIVE, is_detail=True, role="localizer",
    ),
    Metric(
        "heading_sigma_median", "rad", None, localization_metrics.heading_sigma_median,
        "Median of the heading's standard deviation, while the localizer tracks. Undefined as `pose_error_rms`.",
        NOT_NEGATIVE, is_detail=True, role="localizer",
    ),
    *PEOPLE_METRICS,
)  # fmt: skip

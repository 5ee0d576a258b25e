"""Runs one closed-loop episode from a config, and summarises it."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, field
from functools import cached_property
from typing import IO, Any, Literal

import numpy as np

from navloom.config import Loaded
from navloom.engine import run_warnings
from navloom.engine.build import assemble
from navloom.engine.lockstep import Lockstep, Observer, RunLog
from navloom.engine.lockstep_builder import lockstep_of
from navloom.engine.nondeterminism import StepInspector, some_ticks
from navloom.engine.plugin_factory import make_plugins
from navloom.engine.run_warnings import RunWarning, RunWarnings
from navloom.engine.system import System
from navloom.engine.task_checks import check_task
from navloom.engine.trace import TraceWriter
from navloom.messages import GoalResult, Point2D
from navloom.plugins import Discovery, RunInfo
from navloom.plugins.code_owners import Owned, Owners
from navloom.plugins.output_limit import LARGEST_OUTPUT, bounded_output
from navloom.plugins.run_observers import Onlookers
from navloom.plugins.thread_owners import keeping_alive, started_by, watched_threads
from navloom.runs import localization_metrics, metric_functions
from navloom.runs.episode_recorder import Recorder, streams_of
from navloom.runs.episode_trail import Trail, trail_of, ways_of
from navloom.runs.shadow_comparison import Disagreement, ShadowWatch

__all__ = ["Drive", "Episode", "run_episode", "run_info"]

POSE_ERRORS = {
    "rms": localization_metrics.pose_error_rms,
    "p95": localization_metrics.pose_error_p95,
    "max": localization_metrics.pose_error_max,
}


@dataclass(eq=False)
class Episode:
    """A finished run with its system, log and collected data.

    Attributes:
        system, log, recorder: See their classes.
        shadows: Comparisons of the shadows.
        warnings: Problems of plugins that did not fail.
    """

    system: System
    log: RunLog
    recorder: Recorder
    shadows: list[Disagreement] = field(default_factory=list)
    warnings: list[RunWarning] = field(default_factory=list)

    @property
    def result(self) -> GoalResult:
        """Result of the last goal."""
        if self.log.results:
            return self.log.results[-1]
        return GoalResult(0, "timeout", "no goal was given before the run ended", Point2D(0.0, 0.0))

    def summary(self) -> dict[str, Any]:
        """The object that `run --json` prints. SI units, or ms and µs if the name says so."""
        log, recorder, result, trail = self.log, self.recorder, self.result, self.trail
        last = (log.ticks - 1) * self.system.config.run.period
        errors = {name: measure(trail) for name, measure in POSE_ERRORS.items()}
        tick_us = np.array(log.tick_ns) * 1e-3
        cross = np.abs(np.array(recorder.cross_tracks))
        return {
            "outcome": result.outcome,
            "reason": result.reason,
            "code": result.code,
            "config_sha256": self.system.loaded.sha256(),
            "trace_sha256": log.trace_sha256 or None,
            "seed": self.system.config.run.seed,
            "sim_time_s": round(last if trail.arrived is None else trail.arrived, 9),
            "wall_s": log.wall_ns * 1e-9,
            "ticks": log.ticks,
            "tick_us": {"p50": float(np.percentile(tick_us, 50)), "p99": float(np.percentile(tick_us, 99))},
            "plan_length_m": recorder.plan_length,
            "path_length_m": trail.path_length,
            "optimal_length_m": ways_of(self.system).to_goal,
            "optimal_to_tolerance_m": trail.optimal,
            "truly_reached": trail.succeeded if trail.has_truth and trail.goal_distance is not None else None,
            "goal_error_m": trail.goal_distance if trail.has_truth else None,
            "heading_error_rad": trail.heading_error,
            "pose_error_m": None if errors["rms"] is None else errors,
            "spl": metric_functions.spl(trail),
            "min_clearance_m": recorder.min_clearance,
            "cross_track_rms_m": math.sqrt(float((cross**2).mean())) if cross.size else None,
            "cross_track_max_m": float(cross.max()) if cross.size else None,
            "collisions": recorder.touches,
            "own_contacts": sum(one.is_own for one in trail.contacts) if trail.has_truth else None,
            "others_contacts": sum(not one.is_own for one in trail.contacts) if trail.has_truth else None,
            "recoveries": recorder.recoveries,
            "gate_stops": log.gate_stops,
            "gate_limits": log.gate_limits,
            "planner_ms": _median_ms(log.step_ns["planner"]),
            "mapper_ms": _median_ms(log.step_ns["mapper"]),
            "swaps": log.swaps,
            "warnings": [warning.to_json() for warning in self.warnings],
            "shadows": [shadow.summary().to_json() for shadow in self.shadows],
        }

    @cached_property
    def trail(self) -> Trail:
        """The trail of the episode, which the metrics are computed from."""
        return trail_of(self.system, self.recorder, self.log, self.result)


def run_episode(
    loaded: Loaded,
    *,
    discovery: Discovery | None = None,
    observers: Sequence[Observer] = (),
    onlookers: Onlookers | None = None,
    trace: IO[bytes] | None = None,
    say: Callable[[str], None] = lambda text: None,
    progress: Callable[[float, float], None] | None = None,
    looks_at: Callable[[int], bool] = some_ticks,
    reads: Iterable[tuple[str, str]] = (),
) -> Episode:
    """Run a config in lockstep until its last goal has ended.

    Args:
        loaded: The config.
        discovery: Plugins; default the installed ones.
        observers: Further observers.
        onlookers: Observers of plugins. They are notified of the start here; the caller notifies them of the end.
        trace: File for the trace.
        say: Receives progress of the preparation.
        progress: Called with the run time so far and the longest possible one, s.
        reads: Streams that metrics need, `(role or node, port)`.
        looks_at: Selects the ticks whose steps are inspected for causes of unrepeatable runs.

    Raises:
        ConfigError, PluginError: The request was wrong; nothing ran.
    """
    drive = Drive(loaded, discovery)
    system = drive.system
    with drive:
        make_plugins(system, say)
        begun = [] if onlookers is None else onlookers.begin(run_info(loaded, "lockstep"))
        executor = drive.connect([*observers, *begun], trace, looks_at, reads)
        period = loaded.config.run.period
        executor.run(
            system.longest_run,
            None if progress is None else (lambda tick: progress(tick * period, system.time_limit)),
        )
    return drive.episode()


class Drive(AbstractContextManager["Drive"]):
    """One robot that is driven in lockstep; within a `with` statement, what its plugins print and start is watched.

    Args:
        loaded: Its config.
        discovery: Plugins; default the installed ones.

    Raises:
        ConfigError, PluginError: The config does not fit.

    Attributes:
        system: Its system.
        executor: Its executor, once it is connected.
    """

    executor: Lockstep

    def __init__(self, loaded: Loaded, discovery: Discovery | None = None) -> None:
        self.system = assemble(loaded, discovery)
        check_task(self.system)
        self._found = RunWarnings.of(self.system)
        self._within, self._started = ExitStack(), list[threading.Thread]()

    def __enter__(self) -> Drive:
        owners = Owners({source: part.cls for source, part in self.system.parts.items()})
        self._within.enter_context(bounded_output(owners, self._flooded))
        self._started = self._within.enter_context(watched_threads(owners))
        return self

    def __exit__(self, *error: Any) -> None:
        self._within.close()

    def _flooded(self, owned: Owned) -> None:
        limit = LARGEST_OUTPUT // 1024
        self._found.add("output", owned.source, f"printed more than {limit} kB: the rest is left out ({owned.place})")

    def connect(
        self,
        observers: Sequence[Observer],
        trace: IO[bytes] | None = None,
        looks_at: Callable[[int], bool] = some_ticks,
        reads: Iterable[tuple[str, str]] = (),
    ) -> Lockstep:
        """Make the executor, once the plugins are made. For the arguments see `run_episode`."""
        system = self.system
        self._recorder, self._watch = Recorder(reads=streams_of(reads, system.config)), ShadowWatch.of(system)
        shadows: list[Observer] = [] if self._watch is None else [self._watch]
        self.executor = lockstep_of(system, [self._recorder, *shadows, *observers], TraceWriter(trace))
        self.executor.inspector = StepInspector(self._found, looks_at)
        return self.executor

    def episode(self) -> Episode:
        """The finished run."""
        _warn(self._found, self.system, self.executor)
        for thread in keeping_alive(self._started):
            owned = started_by(thread)
            if owned is not None:
                run_warnings.staying_thread(self._found, owned, thread.name)
        shadows = [] if self._watch is None else self._watch.finish()
        return Episode(self.system, self.executor.log, self._recorder, shadows, self._found.listed())


def _warn(found: RunWarnings, system: System, executor: Lockstep) -> None:
    """Add warnings about plugins after a run has ended."""
    log, steppers, period = executor.log, executor.steppers, system.config.run.period
    run_warnings.slow_steps(found, system, log.spent_ns, log.computed_ns)
    run_warnings.far_commands(found, steppers)
    run_warnings.large_messages(found, run_warnings.volumes_of(executor.trace, steppers), log.ticks * period)
    slots = executor.active("platform").slots
    scans = {sensor.name: (slots[sensor.name].sequence, slots[sensor.name].tick) for sensor in system.sensors}
    heard = run_warnings.Heard(0, log.ticks, scans, executor.active("goal").slots["sweep"].tick)
    run_warnings.silent_sensors(found, system, heard)
    run_warnings.waiting_nodes(found, steppers)


def _median_ms(steps: Sequence[int]) -> float | None:
    return float(np.median(steps)) * 1e-6 if steps else None


def run_info(loaded: Loaded, kind: Literal["lockstep", "barrier", "live"]) -> RunInfo:
    """Description of a run of this config, for observers."""
    config = loaded.config
    return RunInfo(
        kind, loaded.name, config.model_dump(mode="json"), loaded.sha256(), config.robot.realm, config.robot.name,
        config.run.seed,
    )  # fmt: skip

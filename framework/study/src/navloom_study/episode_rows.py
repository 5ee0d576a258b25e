"""One episode of a study: the task for a worker, and the row that it returns even if the episode fails."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import perf_counter
from typing import Any

from navloom.config import Loaded
from navloom.engine.run_warnings import RunWarning
from navloom.inputs.typed_json import from_builtins
from navloom.plugins import Discovery, PluginError
from navloom.plugins.registry import nearest
from navloom.runs.episode import Episode, run_episode
from navloom.runs.episode_trail import Trail, WayLengths, lost_trail, ways_of
from navloom.runs.fleet import run_fleet
from navloom.runs.fleet_metrics import FLEET_METRICS, fleet_trail
from navloom.runs.metrics import Metric, all_metrics, timing
from navloom.runs.shadow_comparison import ShadowSummary

from navloom_study.episode_key import EpisodeKey
from navloom_study.fleet_episodes import MemberRow
from navloom_study.repeat_check import run_twice
from navloom_study.study_worlds import CachedDiscovery, placed
from navloom_study.tracks import encoded, encoded_together

__all__ = ["EpisodeTask", "Row", "episode_row", "lost_row", "read_by_metrics", "row_of"]

ADDRESS = re.compile(r"0x[0-9a-fA-F]{6,}")
Progress = Callable[[], None]


@dataclass(frozen=True)
class EpisodeTask:
    """Everything that a worker on any machine needs for one episode.

    Attributes:
        study: Hash of the study's request; caches are not shared between studies.
        key: Key of the episode.
        config: The method's config, from `Loaded.to_json`.
        values: Changes of the world, from `WorldCase`.
        here: Base folder of references that are not from a file.
        metrics: Names, in the order of the table.
        is_open_loop: The config's alternatives run in shadow; only their answers count, not the drive.
        is_twice: The episode runs twice, and the row contains a warning if the second run differs.
        members: Of a fleet, the config of each member; `config` is the first one's.
        member_metrics: Names of the metrics of each member; `metrics` are those of the fleet.
    """

    study: str
    key: EpisodeKey
    config: dict[str, Any]
    values: dict[str, Any]
    here: str
    metrics: tuple[str, ...]
    is_open_loop: bool = False
    is_twice: bool = False
    members: tuple[dict[str, Any], ...] = ()
    member_metrics: tuple[str, ...] = ()


@dataclass(frozen=True)
class Row:
    """One line of the table.

    Attributes:
        key: Key of the episode.
        outcome, reason: Its outcome; `error` with the cause if it did not run to its end.
        metrics: Values by name; None if a metric is not defined for it.
        trace_sha256: Hash of the trace, empty if there is none.
        timing: Wall times, µs and s: not reproducible, and not in the table.
        notes: Failed metrics.
        warnings: Warnings of the run; those about timing are not reproducible.
        shadows: Summary of each shadow of an open-loop episode.
        track: File of the driven track, for `trails/`; not in the journal.
        members: Of a fleet, its members.
    """

    key: EpisodeKey
    outcome: str
    reason: str
    metrics: dict[str, float | None]
    trace_sha256: str
    timing: dict[str, float | bool] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    shadows: tuple[ShadowSummary, ...] = ()
    track: bytes = field(default=b"", compare=False, repr=False)
    warnings: tuple[RunWarning, ...] = field(default=(), compare=False, repr=False)
    members: tuple[MemberRow, ...] = ()

    def __post_init__(self) -> None:
        # All rows have the same names, so thousands of rows share one copy of each.
        for place in ("metrics", "timing"):
            named = {sys.intern(name): value for name, value in getattr(self, place).items()}
            object.__setattr__(self, place, named)

    def to_json(self) -> dict[str, Any]:
        """The row as a line of the journal."""
        told = {name: value for name, value in vars(self).items() if name not in ("key", "track")}
        for name in ("shadows", "warnings"):
            if told[name]:
                told[name] = [one.to_json() for one in told[name]]
            else:
                del told[name]
        if told.pop("members"):
            told["members"] = [vars(one) for one in self.members]
        return {**vars(self.key), **told}

    @classmethod
    def from_json(cls, given: Any) -> Row:
        """Read a row from the journal. Raises ValueError for anything else."""
        line = from_builtins(_Line, given)
        return cls(
            EpisodeKey(line.method, line.world, line.seed),
            line.outcome,
            line.reason,
            line.metrics,
            line.trace_sha256,
            line.timing,
            line.notes,
            line.shadows,
            warnings=tuple(RunWarning.from_json(vars(warning)) for warning in line.warnings),
            members=line.members,
        )


@dataclass(frozen=True)
class _Warning:
    """A warning in a line of the journal, see `RunWarning.to_json`."""

    kind: str
    role: str
    instance: str
    text: str
    plugin: str | None = None
    about: str | None = None
    figures: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class _Line:
    """A line of the journal."""

    method: str
    world: str
    seed: int
    outcome: str
    reason: str
    metrics: dict[str, float | None]
    trace_sha256: str
    timing: dict[str, bool | float]
    notes: tuple[str, ...]
    shadows: tuple[ShadowSummary, ...] = ()
    warnings: tuple[_Warning, ...] = ()
    members: tuple[MemberRow, ...] = ()


def episode_row(task: EpisodeTask, progress: Progress = lambda: None) -> Row:
    """Run one episode. A plugin that fails anywhere loses only this episode.

    Args:
        task: The episode.
        progress: Called at intervals while the episode makes progress.
    """
    started = perf_counter()
    discovery = _shared(task).discovery
    try:
        reads = read_by_metrics(task)
        if task.members:
            return _fleet_row(task, discovery, progress, reads, started)
        loaded = placed(task.config, task.values, task.key.seed, Path(task.here))
        if task.is_twice:
            episode = _repeated(loaded, discovery, progress, reads)
        else:
            episode = run_episode(
                loaded, discovery=discovery, say=lambda text: progress(), progress=lambda done, total: progress(),
                reads=reads,
            )  # fmt: skip
        progress()
        return row_of(task, episode, perf_counter() - started)
    except (Exception, SystemExit) as error:
        return lost_row(task, f"{type(error).__name__}: {error}", perf_counter() - started)


def read_by_metrics(task: EpisodeTask) -> frozenset[tuple[str, str]]:
    """Streams whose messages the metrics of an episode need, `(role or node, port)`."""
    metrics = _member_metrics(task) if task.members else _metrics(task)
    return frozenset(stream for metric in metrics for stream in metric.reads)


def _fleet_row(
    task: EpisodeTask, discovery: Discovery, progress: Progress, reads: frozenset[tuple[str, str]], started: float
) -> Row:
    """Run the members of a fleet. The row is the fleet's, with a part for each member."""
    fleet = run_fleet(
        [placed(given, task.values, task.key.seed, Path(task.here)) for given in task.members],
        discovery=discovery, say=lambda text: progress(), progress=lambda done, total: progress(), reads=reads,
    )  # fmt: skip
    progress()
    row = _row(task, fleet_trail({name: one.trail for name, one in fleet.episodes.items()}), fleet.trace_sha256,
               perf_counter() - started)  # fmt: skip
    notes, members = list(row.notes), []
    for name, one in fleet.episodes.items():
        found = {metric.name: _measured(metric, one.trail, notes) for metric in _member_metrics(task)}
        members.append(MemberRow(name, one.trail.outcome, _one_line(one.trail.reason), found, one.log.trace_sha256))
    warnings = [warning for one in fleet.episodes.values() for warning in one.warnings]
    track = encoded_together([(one.trail, *_goal(one)) for one in fleet.episodes.values()])
    return replace(row, notes=tuple(notes), members=tuple(members), warnings=tuple(warnings), track=track)


def _goal(episode: Episode) -> tuple[tuple[float, float] | None, float]:
    """Place, m, and tolerance, m, of an episode's goal."""
    goal = episode.system.goal
    return None if goal is None else (goal.x, goal.y), episode.system.goal_tolerance


def _repeated(loaded: Loaded, discovery: Discovery, progress: Progress, reads: frozenset[tuple[str, str]]) -> Episode:
    """The first of two runs, with a warning if the second differs, and one for each plugin that may be the cause."""
    episode, divergence, seen = run_twice(loaded, discovery, progress, reads)
    found = [*episode.warnings, *(one for one in seen if one not in episode.warnings)]
    if divergence is not None:
        source = (divergence.role, divergence.instance, divergence.plugin)
        found.append(RunWarning("repeat", *source, divergence.text, {"tick": divergence.tick}))
    return replace(episode, warnings=found)


def row_of(task: EpisodeTask, episode: Episode, spent: float) -> Row:
    """The row of an ended episode, with its track, shadows and warnings; `spent` is its wall time, s."""
    trail = episode.trail
    row = _row(task, trail, episode.log.trace_sha256, spent)
    shadows = episode.shadows
    track = encoded(trail, *_goal(episode), shadows)
    summaries = tuple(shadow.summary() for shadow in shadows)
    return replace(row, shadows=summaries, track=track, warnings=tuple(episode.warnings))


def lost_row(task: EpisodeTask, reason: str, spent: float = 0.0) -> Row:
    """The row of an episode that did not end: a plugin could not be created, or a worker was killed.

    Args:
        task: The episode.
        reason: The cause.
        spent: Wall time, s.
    """
    discovery = _shared(task).discovery
    loaded = placed(task.config, task.values, task.key.seed, Path(task.here))
    config = loaded.config
    ways = _ways(loaded, discovery)
    trail = lost_trail(
        "error",
        _one_line(reason),
        period=config.run.period,
        limit=config.run.stop_after,
        max_linear=config.robot.max_linear,
        max_deceleration=config.robot.max_deceleration,
        reaction=config.gate.stop_deadline,
        optimal=ways.within_tolerance,
        reference=ways.reference,
    )
    return _row(task, trail, "", spent)


def _ways(loaded: Any, discovery: CachedDiscovery) -> WayLengths:
    """Reference lengths of the episode; empty if the config cannot be assembled."""
    from navloom.engine.build import assemble

    try:
        return ways_of(assemble(loaded, discovery))
    except (Exception, SystemExit):
        return WayLengths()


def _row(task: EpisodeTask, trail: Trail, trace: str, spent: float) -> Row:
    found: dict[str, float | None] = {}
    notes: list[str] = []
    for metric in () if task.is_open_loop else _metrics(task):
        found[metric.name] = _measured(metric, trail, notes)
    return Row(
        task.key,
        trail.outcome,
        _one_line(trail.reason),
        found,
        trace,
        # The load explains a wall time: it is of the machine, not of the method.
        {**timing(trail), "wall_s": spent, "load": os.getloadavg()[0]},
        tuple(notes),
    )


def _measured(metric: Metric, trail: Trail, notes: list[str]) -> float | None:
    """A metric's value; None with a note if the metric fails."""
    from navloom.runs.metrics import measure

    try:
        return measure(trail, (metric,))[metric.name]
    except Exception as error:
        broken = f"metric {metric.name} failed: {type(error).__name__}: {error}"
        notes.append(_one_line(str(error) if isinstance(error, ValueError) else broken))
        return None


def _one_line(text: str) -> str:
    """A reason on one line without object addresses, so that it is equal in every process."""
    return ADDRESS.sub("0x…", " ".join(text.split()))


@dataclass(frozen=True, eq=False)
class Shared:
    """Objects that the episodes of one study share in a process: a worker runs many and imports plugins once."""

    discovery: CachedDiscovery
    metrics: dict[str, Metric]


_SHARED: dict[str, Shared] = {}
"""Shared objects of the newest study only: world files and plugins may have changed since an older one."""


def _metrics(task: EpisodeTask) -> list[Metric]:
    """Metrics of the table, in its order. Raises PluginError for one that is not installed here."""
    return _named(task.metrics, {one.name: one for one in FLEET_METRICS} if task.members else _shared(task).metrics)


def _member_metrics(task: EpisodeTask) -> list[Metric]:
    return _named(task.member_metrics, _shared(task).metrics)


def _named(names: Sequence[str], known: Mapping[str, Metric]) -> list[Metric]:
    for name in names:
        if name not in known:
            raise PluginError(f"metric {name!r} of the study is not installed on this worker{nearest(name, [*known])}")
    return [known[name] for name in names]


def _shared(task: EpisodeTask) -> Shared:
    shared = _SHARED.get(task.study)
    if shared is None:
        discovery = CachedDiscovery(task.config["config"].get("plugins", {}).get("blocked", ()))
        shared = Shared(discovery, {metric.name: metric for metric in all_metrics(discovery)[0]})
        _SHARED.clear()
        _SHARED[task.study] = shared
    return shared

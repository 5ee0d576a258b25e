"""A closed-loop study: methods × worlds × seeds, with equal conditions for every method, one row an episode."""

from __future__ import annotations

import hashlib
import json
import platform
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from navloom.config import ConfigError, Loaded, load_config
from navloom.config.tables import ROLE_TABLES
from navloom.engine.build import assemble
from navloom.engine.checks import check_task
from navloom.engine.system import System
from navloom.plugins import PluginError
from navloom.plugins.one_file import files_in_use
from navloom.plugins.registry import NODE, nearest
from navloom.study.episode_key import EpisodeKey
from navloom.study.journal import StudyFolder
from navloom.study.methods import Method, compared, methods_of, toml_value
from navloom.study.metrics import METRICS, all_metrics
from navloom.study.openloop import METHOD, OpenLoop, open_loop_of
from navloom.study.pool import HANG_AFTER, cores, run_on_executor, run_on_processes
from navloom.study.rows import EpisodeTask, Row
from navloom.study.worldset import CachedDiscovery, WorldCase, placed, worlds_of

__all__ = ["Study", "StudyResult", "plan_study", "run_study"]

Progress = Callable[[int, int, float | None], None]
"""Called with the number of ended episodes, the total, and the remaining time, s, or None if it is not known yet."""


@dataclass(frozen=True, eq=False)
class Study:
    """A checked request for a study.

    Attributes:
        config: Path or shipped name of the config.
        methods, worlds, seeds: Every combination is one episode.
        metrics: Names, in the order of the table.
        held_equal: By place in the config, the values that are equal for every method.
        differs: By place, the value of each method that has one.
        dropped: By method, the parameters that were dropped together with the replaced plugin.
        versions: Versions that an episode depends on.
        here: Base folder of references that are not from a file.
        baseline: Name of the method that the others are compared with.
        open_loop: Additional drives, one for each world and seed, for their shadows; None for none.
    """

    config: str
    methods: tuple[Method, ...]
    worlds: tuple[WorldCase, ...]
    seeds: tuple[int, ...]
    metrics: tuple[str, ...]
    held_equal: dict[str, Any]
    differs: dict[str, dict[str, Any]]
    dropped: dict[str, tuple[str, ...]]
    versions: dict[str, str]
    here: Path
    baseline: str = ""
    open_loop: OpenLoop | None = None
    unusable: tuple[str, ...] = ()

    @property
    def keys(self) -> list[EpisodeKey]:
        """Every episode in the order of the table: by method, world and seed, each in the order of the request."""
        return [
            EpisodeKey(m.name, w.ref, seed) for m in self.methods for w in self.worlds for seed in self.seeds
        ]  # fmt: skip

    @property
    def open_loop_keys(self) -> list[EpisodeKey]:
        """Every episode that is driven only for its shadows."""
        if self.open_loop is None:
            return []
        return [EpisodeKey(METHOD, w.ref, seed) for w in self.worlds for seed in self.seeds]

    def twice(self) -> list[EpisodeTask]:
        """Tasks that run the first episode of each method twice."""
        world, seed = self.worlds[0].ref, self.seeds[0]
        return [
            replace(task, is_twice=True)
            for task in self.tasks()
            if (task.key.world, task.key.seed) == (world, seed) and not task.is_open_loop
        ]

    def tasks(self) -> list[EpisodeTask]:
        """A task for every episode, grouped by world."""
        given = {method.name: method.loaded.to_json() for method in self.methods}
        token = hashlib.sha256(json.dumps(self.request(), sort_keys=True).encode()).hexdigest()
        drives = [(method.name, given[method.name], False) for method in self.methods]
        if self.open_loop is not None:
            drives.append((METHOD, self.open_loop.loaded.to_json(), True))
        return [
            EpisodeTask(token, EpisodeKey(name, w.ref, seed), config, w.values, str(self.here), self.metrics, is_open)
            for w in self.worlds
            for seed in self.seeds
            for name, config, is_open in drives
        ]

    def request(self) -> dict[str, Any]:
        """The request as `study.json` stores it: equal requests give equal rows.

        To drive one episode again, pass the `changes` of its method and world to `navloom run` as `--set`, its seed as
        `--seed` and the `plugin_files` as `--plugin`.
        """
        return {
            "config": self.config,
            "methods": {
                m.name: {"config_sha256": m.loaded.sha256(), "changes": list(m.changes)} for m in self.methods
            },
            "worlds": {
                w.ref: {
                    "sha256": w.sha256,
                    "changes": [f"{place}={toml_value(value)}" for place, value in w.values.items()],
                }
                for w in self.worlds
            },
            "seeds": list(self.seeds),
            "metrics": list(self.metrics),
            "held_equal": self.held_equal,
            "differs": self.differs,
            "versions": self.versions,
            **({"plugin_files": files} if (files := files_in_use()) else {}),
            **({} if self.open_loop is None else {"open_loop": self.open_loop.request()}),
        }  # fmt: skip


@dataclass(frozen=True, eq=False)
class StudyResult:
    """A finished study.

    Attributes:
        study: The request.
        rows: One row an episode, in the order of the table.
        before: Number of episodes that had ended in an earlier call.
        lost: Number of workers that died or were killed in this call.
        wall: Wall time of this call, s.
        files: Names of the files in the folder.
        open_loop: Rows of the episodes driven for their shadows.
        missing: Why a file was not written, by name.
        repeated: Rows of the episodes that were run twice.
    """

    study: Study
    rows: tuple[Row, ...]
    before: int
    lost: int
    wall: float
    files: tuple[str, ...] = ()
    open_loop: tuple[Row, ...] = ()
    missing: Mapping[str, str] = field(default_factory=dict)
    repeated: tuple[Row, ...] = ()

    def summary(self) -> dict[str, Any]:
        """By method: number of episodes, outcomes, the mean of each metric over the episodes for which it is defined,
        and the exact 95 % interval of each share, see `compare_methods`."""
        found, intervals = {}, self._shares()
        for method in self.study.methods:
            rows = [row for row in self.rows if row.key.method == method.name]
            means = {}
            for name in self.study.metrics:
                values = [value for row in rows if (value := row.metrics[name]) is not None]
                means[name] = float(np.mean(values)) if values else None
            outcomes = dict(sorted(Counter(row.outcome for row in rows).items()))
            told = {"episodes": len(rows), "outcomes": outcomes, "means": means}
            found[method.name] = {**told, "intervals": intervals[method.name]}
        return found

    def _shares(self) -> dict[str, dict[str, tuple[float, float]]]:
        """By method, the intervals of its shares; an interval is missing if there are too few episodes."""
        from navloom.study.statistics import compare_methods

        shares = [metric for metric in METRICS if metric.is_share and metric.name in self.study.metrics]
        rows = [{**vars(row.key), "outcome": row.outcome, **row.metrics} for row in self.rows]
        # The intervals of shares are exact and need no resamples.
        compared = compare_methods(rows, self.study.methods[0].name, shares, np.random.default_rng(0), resamples=100)
        found: dict[str, dict[str, tuple[float, float]]] = {method.name: {} for method in self.study.methods}
        for one in compared.summaries:
            if one.estimate.low is not None and one.estimate.high is not None:
                found[one.method][one.metric] = (one.estimate.low, one.estimate.high)
        return found

    @property
    def warnings(self) -> list[dict[str, Any]]:
        """Warnings of its runs, each once for a method, with the number of affected episodes and the first of them."""
        found: dict[tuple[str, ...], dict[str, Any]] = {}
        for is_counted, rows in ((True, self.rows), (False, self.repeated)):
            for row in rows:
                for one in row.warnings:
                    key = (row.key.method, one["kind"], one["role"], one["instance"], str(one.get("about", "")))
                    told = found.setdefault(key, {**one, **vars(row.key), "episodes": 1 - is_counted})
                    told["episodes"] += is_counted
        return list(found.values())

    @property
    def is_repeatable(self) -> bool:
        """Whether no episode that was run twice differed."""
        return not any(one["kind"] == "repeat" for row in self.repeated for one in row.warnings)

    @property
    def notes(self) -> list[str]:
        """Failures outside the episodes: broken metrics and failed open-loop runs, each with the number of episodes."""
        counts = Counter(note for row in self.rows for note in row.notes)
        counts.update(f"open loop failed: {row.reason}" for row in self.open_loop if row.outcome == "error")
        return [f"{note} ({count} episodes)" for note, count in sorted(counts.items())]


def plan_study(
    config: str,
    vary: Sequence[str] = (),
    worlds: Sequence[str] = (),
    seeds: Sequence[int] = (),
    changes: Sequence[str] = (),
    say: Callable[[str], None] = lambda text: None,
    baseline: str = "",
    open_loop: bool = False,
) -> Study:
    """Check a request before anything runs.

    Args:
        config: Path of a config, or a shipped name.
        vary: Variations, each `PATH=a,b,c`; the methods are their product.
        worlds: References and ranges of them; default the config's own world.
        seeds: Seeds; default the config's own.
        changes: Changes for all methods, each `PATH=VALUE`.
        say: Receives the progress of the checks.
        baseline: Name of a method; default the first.
        open_loop: Whether to drive the baseline once more for each world and seed, with the other methods in shadow.

    Raises:
        ConfigError, PluginError: Something does not fit; the text names it and the nearest fix.
    """
    base = load_config(config, changes)
    discovery = CachedDiscovery(base.config.plugins.blocked)
    methods = methods_of(config, vary, changes, discovery)
    baseline = _baseline(baseline, methods)
    beside = open_loop_of(methods, baseline) if open_loop else None
    say("reading worlds")
    cases = worlds_of(base, worlds, discovery)
    here, single = Path.cwd(), len(methods) == len(cases) == 1
    say("checking methods")
    systems = {method.name: _checked(method, cases[0], discovery, here, single) for method in methods}
    say("checking worlds")
    for case in cases[1:]:
        _checked(methods[0], case, discovery, here, single)
    if beside is not None:
        _checked(Method(METHOD, (), beside.loaded), cases[0], discovery, here, single)
    equal, different = compared(systems)
    metrics, unusable = all_metrics(discovery)
    return Study(
        config,
        tuple(methods),
        tuple(cases),
        tuple(seeds) or (base.config.run.seed,),
        tuple(metric.name for metric in metrics),
        equal,
        different,
        {method.name: method.loaded.dropped for method in methods},
        _versions(systems, discovery),
        here,
        baseline,
        beside,
        unusable,
    )


def _baseline(name: str, methods: Sequence[Method]) -> str:
    names = [method.name for method in methods]
    if name and name not in names:
        raise ConfigError(f"--baseline {name}: no such method{nearest(name, names)}")
    return name or names[0]


def _checked(method: Method, case: WorldCase, discovery: CachedDiscovery, here: Path, single: bool) -> System:
    """A method's system in a world. Raises ConfigError that names the method and the world that do not fit."""
    loaded: Loaded = placed(method.loaded.to_json(), case.values, method.loaded.config.run.seed, here)
    try:
        system = assemble(loaded, discovery)
        check_task(system)
    except (ConfigError, PluginError) as error:
        where = "" if single else f"method {method.name} in world {case.ref}: "
        raise ConfigError(f"{where}{error}") from None
    return system


def _versions(systems: dict[str, System], discovery: CachedDiscovery) -> dict[str, str]:
    """Versions of Python, the numerical packages, and the distributions whose plugins are active."""
    owners = {(info.role, info.name): info for info in discovery.infos()}
    found = {"python": platform.python_version(), "machine": platform.machine()}
    for name in ("navloom", "numpy", "numba", "scipy"):
        found[name] = version(name)
    used = {
        (role if role in ROLE_TABLES else NODE, system.config.role_table(role).plugin)
        for system in systems.values()
        for role in system.config.roles
    }
    for key in sorted(used):
        if key in owners and owners[key].distribution:
            found[owners[key].distribution] = owners[key].version
    return found


def run_study(
    study: Study,
    out: Path | None = None,
    *,
    jobs: int | None = None,
    executor: Executor | None = None,
    progress: Progress = lambda done, total, left: None,
    hang_after: float = HANG_AFTER,
    twice: bool = False,
) -> StudyResult:
    """Run the episodes that have not ended before.

    Args:
        study: A study from `plan_study`.
        out: Folder that stores the study and from which it continues; without one nothing is written.
        jobs: Number of processes; default one a core.
        executor: Runs the episodes instead of processes of this machine.
        progress: Called with the progress, at least twice a second.
        hang_after: Time without a heartbeat after which a worker is killed, s.
        twice: Run the first episode of each method twice more, and report where the second run differs.

    Raises:
        ConfigError: The folder holds another study, or cannot be used.
        PoolError: Workers cannot run at all, or the cluster went away. Ended episodes are kept, as with Ctrl-C.
        StudyError: The disk is full. Ended episodes are kept.
    """
    started = perf_counter()
    tasks = study.tasks()
    with StudyFolder(out, study.request()) as folder:
        todo = [task for task in tasks if task.key not in folder.rows]
        before = len(tasks) - len(todo)
        clock = _Clock(before, len(tasks), progress)

        def on_row(row: Row) -> None:
            folder.keep(row)
            clock.count()

        def drive(tasks: Sequence[EpisodeTask], on_row: Callable[[Row], None]) -> int:
            if executor is not None:
                run_on_executor(tasks, on_row, executor)
                return 0
            count = min(jobs or cores(), len(tasks))
            return run_on_processes(tasks, on_row, count, idle=clock.tell, hang_after=hang_after) if tasks else 0

        clock.tell()
        lost = drive(todo, on_row)
        repeated: list[Row] = []
        drive(study.twice() if twice else (), repeated.append)
        rows = [folder.rows[key] for key in study.keys]
        beside = [folder.rows[key] for key in study.open_loop_keys]
        timings = _timings(rows, perf_counter() - started, jobs or cores())
        files = folder.finish(rows, study.metrics, timings, beside)
    return StudyResult(
        study, tuple(rows), before, lost, perf_counter() - started, tuple(files), tuple(beside), folder.missing,
        tuple(repeated),
    )  # fmt: skip


class _Clock:
    """Progress of a study, and an estimate of the remaining time."""

    def __init__(self, before: int, total: int, progress: Progress) -> None:
        self.done, self.total, self.progress = before, total, progress
        self._first: tuple[int, float] | None = None

    def count(self) -> None:
        """Count an episode. The first one includes imports and compilation, so its time is not used."""
        self.done += 1
        if self._first is None:
            self._first = (self.done, perf_counter())
        self.tell()

    def tell(self) -> None:
        """Report the progress."""
        left = None
        if self._first is not None and self.done > self._first[0]:
            each = (perf_counter() - self._first[1]) / (self.done - self._first[0])
            left = each * (self.total - self.done)
        self.progress(self.done, self.total, left)


def _timings(rows: Sequence[Row], wall: float, jobs: int) -> dict[str, Any]:
    """Timings, which differ from run to run."""
    spent = sum(float(row.timing.get("wall_s", 0.0)) for row in rows)
    return {
        "wall_s": wall,
        "episodes_wall_s": spent,
        "jobs": jobs,
        "machine": {"cores": cores(), "processor": platform.processor() or platform.machine()},
        "episodes": [{**vars(row.key), **row.timing} for row in rows],
    }

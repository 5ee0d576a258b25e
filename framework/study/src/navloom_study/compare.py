"""A closed-loop study: methods × worlds × seeds, with equal conditions for every method, one row an episode."""

from __future__ import annotations

import platform
import threading
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from importlib.metadata import version
from itertools import chain
from pathlib import Path
from time import perf_counter
from typing import Any

from navloom.config import ConfigError, Loaded, load_config
from navloom.config.loader import members_of
from navloom.config.tables import ROLE_TABLES
from navloom.engine.build import assemble
from navloom.engine.system import System
from navloom.engine.task_checks import check_live, check_task
from navloom.plugins import PluginError
from navloom.plugins.registry import NODE, nearest
from navloom.runs.metrics import Metric, all_metrics

from navloom_study.episode_rows import EpisodeTask, Row
from navloom_study.fleet_episodes import known_metrics
from navloom_study.live_episodes import run_live
from navloom_study.openloop import METHOD, open_loop_of
from navloom_study.statistics import FLEET_PRIMARY, PRIMARY
from navloom_study.study_folder import StudyFolder
from navloom_study.study_methods import Method, compared, methods_of
from navloom_study.study_request import Study, StudyResult
from navloom_study.study_worlds import CachedDiscovery, WorldCase, placed, worlds_of
from navloom_study.worker_pool import HANG_AFTER, cores, run_on_executor, run_on_processes

__all__ = ["Study", "StudyResult", "plan_study", "run_study"]

Progress = Callable[[int, int, float | None], None]
"""Called with the number of ended episodes, the total, and the remaining time, s, or None if it is not known yet."""


def plan_study(
    config: str,
    vary: Sequence[str] = (),
    worlds: Sequence[str] = (),
    seeds: Sequence[int] = (),
    changes: Sequence[str] = (),
    say: Callable[[str], None] = lambda text: None,
    baseline: str = "",
    open_loop: bool = False,
    is_live: bool = False,
    primary: Sequence[str] = (),
    methods: Sequence[Method] = (),
    here: Path | None = None,
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
        is_live: Whether the episodes are to be driven live.
        primary: Metrics that the study asks about; default `PRIMARY`.
        methods: The methods, made already; default those of `vary`.
        here: Base folder of references that are not from a file; default the current one.

    Raises:
        ConfigError, PluginError: Something does not fit; the text names it and the nearest fix.
    """
    members = members_of(config)
    _check_fleet(members, open_loop, is_live)
    base = load_config(config, changes, member=members[0] if members else "")
    discovery = CachedDiscovery(base.config.plugins.blocked)
    methods = list(methods) or methods_of(config, vary, changes, discovery)
    baseline = _baseline(baseline, methods)
    beside = open_loop_of(methods, baseline) if open_loop else None
    say("reading worlds")
    here = here or Path.cwd()
    cases = worlds_of(base, worlds, discovery, here)
    single = len(methods) == len(cases) == 1
    say("checking methods")
    check = _check_live if is_live else check_task
    systems = {method.name: _checked(method, cases[0], discovery, here, single, check) for method in methods}
    say("checking worlds")
    # One method is enough: methods were checked in the first world, and do not change a world.
    for case in cases[1:]:
        _checked(methods[0], case, discovery, here, single, check)
    if beside is not None:
        _checked(Method(METHOD, (), beside.loaded), cases[0], discovery, here, single)
    equal, different = compared(systems)
    metrics, unusable = known_metrics(discovery, bool(members))
    of_members = all_metrics(discovery)[0] if members else ()
    _check_primary(primary, metrics)
    return Study(
        config,
        tuple(methods),
        tuple(cases),
        tuple(seeds) or (base.config.run.seed if base.fleet_seed is None else base.fleet_seed,),
        tuple(metric.name for metric in metrics),
        equal,
        different,
        {method.name: method.loaded.dropped for method in methods},
        _versions(systems, discovery),
        here,
        baseline,
        beside,
        unusable,
        is_live,
        tuple(primary) or (FLEET_PRIMARY if members else PRIMARY),
        tuple(metric.name for metric in of_members),
    )


def _check_fleet(members: Sequence[str], open_loop: bool, is_live: bool) -> None:
    """Refuse what compares streams of one robot, or drives live. Raises ConfigError."""
    for option, is_given in (("--open-loop", open_loop), ("--live", is_live)):
        if members and is_given:
            raise ConfigError(
                f"{option}: the config is of a fleet, [[member]], and this is for one robot: leave it out"
            )


def _check_primary(names: Sequence[str], metrics: Sequence[Metric]) -> None:
    """Raise ConfigError for a metric that is not known, or of which neither direction is better."""
    known = {metric.name: metric for metric in metrics}
    for name in names:
        if name not in known:
            raise ConfigError(f"--primary {name}: no such metric{nearest(name, [*known])}")
        if known[name].better is None:
            raise ConfigError(f"--primary {name}: neither more nor less of it is better; name another metric")


def _baseline(name: str, methods: Sequence[Method]) -> str:
    names = [method.name for method in methods]
    if name and name not in names:
        raise ConfigError(f"--baseline {name}: no such method{nearest(name, names)}")
    return name or names[0]


def _check_live(system: System) -> None:
    """Refuse what cannot be driven live, one episode after the other on this host. Raises ConfigError."""
    check_task(system)
    check_live(system)
    if system.config.live.router or system.config.live.hosts:
        raise system.loaded.error("live: --live drives on this host alone: leave live.hosts and live.router out")


def _checked(
    method: Method,
    case: WorldCase,
    discovery: CachedDiscovery,
    here: Path,
    single: bool,
    check: Callable[[System], None] = check_task,
) -> list[System]:
    """A method's system in a world, of a fleet that of each member.

    Raises:
        ConfigError: They do not fit; the text names both.
    """
    systems = []
    for one in method.members or (method.loaded,):
        loaded: Loaded = placed(one.to_json(), case.values, one.config.run.seed, here)
        try:
            systems.append(assemble(loaded, discovery))
            check(systems[-1])
        except (ConfigError, PluginError) as error:
            where = f"method {method.name} in world {case.ref}: " if not single else ""
            raise ConfigError(f"{where}{f'member {one.member}: ' if one.member else ''}{error}") from None
    return systems


def _versions(systems: Mapping[str, Sequence[System]], discovery: CachedDiscovery) -> dict[str, str]:
    """Versions of Python, the numerical packages, and the distributions whose plugins are active."""
    owners = {(info.role, info.name): info for info in discovery.infos()}
    found = {"python": platform.python_version(), "machine": platform.machine()}
    for name in ("navloom", "numpy", "numba", "scipy"):
        found[name] = version(name)
    used = {
        (role if role in ROLE_TABLES else NODE, system.config.role_table(role).plugin)
        for system in chain(*systems.values())
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
    ending: threading.Event | None = None,
    say: Callable[[str], None] = lambda text: None,
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
        ending: For a live study: set it to end the current robot and to leave, as with Ctrl-C.
        say: For a live study: receives what happens to the robots' processes.

    Raises:
        ConfigError: The folder holds another study, or cannot be used.
        PoolError: Workers cannot run at all, or the cluster went away. Ended episodes are kept, as with Ctrl-C.
        StudyError: The disk is full. Ended episodes are kept.
        StartError: For a live study: a robot does not start. Ended episodes are kept.
    """
    started = perf_counter()
    tasks = study.tasks()
    if twice and study.is_fleet:
        raise ConfigError("--twice: compares the streams of one robot, and the config is of a fleet: leave it out")
    with StudyFolder(out, study.request()) as folder:
        # Ended episodes are kept: an interrupted study continues.
        todo = [task for task in tasks if task.key not in folder.rows]
        before = len(tasks) - len(todo)
        clock = _Clock(before, len(tasks), progress)

        def on_row(row: Row) -> None:
            folder.keep(row)
            clock.count()

        def drive(tasks: Sequence[EpisodeTask], on_row: Callable[[Row], None]) -> int:
            if study.is_live:
                run_live(tasks, on_row, ending or threading.Event(), say, clock.tell)
                return 0
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
        count = 1 if study.is_live else jobs or cores()
        timings = _timings(rows, perf_counter() - started, count)
        files = folder.finish(rows, study.metrics, timings, beside, study.member_metrics)
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

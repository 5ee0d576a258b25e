"""`navloom up` and `navloom down`: a live robot with all its processes, and its end."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated, Any

import typer
from navloom.cli.interrupts import ending
from navloom.cli.options import Insecure, Record, RobotName, RunOptions
from navloom.cli.output import log_of, say_so
from navloom.cli.run_summary import is_reached, print_summary, tell_faults

from navloom_live.timing import DOWN_LIMIT

__all__ = ["down", "up"]

ORPHAN_END_WAIT = 2.0
"""Longest orderly shutdown of orphans before they are killed, s."""


def up(
    given: RunOptions,
    *,
    host: Annotated[str | None, typer.Option(metavar="NAME", help="Start this host's share of [live.hosts].")] = None,
    barrier: Annotated[
        bool, typer.Option("--barrier", help="Simulate time: the trace is that of `navloom run`.")
    ] = False,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="With --barrier: folder for result.json, trace.bin and run.png.")
    ] = None,
    record: Record = None,
    dashboard: Annotated[
        bool, typer.Option("--dashboard", help="Also serve `navloom dashboard`, and open it if there is a display.")
    ] = False,
    insecure: Insecure = False,
    start_anew: Annotated[
        bool,
        typer.Option("--start-anew", help="Start at the config's pose, not where the robot was when it was last up."),
    ] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="End with the last goal, and print the result as JSON.")
    ] = False,
) -> None:
    """Start a live robot and drive it to the config's goal.

    All its processes run supervised until Ctrl-C or `navloom down`.
    """
    from navloom.cli.output import print_json
    from navloom.config import ConfigError

    loaded = given.load(say_so)
    hosts = loaded.config.live.hosts
    if host is not None and host not in hosts:
        known = f"hosts are {', '.join(hosts)}" if hosts else "the config has no [live.hosts]"
        raise ConfigError(f"--host {host}: {known}")
    if record is not None and record.exists():
        raise ConfigError(f"--record {record}: there is such a file already; name another, or remove it")
    if dashboard and barrier:
        raise ConfigError("--dashboard shows a robot on the wall clock: leave --barrier out")
    if barrier:
        if host is not None or loaded.config.live.router:
            raise ConfigError("--barrier runs on one host without a router: leave --host and live.router out")
        _barrier(loaded, out, record, as_json)
        return
    if out is not None:
        raise ConfigError("--out: a live run keeps no trace; use it with --barrier or `navloom run`")
    cut: list[str] = []
    episode = _live(loaded, host, insecure, record, cut, as_json, not start_anew, dashboard)
    if episode is not None and as_json:
        print_json(episode.summary())
    reached = episode is None or episode.trail.succeeded
    raise typer.Exit(0 if reached and not cut else 1)


def down(
    robot: RobotName = None,
    every: Annotated[bool, typer.Option("--all", help="Every robot of this user on this host.")] = False,
) -> None:
    """Shut down a robot on this host.

    The robot stops, then its processes end in order. Orphaned processes end too.
    """
    from navloom_live.hosting.runtime_folders import DirectoryError, robots
    from navloom_live.operating.robot_lookup import find_robot

    failure: DirectoryError | None = None
    try:
        found = list(robots()) if every else [find_robot(robot)]
    except DirectoryError:
        if not _end_left(robot):
            raise
        return
    for running in found:
        try:
            _end(running)
            typer.echo(f"{running.realm}/{running.robot} is down")
        except DirectoryError as error:
            failure = failure or error
    is_any_left = _end_left(robot)
    if not found and not is_any_left:
        typer.echo("no robot of this user is up on this host")
    if failure is not None:
        raise failure


def _end_left(robot: str | None) -> bool:
    """End orphans of robots whose `navloom up` is gone, and print them. Returns whether there were any."""
    from navloom_live.hosting.descendants import end_all
    from navloom_live.operating.host_faults import strays

    names = sorted(strays(robot))
    for name in names:
        ended = end_all(lambda name=name: strays(name).get(name, []), ORPHAN_END_WAIT)  # type: ignore[misc]
        typer.echo(f"{name}: ended orphaned processes: {', '.join(map(str, ended))}")
    return bool(names)


def _end(running: Any) -> None:
    import contextlib
    import os
    import time

    from navloom_live.hosting.runtime_folders import DirectoryError, RobotFolder

    if not running.supervised:
        target = f"navloom-{running.realm}-{running.robot}.target"
        raise DirectoryError(
            f"robot {running.realm}/{running.robot} was not brought up by `navloom up`: end each `navloom node` where "
            f"it runs, with Ctrl-C, or all of them with `systemctl stop {target}` where systemd has them"
        )
    with contextlib.suppress(ProcessLookupError):
        os.kill(running.pid, signal.SIGTERM)
    folder = RobotFolder(running.realm, running.robot)
    limit = time.monotonic() + DOWN_LIMIT
    while time.monotonic() < limit:
        now = folder.read()  # None once the robot's lock is free
        if now is None or now.pid != running.pid:
            return
        time.sleep(0.02)
    raise DirectoryError(
        f"process {running.pid} did not end within {DOWN_LIMIT:g} s: `kill -9 {running.pid}` ends it at once"
    )


def _barrier(loaded: Any, out: Path | None, record: Path | None, as_json: bool) -> None:
    from navloom.cli.output import print_json, stage
    from navloom.cli.written_files import Written
    from navloom.plugins import Discovery
    from navloom.plugins.run_observers import Onlookers
    from navloom.runs.result_folder import ResultFolder

    from navloom_live.drives.barrier_run import run_barrier

    cut: list[str] = []
    onlookers = Onlookers(Discovery(loaded.config.plugins.blocked), log_of("plugins").warning)
    with ending() as event, onlookers, ResultFolder(out) as folder, stage(as_json) as (say, progress):
        episode = run_barrier(
            loaded,
            trace=folder.trace,
            say=say,
            progress=progress,
            ends=event.is_set,
            beside=_beside(record, log_of("recording").info, cut),
            onlookers=onlookers,
        )
        summary = episode.summary()
        folder.keep(episode, summary)
        onlookers.finish(summary, episode, folder)
    written = Written(folder)
    tell_faults(episode, summary, record)
    if as_json:
        print_json({**summary, "written": written.to_json()})
    else:
        print_summary(episode, summary)
    is_whole = written.tell(as_json) and not cut
    raise typer.Exit(0 if is_reached(summary) and is_whole else 1)


def _beside(record: Path | None, say: Callable[[str], None], cut: list[str]) -> Callable[[Any], Any] | None:
    """Starts a recorder beside a robot that is up, if one is requested; `cut` gets the reason if it fails."""
    if record is None:
        return None
    from navloom_live.operating.processes_beside import recorder_beside

    return lambda robot: recorder_beside(robot.keys.prefix, record, say, cut, robot.network.insecure)


def _live(
    loaded: Any,
    host: str | None,
    insecure: bool,
    record: Path | None,
    cut: list[str],
    as_json: bool,
    resumes: bool,
    dashboard: bool,
) -> Any:
    from navloom.config import ConfigError
    from navloom.plugins import Discovery
    from navloom.plugins.run_observers import Onlookers

    from navloom_live.cli.live_table import StatusTable
    from navloom_live.drives.live_run import LiveRun

    with ending() as event, ExitStack() as observed:
        run = LiveRun(loaded, host, insecure, log_of("hosting").info, event, keeps=True, resumes=resumes)
        if as_json and not run.judges:
            raise ConfigError(f"--json: a run is judged on the host of the platform, and host {host} has none")
        with StatusTable(run, sys.stderr, log_of("hosting").info) as table:
            run.beside = _beside(record, log_of("recording").info, cut)
            run.recording = record
            if dashboard:
                from navloom_live.operating.processes_beside import dashboard_beside

                table_of = loaded.config.robot
                prefix = f"{table_of.realm}/{table_of.name}"
                observed.enter_context(dashboard_beside(prefix, insecure, log_of("dashboard").info))
            run.onlookers = observed.enter_context(
                Onlookers(Discovery(loaded.config.plugins.blocked), log_of("plugins").warning)
            )
            episode = run.run(as_json, table.missing, table.look, None if as_json else table.result)
            run.onlookers.finish(None if episode is None else episode.summary())
            return episode

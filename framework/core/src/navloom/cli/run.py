"""`navloom run`: one run in lockstep."""

from __future__ import annotations

import sys
from contextlib import redirect_stdout
from pathlib import Path
from typing import Annotated

import typer

from navloom.cli.options import Record, RunOptions, ViewOptions
from navloom.cli.output import log_of, print_json, say_so, stage
from navloom.cli.run_summary import is_reached, print_summary, tell_faults

__all__ = ["run"]


def run(
    given: RunOptions,
    *,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder for result.json, trace.bin and run.png.")
    ] = None,
    record: Record = None,
    view: ViewOptions,
    processes: Annotated[
        int, typer.Option(metavar="N", min=1, help="Processes that drive a fleet; they change no result.")
    ] = 1,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as one JSON object.")] = False,
) -> None:
    """Run a config in simulated time, in one process (lockstep).

    Repeatable bit for bit. Exit 0: the goal was reached. A config with [[member]] drives several robots in one world.
    """
    from navloom.cli.fleet_run import run_members
    from navloom.cli.run_observers import recorded, watched, watched_for_stalls
    from navloom.cli.written_files import Written, record_of, rerun_of
    from navloom.config import ConfigError
    from navloom.config.loader import members_of
    from navloom.plugins import Discovery
    from navloom.plugins.run_observers import Onlookers
    from navloom.runs.episode import run_episode
    from navloom.runs.result_folder import ResultFolder

    where = view.asked()
    if members_of(given.config):
        if processes > 1 and (record is not None or where is not None):
            raise ConfigError(f"--processes {processes}: --record and a viewer need all members in one process: take 1")
        raise typer.Exit(0 if run_members(given, out, record, view, as_json, processes) else 1)
    if processes > 1:
        raise ConfigError(f"--processes {processes}: {given.config} has no [[member]], and one robot has one process")
    loaded = given.load(say_so)
    discovery = Discovery(loaded.config.plugins.blocked)
    with (
        watched(where, "watch_run", loaded) as watch,
        Onlookers(discovery, log_of("plugins").warning) as onlookers,
    ):
        with ResultFolder(out) as folder, recorded(loaded, record) as recorder, stage(as_json) as (say, progress):
            observers = [*([] if recorder is None else [recorder]), *watch.observers]
            with redirect_stdout(sys.stderr), watched_for_stalls(watch.between(progress)) as tell:  # plugins may print
                episode = run_episode(
                    loaded, discovery=discovery, observers=observers, onlookers=onlookers, trace=folder.trace, say=say,
                    progress=tell,
                )  # fmt: skip
            summary = episode.summary()
            folder.keep(episode, summary)
            onlookers.finish(summary, episode, folder)
        watch.finish()
        written = Written(folder, record_of(recorder), rerun_of(view.rerun, watch.showing))
        tell_faults(episode, summary, record)
        if as_json:
            print_json({**summary, "written": written.to_json()})
        else:
            print_summary(episode, summary)
        is_whole = written.tell(as_json)
    raise typer.Exit(0 if is_reached(summary) and is_whole else 1)

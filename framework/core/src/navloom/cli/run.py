"""`navloom run`: one run in lockstep."""

from __future__ import annotations

import faulthandler
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from types import FrameType
from typing import Annotated

import typer

from navloom.cli.options import Record, RunOptions, ViewOptions
from navloom.cli.output import LOG, log_of, print_json, say_so, stage
from navloom.cli.run_summary import is_reached, print_summary, tell_faults
from navloom.crash_watch import dump_file, is_watched

__all__ = ["run"]

STALLED = 10.0
"""Longest time without a tick before the line that blocks the run is logged, s."""
COMPILING = 12
"""Factor by which the first tick may take longer, because kernels compile."""
COMPILER = {"numba", "llvmlite"}
BENEATH = sys.stdlib_module_names | COMPILER
"""Modules whose lines are of no use to a user."""


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
    from navloom.cli.run_observers import recorded, watched
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


@contextmanager
def watched_for_stalls(
    progress: Callable[[float, float], None], patience: float = STALLED
) -> Iterator[Callable[[float, float], None]]:
    """A progress function. If it is not called for `patience`, s, the line of code that blocks the run is logged.

    Before the first tick kernels may compile, so the limit is `COMPILING` times as long until then.
    """
    runs, moved, ended = threading.get_ident(), [time.monotonic()], threading.Event()
    limits = [COMPILING * patience]

    def tell(done: float, total: float) -> None:
        moved[0], limits[0] = time.monotonic(), patience
        if is_watched():  # while code holds the GIL, the thread below cannot run
            faulthandler.dump_traceback_later(1.5 * patience, file=dump_file())
        progress(done, total)

    def look() -> None:
        told = 0.0
        while not ended.wait(0.1 * patience):
            last, limit = moved[0], limits[0]
            if last != told and time.monotonic() - last > limit:
                told = last
                faulthandler.cancel_dump_traceback_later()
                LOG.warning(f"no tick for {limit:g} s: {_where(sys._current_frames()[runs])}; Ctrl-C ends it")

    thread = threading.Thread(target=look, daemon=True)
    thread.start()
    try:
        yield tell
    finally:
        faulthandler.cancel_dump_traceback_later()
        ended.set()
        thread.join()


def _where(frame: FrameType) -> str:
    """The line that a thread is at, in words, outside Python's own modules and the kernel compiler."""
    compiles = False
    while frame.f_back and (top := frame.f_globals["__name__"].partition(".")[0]) in BENEATH:
        compiles |= top in COMPILER
        frame = frame.f_back
    place = f"{Path(frame.f_code.co_filename).name}:{frame.f_lineno}, in {frame.f_code.co_name}"
    return f"a kernel is being compiled for {place}" if compiles else f"the run is at {place}"

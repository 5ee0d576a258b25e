"""`navloom run`: one run in lockstep."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from typing import Annotated, Any

import typer

from navloom.cli.config import ConfigName
from navloom.cli.view import Rerun, View, ViewerUrl, Web, say_so, where_of

__all__ = ["print_summary", "recorded", "run"]

LABELS = {
    "plan_length_m": "plan, before pruning, m",
    "path_length_m": "driven, m",
    "optimal_length_m": "shortest possible, m",
    "min_clearance_m": "least clearance, m",
    "cross_track_rms_m": "cross-track rms, m",
    "cross_track_max_m": "cross-track max, m",
    "collisions": "collisions",
    "recoveries": "recoveries",
    "sim_time_s": "robot time, s",
    "wall_s": "computed in, s",
    "trace_sha256": "trace",
}


STALLED = 10.0
"""s without progress after which it is said what a run is at."""
COMPILING = 12
"""How many times as long the first tick may take to come."""


def run(
    config: ConfigName,
    seed: Annotated[int | None, typer.Option(metavar="N", help="Seed of every random stream.")] = None,
    set_: Annotated[
        list[str] | None, typer.Option("--set", metavar="A.B=V", help="Change one value of the config; repeats.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder for result.json, trace.bin and run.png.")
    ] = None,
    record: Annotated[
        Path | None, typer.Option(metavar="F.mcap", help="Record every message and step, of shadows too.")
    ] = None,
    view: View = False,
    web: Web = False,
    viewer: ViewerUrl = None,
    rerun: Rerun = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as one JSON object.")] = False,
) -> None:
    """Run a config in lockstep: simulated time, one process, repeatable bit for bit. Exit 0: the goal was reached."""
    from navloom.cli.output import print_json, stage
    from navloom.config import load_config
    from navloom.study.episode import run_episode
    from navloom.study.results import ResultFolder
    from navloom.viewer.watching import watch_run

    loaded = load_config(config, set_ or (), seed)
    for notice in loaded.notices():
        typer.echo(f"navloom: {notice}", err=True)
    is_seen = view or web or viewer is not None or rerun is not None
    where = where_of(view, rerun, viewer, web) if is_seen else None
    with watch_run(loaded, where, say_so) as watch:
        with ResultFolder(out) as folder, recorded(loaded, record) as looking, stage(as_json) as (say, progress):
            observers = [*looking, *watch.observers]
            with redirect_stdout(sys.stderr), watched_for_stalls(watch.between(progress)) as tell:  # plugins may print
                episode = run_episode(loaded, observers=observers, trace=folder.trace, say=say, progress=tell)
            summary = episode.summary()
            folder.keep(episode, summary)
        for fault in episode.log.faults:
            typer.echo(f"navloom: {fault}", err=True)
        if as_json:
            print_json(summary)
        else:
            print_summary(episode, summary, out, folder.names)
    raise typer.Exit(0 if summary["outcome"] == "succeeded" else 1)


@contextmanager
def watched_for_stalls(
    progress: Callable[[float, float], None], patience: float = STALLED
) -> Iterator[Callable[[float, float], None]]:
    """A progress function; where it is not called for s, the line of code that keeps the run is named on the way.

    Before the first tick kernels may be compiled: until then it is given `COMPILING` times as long.
    """
    runs, moved, ended = threading.get_ident(), [time.monotonic()], threading.Event()
    limits = [COMPILING * patience]

    def tell(done: float, total: float) -> None:
        moved[0], limits[0] = time.monotonic(), patience
        progress(done, total)

    def look() -> None:
        told = 0.0
        while not ended.wait(0.1 * patience):
            last, limit = moved[0], limits[0]
            if last != told and time.monotonic() - last > limit:
                told = last
                frame = sys._current_frames()[runs]
                while frame.f_back and frame.f_globals["__name__"].partition(".")[0] in sys.stdlib_module_names:
                    frame = frame.f_back
                place = f"{Path(frame.f_code.co_filename).name}:{frame.f_lineno}, in {frame.f_code.co_name}"
                typer.echo(f"navloom: no tick for {limit:g} s: the run is at {place}; Ctrl-C ends it", err=True)

    thread = threading.Thread(target=look, daemon=True)
    thread.start()
    try:
        yield tell
    finally:
        ended.set()
        thread.join()


@contextmanager
def recorded(loaded: Any, path: Path | None) -> Iterator[list[Any]]:
    """The observer that writes a recording, if one is asked for. A disk that is full ends it, not the run."""
    if path is None:
        yield []
        return
    from navloom.recording.header import header_of
    from navloom.recording.lockstep_recorder import LockstepRecorder
    from navloom.recording.worldfiles import world_files
    from navloom.recording.writer import RecordingWriter
    from navloom.runtime.provenance import distributions

    header = header_of(loaded, "lockstep", distributions(loaded.config))
    writer = RecordingWriter(path, header, world_files(loaded))
    with LockstepRecorder(writer, lambda text: typer.echo(f"navloom: {text}", err=True)) as recorder:
        yield [recorder]


def print_summary(episode: Any, summary: Mapping[str, Any], out: Path | None, kept: Sequence[str]) -> None:
    """A run's result for people."""
    from navloom.cli.output import print_table

    rows: list[tuple[str, Any]] = [(label, summary[key]) for key, label in LABELS.items() if summary[key] is not None]
    end = episode.result.place
    typer.echo(f"{summary['outcome']}: {summary['reason']}, at ({end.x:.2f}, {end.y:.2f})")
    print_table(("", ""), rows)
    if summary["shadows"]:
        _print_shadows(summary["shadows"])
    if out is not None:
        typer.echo(f"kept in {out}: {', '.join(kept)}")


def _print_shadows(shadows: Sequence[Mapping[str, Any]]) -> None:
    """What alternatives in shadow would have said, for people."""
    from navloom.cli.output import print_table
    from navloom.dataflow.differences import UNITS

    lines = []
    for one in shadows:
        sizes = one["differences"].items()
        worst = ", ".join(f"{name} {size['rms']:.3g}/{size['max']:.3g} {UNITS[name]}" for name, size in sizes)
        share = one["differing_share"]
        told = "-" if share is None else f"{100.0 * share:.1f} %"
        lines.append((f"{one['role']} {one['instance']}", one["ticks"], told, one["first_differing_s"], worst or None))
    print_table(("in shadow", "ticks", "differing", "first at, s", "difference, rms/max"), lines)

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

__all__ = ["print_summary", "recorded", "run", "tell_faults"]

LABELS = {
    "plan_length_m": "plan, before pruning, m",
    "path_length_m": "driven, m",
    "optimal_to_tolerance_m": "shortest possible, to within the goal's tolerance, m",
    "goal_error_m": "from the goal, in truth, m",
    "min_clearance_m": "least clearance, m",
    "cross_track_rms_m": "cross-track rms, m",
    "cross_track_max_m": "cross-track max, m",
    "collisions": "collisions",
    "recoveries": "recoveries",
    "gate_limits": "slowed by the gate's monitor",
    "sim_time_s": "robot time, s",
    "wall_s": "computed in, s",
    "trace_sha256": "trace",
}


STALLED = 10.0
"""s without a tick after which it is said what a run is at."""
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
    from navloom.cli.written import Written, record_of, rerun_of
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
        with ResultFolder(out) as folder, recorded(loaded, record) as recorder, stage(as_json) as (say, progress):
            observers = [*([] if recorder is None else [recorder]), *watch.observers]
            with redirect_stdout(sys.stderr), watched_for_stalls(watch.between(progress)) as tell:  # plugins may print
                episode = run_episode(loaded, observers=observers, trace=folder.trace, say=say, progress=tell)
            summary = episode.summary()
            folder.keep(episode, summary)
        watch.finish()
        written = Written(folder, record_of(recorder), rerun_of(rerun, watch.showing))
        tell_faults(episode, summary)
        if as_json:
            print_json({**summary, "written": written.to_json()})
        else:
            print_summary(episode, summary)
        is_whole = written.tell(as_json)
    raise typer.Exit(0 if is_reached(summary) and is_whole else 1)


def is_reached(summary: Mapping[str, Any]) -> bool:
    """The goal was reached: the robot says so, and so does the ground truth where there is one."""
    return summary["outcome"] == "succeeded" and summary["truly_reached"] is not False


def tell_faults(episode: Any, summary: Mapping[str, Any]) -> None:
    """What plugins broke, which ask for far too much, and which are slower than the robot that they drive."""
    for fault in episode.log.faults:
        say_so(fault)
    for note in summary["notes"]:
        say_so(note)
    for one in summary["slow"]:
        say_so(
            f"{one['role']} {one['instance']} is slow: {one['late']} of its {one['steps']} steps took longer than the "
            f"{one['limit_ms']:g} ms to the next one, p99 {one['p99_ms']:.3g} ms; a live robot would stop for it: give "
            "it a lower rate_hz, or run.period more time"
        )


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
                say_so(f"no tick for {limit:g} s: the run is at {place}; Ctrl-C ends it")

    thread = threading.Thread(target=look, daemon=True)
    thread.start()
    try:
        yield tell
    finally:
        ended.set()
        thread.join()


@contextmanager
def recorded(loaded: Any, path: Path | None) -> Iterator[Any]:
    """The observer that writes a recording, if one is asked for. A disk that is full ends it, not the run."""
    if path is None:
        yield None
        return
    from navloom.recording.header import header_of
    from navloom.recording.lockstep_recorder import LockstepRecorder
    from navloom.recording.worldfiles import world_files
    from navloom.recording.writer import RecordingWriter
    from navloom.runtime.provenance import distributions

    header = header_of(loaded, "lockstep", distributions(loaded.config))
    writer = RecordingWriter(path, header, world_files(loaded))
    try:
        with LockstepRecorder(writer, say_so) as recorder:
            yield recorder
    except BaseException:
        if not writer.messages:  # the run was refused: there is nothing in it
            writer.discard()
        raise


def print_summary(episode: Any, summary: Mapping[str, Any]) -> None:
    """A run's result for people."""
    from navloom.cli.output import print_table

    rows: list[tuple[str, Any]] = [(label, summary[key]) for key, label in LABELS.items() if summary[key] is not None]
    if summary["pose_error_m"] is not None:
        error = summary["pose_error_m"]
        rows.append(("pose error rms, p95, max, m", f"{error['rms']:.3g}, {error['p95']:.3g}, {error['max']:.3g}"))
    end = episode.result.place
    told = f"{summary['outcome']}: {summary['reason']}"
    if summary["outcome"] == "succeeded" and summary["truly_reached"] is False:
        told = episode.trail.reason
    typer.echo(f"{told}, at ({end.x:.2f}, {end.y:.2f})")
    if summary["truly_reached"] is None:
        typer.echo("no ground truth: whether the robot is where it says is not known")
    print_table(("", ""), rows)
    if summary["shadows"]:
        _print_shadows(summary["shadows"])


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

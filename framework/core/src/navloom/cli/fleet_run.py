"""`navloom run` of a config with `[[member]]`: several robots in one world."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from contextlib import ExitStack, redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from navloom.cli.options import RunOptions, ViewOptions
from navloom.cli.output import log_of, print_json, print_table, say_so, stage
from navloom.cli.run_summary import is_reached, tell_faults
from navloom.cli.written_files import PICTURE, Written, record_of, rerun_of
from navloom.parts import has_part, part

if TYPE_CHECKING:
    from navloom.config import Loaded
    from navloom.plugins.run_observers import Onlookers
    from navloom.runs.fleet import Fleet

__all__ = ["run_members"]

COLUMNS = {
    "sim_time_s": "robot time, s",
    "path_length_m": "driven, m",
    "goal_error_m": "from the goal, m",
    "min_clearance_m": "minimum clearance, m",
    "collisions": "collisions",
    "gate_stops": "gate stops",
}


def run_members(
    given: RunOptions, out: Path | None, record: Path | None, view: ViewOptions, as_json: bool, processes: int
) -> bool:
    """Run a fleet, and print a row for each member. Returns whether each reached its goal and each file is whole.

    Args:
        given: The config and its changes.
        out: Folder for result.json, run.png, and a folder for each member, with what a robot alone gets.
        record: File whose name, with that of a member before its suffix, is that of the member's recording.
        view: Where to show all members.
        as_json: Print one JSON object.
        processes: Number of processes that drive the members.
    """
    from navloom.cli.run_observers import recorded, watched, watched_for_stalls
    from navloom.runs.fleet import load_fleet, run_fleet
    from navloom.runs.result_folder import OutFolder, ResultFolder

    members = load_fleet(given.config, given.set_ or (), given.seed, given.shadow or (), given.method)
    for notice in dict.fromkeys(notice for loaded in members for notice in loaded.notices()):
        say_so(notice)
    with watched(view.asked(), "watch_fleet", members) as watch:
        with ExitStack() as within:
            folder = within.enter_context(OutFolder(out, ("result.json", PICTURE)))
            onlookers = _onlookers(within, members)
            own = {one.member: within.enter_context(ResultFolder(out and out / one.member)) for one in members}
            recorders = {
                one.member: within.enter_context(recorded(one, record and _file_of(record, one.member)))
                for one in members
            }
            observers = {name: [] if recorder is None else [recorder] for name, recorder in recorders.items()}
            for name, observer in zip(observers, watch.observers, strict=False):
                observers[name].append(observer)
            say, progress = within.enter_context(stage(as_json))
            with redirect_stdout(sys.stderr), watched_for_stalls(watch.between(progress)) as tell:  # plugins may print
                traces = {name: held.trace for name, held in own.items() if held.trace is not None}
                fleet = run_fleet(
                    members, traces=traces, say=say, progress=tell, onlookers=onlookers,
                    observers=observers, processes=processes,
                )  # fmt: skip
            if fleet.unheard:
                unheard = ", ".join(fleet.unheard)
                say_so(f"--processes {processes}: observers got no messages of {unheard}: use one process")
            summary = fleet.summary()
            for name, episode in fleet.episodes.items():
                own[name].keep(episode, summary["members"][name])
                onlookers[name].finish(summary["members"][name], episode, own[name])
            folder.write({"result.json": json.dumps(summary, indent=2) + "\n"})
            if out is not None and has_part("navloom_study"):
                report = "navloom_study.report"
                picture = part(f"{report}.run_picture").draw_fleet(fleet)
                folder.write({PICTURE: part(f"{report}.plotting").png_of(picture)})
        watch.finish()
        written = [Written(own[name], record_of(recorders[name])) for name in own]
        written.insert(0, Written(folder, rerun=rerun_of(view.rerun, watch.showing)))
        for name, episode in fleet.episodes.items():
            tell_faults(episode, summary["members"][name])
        if as_json:
            print_json({**summary, "written": _told(written)})
        else:
            _print(fleet, summary)
        are_whole = [one.tell(as_json) for one in written]
    return all(are_whole) and all(map(is_reached, summary["members"].values()))


def _file_of(record: Path, member: str) -> Path:
    """The recording of a member: `fleet.mcap` is `fleet.NAME.mcap`."""
    return record.with_name(f"{record.stem}.{member}{record.suffix}")


def _onlookers(within: ExitStack, members: Sequence[Loaded]) -> dict[str, Onlookers]:
    """Observers of plugins of each member, by name."""
    from navloom.plugins import Discovery
    from navloom.plugins.run_observers import Onlookers

    blocked = {one.member: frozenset(one.config.plugins.blocked) for one in members}
    discoveries = {names: Discovery(names) for names in blocked.values()}
    warn = log_of("plugins").warning
    return {name: within.enter_context(Onlookers(discoveries[names], warn)) for name, names in blocked.items()}


def _told(written: Sequence[Written]) -> dict[str, Any]:
    """The files of the fleet and of each member for `--json`, by option."""
    folders = [one.out for one in written]
    found = {"out": [str(held.folder / name) for held in folders if held.folder is not None for name in held.names]}
    files = {"record": [one.record for one in written], "rerun": [one.rerun for one in written]}
    return found | {
        option: told for option, given in files.items() if (told := [file.to_json() for file in given if file])
    }


def _print(fleet: Fleet, summary: dict[str, Any]) -> None:
    """Print a row for each member, and what the fleet has as a whole."""
    rows = []
    for name, member in summary["members"].items():
        # By the truth, which may be another than what the robot believes.
        trail = fleet.episodes[name].trail
        rows.append([name, trail.outcome, *(member[key] for key in COLUMNS), trail.reason])
    print_table(("member", "outcome", *COLUMNS.values(), "reason"), rows)
    typer.echo(
        f"{summary['reached']} of {len(rows)} reached their goals; {summary['collisions']} collisions; robot time "
        f"{summary['sim_time_s']:.4g} s in {summary['wall_s']:.4g} s; trace {summary['trace_sha256']}"
    )

"""`navloom run`: one run in lockstep."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

__all__ = ["print_summary", "run"]

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


def run(
    config: Annotated[str, typer.Argument(metavar="CONFIG", help="Path of a config, or a shipped name: paper.")],
    seed: Annotated[int | None, typer.Option(metavar="N", help="Seed of every random stream.")] = None,
    set_: Annotated[
        list[str] | None, typer.Option("--set", metavar="A.B=V", help="Change one value of the config; repeats.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder for result.json, trace.bin and run.png.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as one JSON object.")] = False,
) -> None:
    """Run a config in lockstep: simulated time, one process, repeatable bit for bit. Exit 0: the goal was reached."""
    from navloom.cli.output import print_json, stage
    from navloom.config import load_config
    from navloom.study.episode import run_episode
    from navloom.study.results import ResultFolder

    loaded = load_config(config, set_ or (), seed)
    for place in loaded.dropped:
        typer.echo(f"navloom: {place} belongs to the plugin that --set replaced: dropped", err=True)
    with ResultFolder(out) as folder, stage(as_json) as (say, progress):
        episode = run_episode(loaded, trace=folder.trace, say=say, progress=progress)
        summary = episode.summary()
        folder.keep(episode, summary)
    for fault in episode.log.faults:
        typer.echo(f"navloom: {fault}", err=True)
    if as_json:
        print_json(summary)
    else:
        print_summary(episode, summary, out, folder.names)
    raise typer.Exit(0 if summary["outcome"] == "succeeded" else 1)


def print_summary(episode: Any, summary: Mapping[str, Any], out: Path | None, kept: Sequence[str]) -> None:
    """A run's result for people."""
    from navloom.cli.output import print_table

    rows: list[tuple[str, Any]] = [(label, summary[key]) for key, label in LABELS.items() if summary[key] is not None]
    end = episode.result.place
    typer.echo(f"{summary['outcome']}: {summary['reason']}, at ({end.x:.2f}, {end.y:.2f})")
    print_table(("", ""), rows)
    if out is not None:
        typer.echo(f"kept in {out}: {', '.join(kept)}")

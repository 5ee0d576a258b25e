"""`navloom replay` of imported logs, which have no steps: plugins run on their messages."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import typer
from navloom.cli.options import MapOptions
from navloom.parts import has_part, part

__all__ = ["replay_imported"]


def replay_imported(
    recording: Any,
    loaded: Any,
    stand_ins: dict[str, str],
    changes: Sequence[str],
    out: Path | None,
    as_json: bool,
    place: MapOptions,
) -> None:
    """`navloom replay` of an imported log: run the given plugins on its messages.

    Args:
        recording: The imported log.
        loaded: Its config.
        stand_ins: Plugin by role.
        changes: Changes of their parameters.
        out: Folder for results; None for none.
        as_json: Print JSON.
        place: Map and start, in place of those of the import.
    """
    from navloom.cli.output import print_json, stage
    from navloom.cli.written_files import tell_out
    from navloom.config import ConfigError
    from navloom.runs.result_folder import MAP, OutFolder

    from navloom_recording.cli.substitute_output import can_draw
    from navloom_recording.log_replay import place_in_map, replay_log
    from navloom_recording.substitutes import substitute_config

    if not stand_ins:
        raise ConfigError(
            "an imported log has no steps to replay: name what to try on it, as --mapper scan_grid or --avoider vff"
        )
    if place != MapOptions():
        loaded = place_in_map(recording, loaded, place.map_, place.pose())
    for role, name in stand_ins.items():
        loaded = substitute_config(loaded, role, name, changes)
    with OutFolder(
        out, ("result.json", "ticks.csv", "poses.csv", "poses.png", "avoider.png", "map.png", *MAP)
    ) as folder:
        draws = out is not None and "avoider" in stand_ins and can_draw()
        with stage(as_json) as (say, _):
            found = replay_log(recording, loaded, list(stand_ins), say)
        summary = found.summary()
        if out is not None:
            folder.write(_files(found, summary, draws))
            if found.map is not None:
                folder.write_map(found.map.grid)
    if as_json:
        print_json(summary)
    else:
        _tell(found, summary)
    is_whole = tell_out(folder, as_json)
    raise typer.Exit(0 if is_whole and ("mapper" not in stand_ins or found.map is not None) else 1)


def _tell(found: Any, summary: dict[str, Any]) -> None:
    from navloom.cli.output import print_table

    from navloom_recording.cli.substitute_output import tell_substitute
    from navloom_recording.log_replay import DRIVER

    typer.echo(f"{summary['seconds']:.1f} s, {summary['driven_m']:.1f} m driven, {summary['ticks']} ticks")
    if "map" in summary:
        print_table(("map", ""), list(summary["map"].items()))
    elif found.has_mapper:
        typer.echo("no map: the mapper published none")
    if "localizer" in summary:
        given = summary["localizer"]
        typer.echo(f"localizer {given['instance']}: {given['poses']} poses, beside the recorded odometry")
        print_table(
            ("difference", "unit", "rms", "max", "at the end"),
            [(name, unit, *given[name].values()) for name, unit in (("position", "m"), ("heading", "rad"))],
        )
        away = given["searching_s"] + given["lost_s"]
        if away or given["not_tracking_from_s"] is not None:
            since = given["not_tracking_from_s"]
            end = "" if since is None else f", and from {since:.1f} s to the end"
            typer.echo(
                f"not tracking for {away:.1f} s of {summary['seconds']:.1f} s (lost for {given['lost_s']:.1f} s{end})"
            )
    if found.avoider is not None:
        tell_substitute(found.avoider, DRIVER)
    if found.faults:
        typer.echo(f"{len(found.faults)} steps failed; the first: {found.faults[0]}")


def _files(found: Any, summary: dict[str, Any], draws: bool) -> dict[str, bytes]:
    """result.json, pictures of the map and of the localizer's track, and an avoider's ticks."""
    from navloom.cli.output import json_bytes
    from navloom.runs.shadow_comparison import shadow_table

    from navloom_recording.log_replay import DRIVER

    files = {"result.json": json_bytes(summary)}
    if found.avoider is not None:
        files["ticks.csv"] = shadow_table([found.avoider.found]).encode()
        if draws:
            files["avoider.png"] = part("navloom_study.report.substitute_figure").draw_substitute(found.avoider, DRIVER)
    if found.poses is not None:
        files["poses.csv"] = found.poses.table().encode()
    if has_part("navloom_study"):
        picture, png_of = part("navloom_study.report.run_picture"), part("navloom_study.report.plotting").png_of
        if found.map is not None:
            files["map.png"] = png_of(picture.draw_map_update(found.map, found.way))
        if found.poses is not None and len(found.poses.poses):
            drawn = picture.draw_poses(found.poses.poses, found.known, found.poses.is_tracking)
            files["poses.png"] = png_of(drawn)
    return files

"""`navloom import`: converts a CARMEN log to a recording, and replays imported recordings."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from navloom.cli.options import AsJson, MapOptions, a_number, seconds

__all__ = ["import_log", "replay_imported"]


class Poses(StrEnum):
    """Source of the odometry."""

    odometry = "odometry"
    corrected = "corrected"


def import_log(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="A CARMEN log, or one in gzip.")],
    out: Annotated[Path, typer.Option("--out", metavar="F.mcap", help="Recording to write.")],
    place: MapOptions,
    poses: Annotated[
        Poses, typer.Option("--poses", help="Raw odometry of the wheels, or the log's corrected poses.")
    ] = Poses.odometry,
    period: Annotated[
        float | None,
        typer.Option(metavar="S", help="Time between scans, s, if the log's stamps are unusable.", callback=seconds),
    ] = None,
    range_max: Annotated[
        float | None,
        typer.Option(
            metavar="M",
            min=0.1,
            help="Readings from this range on are no echo, m; default: the log's limit.",
            callback=a_number,
        ),
    ] = None,
    mount: Annotated[
        list[str] | None,
        typer.Option("--mount", metavar="NAME=X,Y,YAW_DEG", help="Where the laser is on the robot; repeats."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Import a CARMEN log with laser scans and odometry.

    If the log's poses are corrected, the raw odometry is recovered.
    """
    from navloom.cli.output import print_json, print_table
    from navloom.recording.carmen_import import import_carmen
    from navloom.recording.imported import mount_option

    mounts = {name: pose[:3] for name, pose in map(mount_option, mount or ())}
    start = place.pose()
    _refuse_bag(log)
    found = import_carmen(log, out, poses.value, period, range_max, mounts, place.map_, start)
    if as_json:
        print_json({"file": str(out), **found.to_json()})
        return
    rows: list[tuple[object, ...]] = [("odometry", found.odometry, "")]
    for name, count in found.scans.items():
        x, y, yaw_deg = found.to_json()["mounts"][name]
        rows.append((name, count, f"at {x:.3f}, {y:.3f} m, {yaw_deg:.1f}°"))
    rows += [("skipped", count, reason) for reason, count in found.skipped.most_common(5)]
    print_table(("", "messages", ""), rows)
    taken = ", its poses corrected: odometry recovered" if found.is_corrected and poses is Poses.odometry else ""
    typer.echo(f"{out}: {(found.last_ns - found.first_ns) * 1e-9:.1f} s{taken}")


def _refuse_bag(path: Path) -> None:
    """Say which command reads ROS bags. Raises ConfigError."""
    from navloom.config import ConfigError
    from navloom.entry_kinds import added_commands

    if path.suffix not in (".bag", ".db3", ".mcap") and not path.is_dir():
        return
    is_there = any(point.name == "ros" for point in added_commands())
    first = "" if is_there else "install navloom-ros, then "
    raise ConfigError(f"{path}: a ROS bag? This command reads CARMEN logs; {first}use navloom ros import {path}")


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
    from navloom.cli.recordings.substitute_output import can_draw
    from navloom.cli.written import tell_out
    from navloom.config import ConfigError
    from navloom.recording.log_replay import place_in_map, replay_log
    from navloom.recording.substitutes import substitute_config
    from navloom.report.results import MAP, OutFolder

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
    from navloom.cli.recordings.substitute_output import tell_substitute
    from navloom.recording.log_replay import DRIVER

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
    if found.avoider is not None:
        tell_substitute(found.avoider, DRIVER)
    if found.faults:
        typer.echo(f"{len(found.faults)} steps failed; the first: {found.faults[0]}")


def _files(found: Any, summary: dict[str, Any], draws: bool) -> dict[str, bytes]:
    """result.json, pictures of the map and of the localizer's track, and an avoider's ticks."""
    from navloom.cli.output import json_bytes
    from navloom.recording.log_replay import DRIVER
    from navloom.recording.shadows import shadow_table
    from navloom.report.picture import draw_map_update, draw_poses, png_of
    from navloom.report.substitute_figure import draw_substitute

    files = {"result.json": json_bytes(summary)}
    if found.avoider is not None:
        files["ticks.csv"] = shadow_table([found.avoider.found]).encode()
        if draws:
            files["avoider.png"] = draw_substitute(found.avoider, DRIVER)
    if found.map is not None:
        files["map.png"] = png_of(draw_map_update(found.map, found.way))
    if found.poses is not None:
        files["poses.csv"] = found.pose_table().encode()
        if len(found.poses):
            files["poses.png"] = png_of(draw_poses(found.poses, found.known))
    return files

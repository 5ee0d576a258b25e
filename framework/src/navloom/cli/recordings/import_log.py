"""`navloom import`: a ROS bag as a recording, and what `navloom replay` makes of one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from navloom.cli.options import AsJson

__all__ = ["import_log", "replay_imported"]


def import_log(
    bag: Annotated[Path, typer.Argument(metavar="BAG", help="A .bag file, or the folder of a ROS 2 bag.")],
    out: Annotated[Path, typer.Option("--out", metavar="F.mcap", help="Recording to write.")],
    map_topic: Annotated[
        list[str] | None, typer.Option("--map-topic", metavar="TOPIC=NAME", help="Name of the sensor; repeats.")
    ] = None,
    mount: Annotated[
        list[str] | None,
        typer.Option("--mount", metavar="NAME=X,Y,YAW_DEG[,Z]", help="Where the bag has no transform; repeats."),
    ] = None,
    odom: Annotated[
        str | None, typer.Option("--odom", metavar="TOPIC", help="Odometry, where there are several.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Import a ROS 1 or ROS 2 bag: laser scans, ranges, point clouds, odometry and mounts; ROS stamps are kept."""
    from navloom.cli.output import print_json, print_table
    from navloom.recording.ros_import import import_bag

    names = dict(_assigned("--map-topic", text) for text in map_topic or ())
    mounts = {name: _mount(text) for name, text in (_assigned("--mount", one) for one in mount or ())}
    found = import_bag(bag, out, names, mounts, odom)
    span = (found.last_ns - found.first_ns) * 1e-9
    if as_json:
        print_json({"file": str(out), "seconds": span, "topics": [topic.to_json() for topic in found.topics]})
        return
    rows = [
        (topic.name, topic.type, topic.sensor or "-", topic.messages or "-", _why(topic.skipped))
        for topic in found.topics
    ]
    print_table(("topic", "type", "taken as", "messages", "skipped"), rows)
    typer.echo(f"{out}: {sum(topic.messages for topic in found.topics)} messages over {span:.1f} s")


def replay_imported(
    recording: Any,
    stand_ins: dict[str, str],
    changes: Sequence[str],
    out: Path | None,
    as_json: bool,
    map_ref: str | None = None,
    start: str | None = None,
) -> None:
    """`navloom replay` of an imported log: the plugins asked for on what it holds."""
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
    loaded = recording.header.loaded()
    if map_ref is not None or start is not None:
        loaded = place_in_map(recording, loaded, map_ref, None if start is None else _start(start))
    for role, name in stand_ins.items():
        loaded = substitute_config(loaded, role, name, changes)
    with OutFolder(out, ("result.json", "ticks.csv", "poses.csv", "avoider.png", "map.png", *MAP)) as folder:
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
    """result.json, a picture of the map, and an avoider's ticks."""
    import io

    from navloom.cli.output import json_bytes
    from navloom.recording.log_replay import DRIVER
    from navloom.recording.shadows import shadow_table
    from navloom.report.picture import draw_map_update
    from navloom.report.substitute_figure import draw_substitute

    files = {"result.json": json_bytes(summary)}
    if found.avoider is not None:
        files["ticks.csv"] = shadow_table([found.avoider.found]).encode()
        if draws:
            files["avoider.png"] = draw_substitute(found.avoider, DRIVER)
    if found.map is not None:
        picture = io.BytesIO()
        draw_map_update(found.map, found.way).save(picture, format="PNG")
        files["map.png"] = picture.getvalue()
    if found.poses is not None:
        files["poses.csv"] = found.pose_table().encode()
    return files


def _assigned(option: str, text: str) -> tuple[str, str]:
    from navloom.config import ConfigError

    name, equals, value = text.partition("=")
    if not (name and equals and value):
        raise ConfigError(f"{option} {text}: expected NAME=VALUE, as in {option} /scan=laser")
    return name, value


def _mount(text: str) -> Any:
    import numpy as np

    from navloom.config import ConfigError
    from navloom.recording.ros_frames import Mount, quaternion_matrix

    try:
        x, y, yaw_deg, *rest = (float(part) for part in text.split(","))
        (z,) = rest or [0.0]
        if not all(map(math.isfinite, (x, y, yaw_deg, z))):
            raise ValueError
    except ValueError:
        raise ConfigError(f"--mount …={text}: expected X,Y,YAW_DEG in m and degrees, and Z if it matters") from None
    half = math.radians(yaw_deg) / 2.0
    return Mount(quaternion_matrix(0.0, 0.0, math.sin(half), math.cos(half)), np.array([x, y, z]))


def _start(text: str) -> tuple[float, float, float]:
    from navloom.config import ConfigError

    try:
        x, y, heading_deg = (float(part) for part in text.split(","))
    except ValueError:
        x = y = heading_deg = math.nan
    if not all(map(math.isfinite, (x, y, heading_deg))):
        raise ConfigError(f"--start {text}: expected X,Y,HEADING_DEG in m and degrees, as in --start 1.5,0,90")
    return x, y, math.radians(heading_deg)


def _why(skipped: Any) -> str:
    said = (f"{count}: {reason}" if count else reason for reason, count in skipped.most_common(3))
    return "; ".join(said) or "-"

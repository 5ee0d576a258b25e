"""`navloom import`: converts a CARMEN log to a recording."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer
from navloom.cli import AsJson, MapOptions, a_number, seconds

__all__ = ["import_log"]


class Poses(StrEnum):
    """Source of the odometry."""

    odometry = "odometry"
    corrected = "corrected"
    none = "none"


def import_log(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="A CARMEN log, or one in gzip.")],
    out: Annotated[Path, typer.Option("--out", metavar="F.mcap", help="Recording to write.")],
    place: MapOptions,
    poses: Annotated[
        Poses, typer.Option("--poses", help="Raw odometry, the log's corrected poses, or none.")
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
    from navloom.cli import print_json, print_table
    from navloom_recording import late_note, mount_option

    from navloom_carmen.carmen_import import import_carmen

    mounts = {name: pose[:3] for name, pose in map(mount_option, mount or ())}
    start = place.pose()
    _refuse_bag(log)
    found = import_carmen(log, out, poses.value, period, range_max, mounts, place.map_, start)
    found.note = "; ".join(filter(None, [found.note, late_note(out)]))
    if as_json:
        print_json({"file": str(out), **found.to_json()})
        return
    rows: list[tuple[object, ...]] = [("odometry", found.odometry, "")]
    for name, count in found.scans.items():
        x, y, yaw_deg = found.to_json()["mounts"][name]
        rows.append((name, count, f"at {x:.3f}, {y:.3f} m, {yaw_deg:.1f}°"))
    rows += [("skipped", count, reason) for reason, count in found.skipped.most_common(5)]
    print_table(("", "messages", ""), rows)
    if found.note:
        typer.echo(found.note)
    taken = ", its poses corrected: odometry recovered" if found.is_corrected and poses is Poses.odometry else ""
    typer.echo(f"{out}: {(found.last_ns - found.first_ns) * 1e-9:.1f} s{taken}")


def _refuse_bag(path: Path) -> None:
    """Say which command reads ROS bags. Raises ConfigError."""
    from navloom.cli import added_commands
    from navloom.config import ConfigError

    if path.suffix not in (".bag", ".db3", ".mcap") and not path.is_dir():
        return
    is_there = any(point.name == "ros" for point in added_commands())
    first = "" if is_there else "install navloom-ros, then "
    raise ConfigError(f"{path}: a ROS bag? This command reads CARMEN logs; {first}use navloom ros import {path}")

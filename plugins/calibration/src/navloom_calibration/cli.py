"""`navloom calibrate`: how late each laser of a recorded drive is, and how its mount is turned."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from navloom.cli import AsJson

if TYPE_CHECKING:
    from navloom_calibration.measured import Measured
    from navloom_calibration.offset import Interval

__all__ = ["calibrate"]


def calibrate(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A recording, a CARMEN log, or a ROS bag.")],
    sensor: Annotated[str | None, typer.Option(metavar="NAME", help="This laser alone.")] = None,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Folder for a picture of each laser.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Measure how late each laser of a recorded drive is. It also finds the yaw of its mount.

    The drive should last a minute, with turns and straight ways between walls.
    """
    from navloom.cli import log_of, print_json, stage
    from navloom.runs import OutFolder

    from navloom_calibration.measured import measure
    from navloom_calibration.recorded import opened, read_drive

    results: list[dict[str, Any]] = []
    with OutFolder(out, ("*.png",)) as folder, stage(as_json) as (say, progress), opened(file, say) as recording:
        for note in filter(None, (recording.note, *recording.unknown())):
            log_of("calibration").info(note)
        say("reading")
        drive = read_drive(recording, sensor)
        tables = _tables(recording)
        for laser in drive.lasers:
            say(f"following {laser.name}")
            found = measure(laser.scans, drive.way, laser.mount, progress)
            results.append(_result(laser.name, len(laser.scans), found, tables.get(laser.name, {})))
            if out is not None and found.offset is not None:
                from navloom_calibration.picture import draw

                picture = draw(laser.name, laser.scans, drive.way, found.track, found.offset.offset.value)
                folder.write({f"{laser.name}.png": picture})
    if as_json:
        print_json({"file": str(file), "lasers": results})
    else:
        _tell(results)
        if folder.names:
            typer.echo(f"written to {out}: {', '.join(folder.names)}")
    raise typer.Exit(0 if any(one["time_offset"] for one in results) else 1)


def _tables(recording: Any) -> dict[str, dict[str, Any]]:
    """The tables of the recorded config's sensors, by name; none if it was not recorded or is of another version."""
    from navloom_recording import RecordingError

    try:
        return {table.name: table.model_dump() for table in recording.header.loaded().config.sensor}
    except RecordingError:
        return {}


def _result(name: str, count: int, found: Measured, table: dict[str, Any]) -> dict[str, Any]:
    """One laser, as `--json` prints it."""
    offset, yaw = found.offset, found.yaw
    return {
        "name": name,
        "scans": count,
        "seconds": found.seconds,
        "turned_deg": None if offset is None else math.degrees(offset.turn),
        "time_offset": None if offset is None else _interval(offset.offset),
        "configured_time_offset": table.get("time_offset", 0.0),
        "meaning": found.meaning or found.why_no_offset,
        "odometry_turns": None if offset is None else _interval(_inverse(offset.scale)),
        "mount_yaw_deg": None if yaw is None else _interval(yaw.yaw, math.degrees(1.0)),
        "mount_meaning": found.why_no_yaw or _mount_words(name, found, table),
    }


def _inverse(given: Interval) -> Interval:
    """The interval of 1 / x."""
    return type(given)(1.0 / given.value, 1.0 / given.high, 1.0 / max(1e-3, given.low))


def _interval(given: Interval, unit: float = 1.0) -> dict[str, float]:
    return {"value": unit * given.value, "low": unit * given.low, "high": unit * given.high}


def _mount_words(name: str, found: Measured, table: dict[str, Any]) -> str:
    """What to do about the mount."""
    assert found.yaw is not None
    yaw = found.yaw.yaw
    if yaw.low <= 0.0 <= yaw.high:
        return "its mount is right"
    more = math.degrees(yaw.value)
    if isinstance(was := table.get("heading_deg"), (int, float)):
        return f"heading_deg = {was + more:.1f}"
    mount = table.get("mount")
    if isinstance(mount, dict):
        place = f"x = {mount.get('x', 0.0):g}, y = {mount.get('y', 0.0):g}"
        return f"mount = {{ {place}, heading_deg = {mount.get('heading_deg', 0.0) + more:.1f} }}"
    return f"add {more:+.1f}° to the yaw of its mount"


def _tell(results: list[dict[str, Any]]) -> None:
    """Print the results for people, and the lines for the config."""
    from navloom_calibration.measured import EARLIEST

    lines: list[str] = []
    for one in results:
        typer.echo(f"{one['name']}: {one['scans']} scans over {one['seconds']:.1f} s")
        offset, yaw = one["time_offset"], one["mount_yaw_deg"]
        if offset is None:
            typer.echo(f"  time offset: {one['meaning']}")
        else:
            within = f"95 %: {offset['low']:+.3f} to {offset['high']:+.3f} s"
            typer.echo(f"  time offset {offset['value']:+.3f} s ({within}): {one['meaning']}")
            turns = one["odometry_turns"]
            if abs(turns["value"] - 1.0) > 0.02 and not turns["low"] <= 1.0 <= turns["high"]:
                typer.echo(f"  odometry reports {turns['value']:.3f} of each turn: check the track width")
        if yaw is None:
            typer.echo(f"  mount yaw: {one['mount_meaning']}")
        else:
            within = f"95 %: {yaw['low']:+.1f} to {yaw['high']:+.1f}°"
            typer.echo(f"  mount yaw {yaw['value']:+.1f}° ({within}): {one['mount_meaning']}")
        is_new = offset is not None and not offset["low"] <= one["configured_time_offset"] <= offset["high"]
        if is_new and offset["value"] <= EARLIEST:
            lines += ["", "[[sensor]]", f'name = "{one["name"]}"', f"time_offset = {offset['value']:.3f}"]
    if lines:
        typer.echo("\nin the config:" + "\n".join(lines))

"""`navloom record`: record the messages of a live robot."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated, Any

import typer
from navloom.cli.options import AsJson, PluginFiles, RobotOptions, a_number
from navloom.cli.output import LOG

__all__ = ["record"]

ROBOT_ABSENCE_LIMIT = 5.0
"""Longest absence of the robot before the recording ends, s."""


def record(
    out: Annotated[
        Path | None, typer.Option("--out", metavar="F.mcap", help="File to write; default REALM_NAME_DATE_TIME.mcap.")
    ] = None,
    only: Annotated[
        list[str] | None,
        typer.Option("--only", metavar="GLOB", help="Keys to keep, as 'platform/*/*'; repeats. Default: all."),
    ] = None,
    seconds: Annotated[
        float | None, typer.Option(metavar="S", min=0.1, help="End after S seconds.", callback=a_number)
    ] = None,
    plugin: PluginFiles = None,
    *,
    robot: RobotOptions,
    as_json: AsJson = False,
) -> None:
    """Record a live robot into one MCAP file, until Ctrl-C.

    It records every message, only reads, and never slows the robot.
    """
    from navloom.cli.interrupts import ending
    from navloom_recording.world_attachments import world_files
    from navloom_recording.writer import RecordingWriter

    from navloom_live.operating.live_recorder import LiveRecorder, ask_header

    with ending() as event, robot.look() as client:
        header = ask_header(client)
        path = out or Path(f"{header.realm}_{header.robot}_{time.strftime('%Y%m%d_%H%M%S')}.mcap")
        recorder = LiveRecorder(client, RecordingWriter(path, header, world_files(header.loaded())), only or ())
        began = time.monotonic()
        try:
            recorder.start()
            LOG.info(f"recording {header.prefix} to {path}")
            why = _stay(recorder, event, None if seconds is None else began + seconds)
        finally:
            recorder.stop()
    if why:
        LOG.warning(why)
    if recorder.failure:
        LOG.warning(recorder.failure)
    _tell(recorder, path, time.monotonic() - began, as_json)
    raise typer.Exit(1 if recorder.failure else 0)


def _stay(recorder: Any, event: Any, until: float | None) -> str:
    """Wait for the end. Returns the reason if the user did not request it."""
    heard = time.monotonic()
    while not event.wait(0.1) and not recorder.failure:
        recorder.look()
        now = time.monotonic()
        if until is not None and now >= until:
            break
        if recorder.client.bus.neighbours():
            heard = now
        elif now - heard > ROBOT_ABSENCE_LIMIT:
            return f"robot {recorder.client.keys.prefix} has gone"
    return ""


def _tell(recorder: Any, path: Path, seconds: float, as_json: bool) -> None:
    """Print what is in the file and what is missing."""
    from navloom.cli.output import print_json, print_table

    size = path.stat().st_size
    counts = recorder.counts.summary()
    if as_json:
        print_json({"file": str(path), "bytes": size, "seconds": seconds, "complete": not recorder.failure, **counts})
        return
    missed = {why: sum(counts[why].values()) for why in ("dropped", "lost", "malformed")}
    typer.echo(f"{path}: {counts['messages']} messages in {seconds:.1f} s, {size / 1e6:.2f} MB")
    rows = [(key, why, number) for why in missed for key, number in counts[why].items()]
    if rows:
        print_table(("stream", "not in it", "messages"), rows)
    else:
        typer.echo("dropped 0, lost 0, malformed 0")

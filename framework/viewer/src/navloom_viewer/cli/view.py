"""`navloom view`: shows a live robot or a recording."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from navloom.cli.options import AsJson, PluginFiles, RobotOptions, ViewerOptions, a_number
from navloom.cli.output import log_of, say_so
from navloom.parts import part

if TYPE_CHECKING:
    from navloom_viewer.viewer_session import Where

__all__ = ["view"]

ROBOT_ABSENCE_LIMIT = 5.0
"""Longest absence of the robot before the command ends, s."""


def view(
    file: Annotated[
        Path | None, typer.Argument(metavar="[FILE]", help="Recording (.mcap) or .rrd; default: the live robot.")
    ] = None,
    seconds: Annotated[
        float | None, typer.Option(metavar="S", min=0.1, help="End after S seconds.", callback=a_number)
    ] = None,
    foxglove: Annotated[
        bool, typer.Option("--foxglove", help="Serve the live robot to Foxglove or Lichtblick on this host.")
    ] = False,
    foxglove_port: Annotated[int, typer.Option(metavar="N", min=0, max=65535, help="With --foxglove.")] = 8765,
    plugin: PluginFiles = None,
    *,
    viewer: ViewerOptions,
    robot: RobotOptions,
    as_json: AsJson = False,
) -> None:
    """Show a live robot until Ctrl-C, or a recording.

    The viewer only reads: it cannot slow the robot, whatever happens to it.
    """
    from navloom_viewer.viewer_errors import ViewerError

    if file is not None and not file.is_file():
        raise ViewerError(f"{file}: there is no such file; expected a recording, as `navloom record` writes it")
    if foxglove:
        if file is not None:
            raise ViewerError("--foxglove shows a live robot; write a recording for it with `navloom ros export`")
        _foxglove(foxglove_port, seconds, robot)
        return
    is_kept = file is not None and file.suffix == ".rrd"
    where = viewer.where(viewer.viewer is None and viewer.rerun is None, keeps=not is_kept)
    if file is None:
        counts = _live(where, seconds, robot)
    else:
        counts = _file(file, where)
    if as_json:
        from navloom.cli.output import print_json

        print_json(vars(counts) if counts is not None else {})
    if viewer.rerun is not None and counts is not None and counts.file_failure:
        raise typer.Exit(1)


def _file(file: Path, where: Where) -> Any:
    from navloom_viewer.program import Program
    from navloom_viewer.viewer_errors import ViewerError
    from navloom_viewer.viewer_session import showing

    if file.suffix == ".rrd":
        if not where.opens:
            raise ViewerError(f"{file}: it is what a viewer shows already; leave out --viewer and --rerun")
        program = Program(where.web, [file.absolute()], where.options)
        program.await_window()
        program.leave(log_of("viewer").info)
        return None
    from navloom_recording.cli.replay import tell_reading
    from navloom_recording.reader import Recording

    from navloom_viewer.message_sources import facts_of_recording, recorded_messages

    with Recording(file) as recording:
        tell_reading(recording)
        facts = facts_of_recording(recording)
        with showing(
            facts, where, recording_id=f"{file.name}-{file.stat().st_size}", say=log_of("viewer").info
        ) as shown:
            for message in recorded_messages(recording, facts):
                shown.bridge.put_all(message)
    return shown.counts


def _live(where: Where, seconds: float | None, robot: RobotOptions) -> Any:
    from navloom.cli.interrupts import ending
    from navloom.messages.generic import GenericMessage

    from navloom_viewer.drawing_task import NICE
    from navloom_viewer.message_sources import facts_of_header, live_messages
    from navloom_viewer.viewer_session import showing

    os.nice(NICE)  # before the network's threads start: each thread has a priority of its own
    with ending() as event, robot.look() as client:
        header = part("navloom_live.operating.live_recorder", "a live robot").ask_header(client)
        facts = facts_of_header(header, header.prefix)
        limit = None if seconds is None else time.monotonic() + seconds
        identity = f"{header.prefix}-{time.time_ns()}"
        heard = time.monotonic()
        with showing(facts, where, recording_id=identity, live=True, say=log_of("viewer").info) as shown:
            say_so(f"showing {header.prefix}; Ctrl-C ends it")
            told: set[str] = set()
            for message in live_messages(client, facts):
                if message is not None:
                    if isinstance(message.message, GenericMessage) and message.message.why not in told:
                        told.add(message.message.why)
                        say_so(message.message.why)
                    shown.bridge.put(message)
                    continue
                now = time.monotonic()
                heard = now if client.bus.neighbours() else heard
                if event.is_set() or shown.is_closed or (limit is not None and now > limit):
                    break
                if now - heard > ROBOT_ABSENCE_LIMIT:
                    say_so(f"robot {header.prefix} has gone")
                    break
    return shown.counts


def _foxglove(port: int, seconds: float | None, robot: RobotOptions) -> None:
    from contextlib import closing

    from navloom.cli.interrupts import ending

    from navloom_viewer.foxglove import FoxgloveServer
    from navloom_viewer.message_sources import facts_of_header, live_messages

    with ending() as event, robot.look() as client:
        header = part("navloom_live.operating.live_recorder", "a live robot").ask_header(client)
        limit = None if seconds is None else time.monotonic() + seconds
        with closing(FoxgloveServer(header.prefix, "127.0.0.1", port)) as server:
            say_so(f"serving {header.prefix} at {server.address}; Ctrl-C ends it")
            for message in live_messages(client, facts_of_header(header, header.prefix)):
                if message is not None:
                    server.put(message)
                elif event.is_set() or (limit is not None and time.monotonic() > limit):
                    return

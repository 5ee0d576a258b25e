"""`navloom teleop`: manual driving of a live robot, through the gate and its limits."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated, Any

import typer
from navloom.cli.options import RobotOptions, a_number, seconds

from navloom_live.cli.operate import NUMBERS
from navloom_live.timing import TELEOP_INTERVAL

__all__ = ["teleop", "teleop_line"]

KEY_HOLD = 0.4
"""Time that a key press holds, s; terminals repeat keys faster than that."""
WAYS = {"w": (1.0, 0.0), "s": (-1.0, 0.0), "a": (0.0, 1.0), "d": (0.0, -1.0), "q": (1.0, 1.0), "e": (1.0, -1.0)}


@NUMBERS
def teleop(
    vx: Annotated[
        float | None, typer.Option(metavar="V", help="Speed forward, m/s, instead of keys.", callback=a_number)
    ] = None,
    wz: Annotated[
        float | None, typer.Option(metavar="W", help="Turn rate, deg/s, instead of keys.", callback=a_number)
    ] = None,
    vy: Annotated[
        float | None,
        typer.Option(
            metavar="V", help="Speed to the left of a holonomic robot, m/s, instead of keys.", callback=a_number
        ),
    ] = None,
    duration: Annotated[
        float, typer.Option("--for", metavar="S", help="s to drive with --vx, --vy and --wz.", callback=seconds)
    ] = 1.0,
    speed: Annotated[float, typer.Option(metavar="V", help="m/s of the keys w and s.", callback=a_number)] = 0.3,
    turn: Annotated[float, typer.Option(metavar="W", help="deg/s of the keys a and d.", callback=a_number)] = 20.0,
    into_unseen: Annotated[
        bool, typer.Option("--into-unseen", help="Let it drive where no sensor has looked, such as backwards.")
    ] = False,
    *,
    robot: RobotOptions,
) -> None:
    """Drive a live robot by hand, within the limits of the gate.

    Keys: w s a d; q and e drive curves; space stops; x ends.

    While teleop runs, nothing else drives. If it dies or its link breaks, the robot stops until `navloom resume`.
    The gate keeps it out of space that no sensor has seen, unless --into-unseen is given; `navloom status` says so.
    """
    from navloom_live.operating.teleoperation import Driver

    twist = (vx or 0.0, wz or 0.0, vy or 0.0) if {vx, wz, vy} != {None} else None
    if twist is None and not sys.stdin.isatty():
        raise typer.BadParameter("standard input is no terminal: give --vx, --wz and --for")
    with (
        robot.operate() as client,
        Driver(client, into_unseen) as driver,
        _line() as line,
    ):
        if twist is not None:
            limit = time.monotonic() + duration
            while time.monotonic() < limit:
                _send(driver, twist, line)
                time.sleep(TELEOP_INTERVAL)
            driver.send(0.0, 0.0)
            return
        typer.echo("w s a d drive, q e in curves, space stops, x ends")
        _by_keys(driver, speed, turn, line)


@contextmanager
def _line() -> Iterator[Any]:
    """The progress line; it is ended at the exit, so that an error begins on a new line."""
    from navloom_live.cli.live_line import LiveLine

    line = LiveLine(sys.stdout)
    try:
        yield line
    finally:
        line.end()


def _send(driver: Any, twist: tuple[float, ...], line: Any) -> None:
    driver.send(*twist)
    line.show(*teleop_line(driver.asked, driver.granted, driver.measured, driver.limit))


def teleop_line(asked: Any, granted: Any, measured: Any, limit: str) -> tuple[str, str]:
    """Line with the operator's command, the gate's command and the measured velocity, and its kind: see `LiveLine`."""
    slides = any(one.vy for one in (asked, granted, measured))
    ways = [f"{one.vx:+z.2f}{f', {one.vy:+z.2f}' if slides else ''}" for one in (asked, granted, measured)]
    first, *shown = (
        f"{way}{unit} {math.degrees(one.wz):+z.0f}"
        for way, one, unit in zip(ways, (asked, granted, measured), (" m/s", "", ""), strict=True)
    )
    text = f"asked {first} deg/s | gate {shown[0]} | robot {shown[1]}"
    return text + (f" | {limit}" if limit else ""), limit


def _by_keys(driver: Any, speed: float, turn: float, line: Any) -> None:
    way, pressed = (0.0, 0.0), 0.0
    with _raw_terminal():
        while True:
            key = _key(TELEOP_INTERVAL)
            if key in ("x", "\x03", "\x04"):
                return
            if key:
                way, pressed = WAYS.get(key, (0.0, 0.0)), time.monotonic()
            elif time.monotonic() - pressed > KEY_HOLD:
                way = (0.0, 0.0)
            _send(driver, (way[0] * speed, way[1] * turn), line)


def _key(timeout: float) -> str:
    """A key pressed within `timeout`, s, or an empty string."""
    import select

    ready, _, _ = select.select([sys.stdin], [], [], timeout)
    return sys.stdin.read(1) if ready else ""


@contextmanager
def _raw_terminal() -> Iterator[None]:
    import termios
    import tty

    before = termios.tcgetattr(sys.stdin)
    tty.setcbreak(sys.stdin)
    try:
        yield
    finally:
        termios.tcsetattr(sys.stdin, termios.TCSADRAIN, before)

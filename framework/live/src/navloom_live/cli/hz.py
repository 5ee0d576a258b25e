"""`navloom hz`: rate, jitter, age and losses of streams."""

from __future__ import annotations

from typing import Annotated, Any

import typer
from navloom.cli.options import AsJson, RobotOptions, seconds
from navloom.cli.output import LOG

__all__ = ["hz"]

COLUMNS = ("stream", "count", "Hz", "jitter\nms", "max\nms", "age50\nms", "age99\nms", "kB/s", "lost", "bad")
"""Heads of the table, short enough for 80 columns. Jitter and max are of the intervals; bad means malformed."""


def hz(
    key: Annotated[str, typer.Argument(metavar="KEY", help="role/port or role/instance/port, with * for any.")] = "*/*",
    duration: Annotated[
        float, typer.Option("--for", metavar="S", min=0.1, help="s to listen.", callback=seconds)
    ] = 3.0,
    *,
    robot: RobotOptions,
    as_json: AsJson = False,
) -> None:
    """Print rate, jitter, age and bandwidth of streams. Ages count from the platform's stamp a message derives from."""
    from navloom.cli.output import print_json, print_table

    from navloom_live.operating.introspection import resolve, streams
    from navloom_live.operating.robot_nodes import listing, run_clock_ns
    from navloom_live.operating.stream_measurement import measure

    with robot.look() as client:
        nodes = listing(client)
        names = resolve(key, nodes)
        odometry = [name for name in streams(nodes) if name.startswith("platform/") and name.endswith("/odometry")]
        has_clock = run_clock_ns(nodes) >= 0
        found = measure(client, names, odometry, duration, has_clock)
    if as_json:
        print_json(found)
        return
    rows = [_row(name, one) for name, one in found.items() if one["messages"] or one["malformed"]]
    if rows:
        print_table(COLUMNS, rows)
    if silent := [name for name, one in found.items() if not one["messages"] and not one["malformed"]]:
        typer.echo(f"nothing came on {', '.join(silent)}")
    for name, one in found.items():
        if one["malformed"]:
            LOG.warning(f"{name}: malformed messages: {one['complaint']}")


def _row(name: str, one: dict[str, Any]) -> tuple[Any, ...]:
    return (name, one["messages"], one["rate_hz"], _ms(one["jitter_std_s"]), _ms(one["interval_max_s"]),
            _ms(one["age_p50_s"]), _ms(one["age_p99_s"]), one["bytes_per_s"] / 1e3, one["lost"],
            one["malformed"])  # fmt: skip


def _ms(seconds: float | None) -> str | None:
    return None if seconds is None else f"{seconds * 1e3:.1f}"

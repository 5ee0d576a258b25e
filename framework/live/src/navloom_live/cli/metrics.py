"""`navloom metrics`: serves metrics of a live robot to Prometheus."""

from __future__ import annotations

from typing import Annotated

import typer
from navloom.cli.options import RobotOptions

__all__ = ["metrics"]


def metrics(
    bind: Annotated[
        str, typer.Option(metavar="ADDRESS", help="Address to listen on; beyond loopback, anyone can read it.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(metavar="N", min=0, max=65535, help="TCP port; 0 for a free one.")] = 9464,
    name: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Also answer to this host name; repeats.")
    ] = None,
    once: Annotated[bool, typer.Option("--once", help="Print the metrics once, and serve nothing.")] = False,
    *,
    robot: RobotOptions,
) -> None:
    """Serve a live robot's metrics to Prometheus, until Ctrl-C.

    Rates, ages, stops by reason, deadlines and processor time, at /metrics.
    """
    import contextlib

    from navloom_live.operating.metrics_server import MetricsServer

    address = (bind, 0 if once else port)
    with robot.look() as client, contextlib.closing(MetricsServer(client, address, name or ())) as server:
        if once:
            typer.echo(server.text(), nl=False)
            return
        typer.echo(server.url)
        with contextlib.suppress(KeyboardInterrupt):
            server.run()

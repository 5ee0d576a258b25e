"""Commands for live robots."""

from __future__ import annotations

from navloom.plugins.hooks import hookimpl
from navloom.plugins.registry import Registry

__all__ = ["COMMANDS", "navloom_register"]

COMMANDS = {
    "up": "navloom_live.cli.up:up",
    "down": "navloom_live.cli.up:down",
    "goal": "navloom_live.cli.operate:goal",
    "cancel": "navloom_live.cli.operate:cancel",
    "place": "navloom_live.cli.operate:place",
    "relocalise": "navloom_live.cli.operate:relocalise",
    "swap": "navloom_live.cli.operate:swap",
    "stop": "navloom_live.cli.operate:stop",
    "resume": "navloom_live.cli.operate:resume",
    "teleop": "navloom_live.cli.teleop:teleop",
    "list": "navloom_live.cli.listing:list_nodes",
    "status": "navloom_live.cli.status:status",
    "echo": "navloom_live.cli.echo:echo",
    "hz": "navloom_live.cli.hz:hz",
    "metrics": "navloom_live.cli.metrics:metrics",
    "doctor": "navloom_live.cli.doctor:doctor",
    "node": "navloom_live.cli.nodes:node",
    "router": "navloom_live.cli.nodes:router",
    "record": "navloom_live.cli.record:record",
    "params": "navloom_live.cli.operate:params",
    "keys": "navloom_live.cli.keys:app",
    "export": "navloom_live.cli.export:app",
}
"""Function or app of each command, imported when it is used. The README describes each in a line, for the help."""


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add the commands."""
    for name, reference in COMMANDS.items():
        registry.command(name, reference)

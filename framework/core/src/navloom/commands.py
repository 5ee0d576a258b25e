"""Commands of the core."""

from __future__ import annotations

from navloom.plugins.hooks import hookimpl
from navloom.plugins.registry import Registry

__all__ = ["COMMANDS", "navloom_register"]

COMMANDS = {
    "run": "navloom.cli.run:run",
    "plan": "navloom.cli.plan:plan",
    "plugins": "navloom.cli.describing.plugins:plugins",
    "messages": "navloom.cli.describing.messages:messages",
    "worlds": "navloom.cli.describing.worlds:worlds",
    "graph": "navloom.cli.describing.graph:graph",
    "config": "navloom.cli.describing.config:app",
}
"""Function or app of each command, imported when it is used. The README describes each in a line, for the help."""


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add the commands."""
    for name, reference in COMMANDS.items():
        registry.command(name, reference)

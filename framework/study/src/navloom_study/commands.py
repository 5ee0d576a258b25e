"""Commands of studies."""

from __future__ import annotations

from navloom.plugins.hooks import hookimpl
from navloom.plugins.registry import Registry

__all__ = ["COMMANDS", "navloom_register"]

COMMANDS = {
    "compare": "navloom_study.cli.compare:compare",
    "report": "navloom_study.cli.report:report",
    "results": "navloom_study.cli.results:app",
    "map": "navloom_study.cli.map:map_recording",
}
"""Function or app of each command, imported when it is used. The README describes each in a line, for the help."""


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add the commands."""
    for name, reference in COMMANDS.items():
        registry.command(name, reference)

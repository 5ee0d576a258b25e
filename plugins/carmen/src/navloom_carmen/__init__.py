"""Imports CARMEN logs: laser scans and odometry become a recording that can be replayed.

Begin with `carmen_import.py`; `carmen.py` reads the log line by line within bounds.
`carmen_timeline.py` recovers raw odometry from corrected poses and makes the times monotonic.
"""

from navloom import Registry, hookimpl


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add the command."""
    registry.command("import", "navloom_carmen.cli:import_log")

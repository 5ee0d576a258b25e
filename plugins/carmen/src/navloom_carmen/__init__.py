"""Imports CARMEN logs with laser scans and odometry: `navloom import`."""

from navloom import Registry, hookimpl


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add the command."""
    registry.command("import", "navloom_carmen.cli:import_log")

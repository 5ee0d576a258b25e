"""Operate live robots from a browser: the command `navloom dashboard`."""

from navloom import Registry, hookimpl

__all__: list[str] = []


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Register the command `dashboard`."""
    from navloom_dashboard.cli import dashboard

    registry.command("dashboard", dashboard)

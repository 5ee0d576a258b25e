"""Recoveries of stuck robots for navloom."""

from navloom import Registry, hookimpl


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add the recovery `retrace`."""
    from navloom_recoveries.adapter import Retrace

    registry.add(Retrace)

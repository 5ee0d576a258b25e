"""Recoveries of stuck robots for navloom."""

from navloom import Registry, hookimpl


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add the recoveries `retrace` and `look_around`."""
    from navloom_recoveries.adapter import LookAround, Retrace

    registry.add(Retrace)
    registry.add(LookAround)

"""Virtual force field on range sensors for navloom (Borenstein & Koren 1989)."""

from navloom import Registry, hookimpl


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add the avoider `vff`."""
    from navloom_vff.adapter import Vff

    registry.add(Vff)

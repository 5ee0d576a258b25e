"""Model predictive path integral control on range sensors for navloom (Williams et al. 2017)."""

from navloom import Registry, hookimpl


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add the avoider `mppi`."""
    from navloom_mppi.adapter import Mppi

    registry.add(Mppi)

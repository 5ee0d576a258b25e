"""Optimal reciprocal collision avoidance for navloom: steps of crowds, and an avoider (van den Berg et al. 2011)."""

from navloom import Registry, hookimpl


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add the avoider `orca`."""
    from navloom_orca.adapter import Orca

    registry.add(Orca)

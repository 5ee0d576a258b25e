"""Improved vector field histogram on sonars for navloom (Hoang et al. 2013)."""

from navloom import Registry, hookimpl


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add the avoider `improved_vfh`."""
    from navloom_improved_vfh.adapter import ImprovedVfh

    registry.add(ImprovedVfh)

"""A navloom mapper that publishes the map the framework hands in."""

from navloom import Registry, hookimpl


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add the mapper `known_map`."""
    from navloom_known_map.adapter import KnownMap

    registry.add(KnownMap)

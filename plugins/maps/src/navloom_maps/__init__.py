"""Maps and worlds of others: BARN's, MovingAI's, and those of ROS's map_server."""

from navloom import Registry, hookimpl

from navloom_maps.barn import barn_world
from navloom_maps.movingai import movingai_world
from navloom_maps.rosmap import rosmap_world
from navloom_maps.yaml_text import yaml_of

__all__ = ["SCHEMES", "barn_world", "movingai_world", "navloom_register", "rosmap_world", "yaml_of"]

SCHEMES = {"barn": barn_world, "movingai": movingai_world, "rosmap": rosmap_world}


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add the schemes."""
    for scheme, load in SCHEMES.items():
        registry.world_scheme(scheme, load)

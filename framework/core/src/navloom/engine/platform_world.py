"""The world of a platform that has its own simulator."""

from __future__ import annotations

from navloom.config import Loaded
from navloom.config.config_errors import Gathered
from navloom.engine.plugin_factory import blamed_on_part
from navloom.engine.plugin_instances import Part, find_parts
from navloom.geometry.world import World
from navloom.plugins import Discovery
from navloom.roles import Platform

__all__ = ["own_world", "world_of_platform"]


def own_world(loaded: Loaded, discovery: Discovery) -> World | None:
    """The own world of a config's platform; None if it has none or does not know it.

    Raises:
        ConfigError, PluginError: The platform is not known, or refuses its parameters or its scene.
    """
    problems = Gathered()
    parts = find_parts(loaded.config, discovery, problems)
    problems.refuse(loaded.error)
    return world_of_platform(parts["platform", loaded.config.platform.instance])


def world_of_platform(part: Part) -> World | None:
    """The own world of a platform's part; see `own_world`."""
    assert issubclass(part.cls, Platform)
    with blamed_on_part(part, "own_world"):
        world: World | None = part.cls.own_world(part.params)
        if world is not None and not isinstance(world, World):
            raise TypeError(f"it gives {type(world).__name__}, expected World or None")
    return world

"""Worlds of buildings: from map files of others (ROS map_server, MovingAI, BARN), and storeys drawn from a seed.

Begin with `rosmap.py`: a YAML file and an image, read and written as nav2_map_server does; `images.py` reads it.
`movingai.py`, `barn.py` and `dynabarn.py` read benchmark worlds, `people.py` recorded tracks; `floor.py` makes storeys,
`crowds.py` halls with people, and `fleets.py` halls for several robots.
They need pyyaml and pillow, which the core does not.
"""

from navloom import Registry, hookimpl

from navloom_maps.barn import barn_world
from navloom_maps.crowds import crowd_flow, crowd_world, people_flow_world
from navloom_maps.dynabarn import dynabarn_world
from navloom_maps.fleets import fleet_world
from navloom_maps.floor import DEVELOPMENT_SEEDS, TEST_SEEDS, Floor, floor_of, floor_world, lookalikes
from navloom_maps.movingai import movingai_world
from navloom_maps.people import people_world
from navloom_maps.rosmap import rosmap_world
from navloom_maps.yaml_text import yaml_of

__all__ = [
    "DEVELOPMENT_SEEDS", "Floor", "SCHEMES", "TEST_SEEDS", "barn_world", "crowd_flow", "crowd_world", "dynabarn_world",
    "fleet_world", "floor_of", "floor_world", "lookalikes", "movingai_world", "navloom_register", "people_flow_world",
    "people_world", "rosmap_world", "yaml_of",
]  # fmt: skip

SCHEMES = {
    "barn": barn_world,
    "crowd": crowd_world,
    "dynabarn": dynabarn_world,
    "fleet": fleet_world,
    "floor": floor_world,
    "movingai": movingai_world,
    "people": people_world,
    "people_flow": people_flow_world,
    "rosmap": rosmap_world,
}


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add the schemes and a world."""
    for scheme, load in SCHEMES.items():
        registry.world_scheme(scheme, load)
    registry.world("crowd_flow", crowd_flow)

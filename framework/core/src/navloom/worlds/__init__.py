"""The named worlds and the schemes that read worlds from files, as `toml:room.toml`.

Begin with `tomlfile.py`, the format of a world file, or `trial_worlds.py`, small worlds in a few lines each;
`moving_worlds.py` has those in which people walk, `actor_tables.py` the tables of what moves.
They enter by the entry points that strangers use; `world_errors.py` gives every fault its file and place.
Maps of ROS, MovingAI and BARN are read by the distribution `navloom-maps`.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from navloom.geometry.world import World
from navloom.misspelt import did_you_mean
from navloom.plugins.hooks import hookimpl
from navloom.plugins.registry import Registry
from navloom.worlds.moving_worlds import (
    blocked_door,
    child_behind_box,
    crossing,
    door_opens,
    group,
    oncoming,
    overtaking,
)
from navloom.worlds.paper_world import (
    paper_gates,
    paper_gates_blocked_b,
    paper_gates_blocked_bc,
    paper_gates_obstacle,
    paper_gates_open_a,
)
from navloom.worlds.rasters import length_of, raster_bounds, wall_height
from navloom.worlds.tomlfile import toml_world
from navloom.worlds.trial_worlds import clutter_world, corridor, crossing_person, door_world, doorway, empty, u_trap
from navloom.worlds.world_errors import WorldError, file_of, options_of, read_bytes, readable, seed_of

__all__ = [
    "SCHEMES", "WORLDS", "WorldError", "did_you_mean", "file_of", "length_of", "navloom_register", "options_of",
    "raster_bounds", "read_bytes", "readable", "seed_of", "wall_height",
]  # fmt: skip

WORLDS: dict[str, Callable[[], World]] = {
    make.__name__: make
    for make in (
        paper_gates,
        paper_gates_open_a,
        paper_gates_blocked_b,
        paper_gates_blocked_bc,
        paper_gates_obstacle,
        empty,
        corridor,
        crossing_person,
        doorway,
        u_trap,
        blocked_door,
        child_behind_box,
        crossing,
        door_opens,
        group,
        oncoming,
        overtaking,
    )
}
SCHEMES: dict[str, Callable[[str, Path], World]] = {
    "clutter": clutter_world,
    "door": door_world,
    "toml": toml_world,
}


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add every named world and scheme."""
    for name, make in WORLDS.items():
        registry.world(name, make)
    for scheme, load in SCHEMES.items():
        registry.world_scheme(scheme, load)

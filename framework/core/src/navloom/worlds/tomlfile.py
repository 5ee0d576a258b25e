"""World files, `.toml`:

```toml
bounds = [-5.0, -1.0, 5.0, 9.0]      # lowest x, lowest y, highest x, highest y, m; default: around everything
start = { x = 0.0, y = 0.0, heading_deg = 90.0 }
goal = { x = 0.0, y = 7.6 }
goal_tolerance = 0.2                 # m
time_limit = 120.0                   # s

[raster]
map = "office.yaml"                  # of map_server, relative to this file
unknown = "occupied"                 # or "free"
z = [0.0, 2.4]                       # height the walls cover, m

[[box]]
name = "cupboard"
x = [1.0, 1.6]                       # before the turn, m
y = [2.0, 2.4]
z = [0.0, 1.8]                       # default 0 to 2.4
yaw_deg = 30.0                       # about its centre
is_mapped = false                    # a map of the world does not show it; default true

[[box]]
name = "glass wall"
x = [3.0, 3.1]
y = [0.0, 4.0]
material = "glass"                   # lasers see what is behind it, sonars see it; default "solid"

[[cylinder]]
name = "person"
x = 0.5
y = 3.0
radius = 0.25
appears_at = 5.0                     # s; or appears = "after_sweep"
waypoints = [[5.0, 0.5, 3.0], [9.0, 2.5, 3.0]]   # time, x, y of the centre
loops = true
```

A fleet takes a start and a goal for each of its robots from tables `[[task]]`:

```toml
[[task]]
start = { x = 0.0, y = 0.0, heading_deg = 90.0 }
goal = { x = 0.0, y = 7.6 }
```

What moves by itself is better an `[[actor]]`: see `actor_tables`.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import chain
from pathlib import Path
from typing import Any, TypeVar, get_args

from navloom.geometry.actors import Actor
from navloom.geometry.solids import box_corners
from navloom.geometry.world import Box, Cylinder, Interval, Material, Obstacle, Place, Raster, World
from navloom.inputs.bounds import TEXT_MB
from navloom.inputs.texts import toml_of
from navloom.parts import part
from navloom.worlds.actor_tables import ACTOR_KEYS, actor_of, waypoints_of
from navloom.worlds.rasters import raster_bounds
from navloom.worlds.toml_table import FileTable
from navloom.worlds.world_errors import WorldError, file_of, read_bytes

__all__ = ["toml_world"]

T = TypeVar("T")
_MARGIN = 1.0
_TALL: Interval = (0.0, 2.4)
_WORLD_KEYS = ("bounds", "start", "goal", "goal_tolerance", "time_limit", "raster", "box", "cylinder", "actor",
               "task")  # fmt: skip
_COMMON_KEYS = ("name", "x", "y", "z", "appears_at", "appears", "waypoints", "loops", "is_mapped", "material")
_BOX_KEYS = (*_COMMON_KEYS, "yaw_deg")
_CYLINDER_KEYS = (*_COMMON_KEYS, "radius")


def toml_world(argument: str, base: Path) -> World:
    """World scheme `toml:F.toml`, also for references that end in `.toml`.

    Raises:
        WorldError: The file or a map it names is missing or damaged, or a key is unknown, missing or wrong.
    """
    path = file_of(argument, base)
    try:
        text = read_bytes(path, TEXT_MB).decode("utf-8")
    except UnicodeDecodeError as error:
        raise WorldError(f"{path}: not TOML: {error}") from None
    content = toml_of(text, str(path), WorldError)
    table = FileTable(path, "", content, _WORLD_KEYS)
    boxes = _each(table, "box", _BOX_KEYS, _box)
    cylinders = _each(table, "cylinder", _CYLINDER_KEYS, _cylinder)
    obstacles: tuple[Obstacle, ...] = (*boxes, *cylinders)
    actors = _each(table, "actor", ACTOR_KEYS, actor_of)
    names: set[str] = set()
    for name in [*(obstacle.name for obstacle in obstacles), *(actor.name for actor in actors)]:
        if name in names:
            raise table.error(f"two obstacles are named {name!r}: rename one of them")
        names.add(name)
    raster = _raster(table) if "raster" in table else None
    start, goal = _place(table, "start"), _place(table, "goal")
    tasks = _each(table, "task", ("start", "goal"), _task)
    return World(
        argument,
        obstacles,
        raster,
        start,
        goal,
        _bounds(table, obstacles, actors, raster, [p for p in (start, goal, *chain(*tasks)) if p is not None]),
        table.number("goal_tolerance", least=0.0) if "goal_tolerance" in table else None,
        table.number("time_limit", least=0.0) if "time_limit" in table else None,
        actors=tuple(actors),
        tasks=tuple(tasks),
    )


def _task(table: FileTable, name: str) -> tuple[Place, Place]:
    start, goal = _place(table, "start"), _place(table, "goal")
    if start is None or goal is None:
        raise table.error("expected start and goal, as in start = { x = 0.0, y = 0.0 }")
    return start, goal


def _each(table: FileTable, key: str, known: tuple[str, ...], make: Callable[[FileTable, str], T]) -> list[T]:
    entries = table.value(key) if key in table else []
    if not isinstance(entries, list):
        raise table.error(f"{key}: expected [[{key}]], with double brackets")
    return [
        make(FileTable(table.path, f"[[{key}]] {number}", entry, known), f"{key} {number}")
        for number, entry in enumerate(entries, start=1)
    ]


def _box(table: FileTable, name: str) -> Box:
    return Box(
        table.text("name", name),
        table.interval("x"),
        table.interval("y"),
        table.interval("z", _TALL),
        table.heading("yaw_deg"),
        **_common(table),
    )


def _cylinder(table: FileTable, name: str) -> Cylinder:
    radius = table.number("radius")
    if not radius > 0.0:
        raise table.error(f"radius = {radius:g}, expected a length > 0 in metres")
    return Cylinder(
        table.text("name", name),
        table.number("x"),
        table.number("y"),
        radius,
        table.interval("z", _TALL),
        **_common(table),
    )


def _common(table: FileTable) -> dict[str, Any]:
    """When an obstacle appears, how it moves, whether a map shows it, and what it is made of."""
    after_sweep = table.choice("appears", ("at_start", "after_sweep")) == "after_sweep"
    if after_sweep and "appears_at" in table:
        raise table.error('appears_at and appears = "after_sweep" exclude each other: leave one out')
    waypoints = waypoints_of(table) if "waypoints" in table else ()
    if waypoints and after_sweep:
        raise table.error('waypoints and appears = "after_sweep" exclude each other: take appears_at')
    loops = table.flag("loops")
    # The last time is the loop's period: run time is taken modulo it.
    if loops and not (waypoints and waypoints[-1][0] > 0.0):
        raise table.error("loops = true, expected waypoints that end after 0 s beside it")
    return {
        "appears_at": table.number("appears_at", 0.0, least=0.0),
        "appears_after_sweep": after_sweep,
        "waypoints": waypoints,
        "loops": loops,
        "is_mapped": table.flag("is_mapped", default=True),
        "material": table.choice("material", get_args(Material)),
    }


def _place(table: FileTable, key: str) -> Place | None:
    if key not in table:
        return None
    place = FileTable(table.path, key, table.value(key), ("x", "y", "heading_deg"))
    return Place(place.number("x"), place.number("y"), place.heading("heading_deg"))


def _raster(table: FileTable) -> Raster:
    raster = FileTable(table.path, "[raster]", table.value("raster"), ("map", "unknown", "z"))
    image = file_of(raster.text("map"), table.path.parent)
    # By name: the core imports no plugin, and worlds without a raster need none.
    loaded: Raster = part("navloom_maps.rosmap", f"{table.path}: [raster]").load_raster(
        image, raster.choice("unknown", ("occupied", "free")), raster.interval("z", _TALL)
    )
    return loaded


def _bounds(
    table: FileTable,
    obstacles: tuple[Obstacle, ...],
    actors: list[Actor],
    raster: Raster | None,
    places: list[Place],
) -> tuple[float, float, float, float]:
    """The given bounds, or those of everything in the world with a margin of 1 m."""
    if "bounds" in table:
        x0, y0, x1, y1 = table.numbers("bounds", "[lowest x, lowest y, highest x, highest y]")
        if not (x0 < x1 and y0 < y1):
            given = [x0, y0, x1, y1]
            raise table.error(f"bounds = {given}, expected [lowest x, lowest y, highest x, highest y]")
        return x0, y0, x1, y1
    points = [(p.x, p.y) for p in places]
    for actor in actors:
        points += actor.places
    for obstacle in obstacles:
        points += [(x, y) for _, x, y in obstacle.waypoints]
        if isinstance(obstacle, Box):
            points += [(x, y) for x, y in box_corners(obstacle).tolist()]
        else:
            r = obstacle.radius
            points += [(obstacle.x - r, obstacle.y - r), (obstacle.x + r, obstacle.y + r)]
    if raster is not None:
        x0, y0, x1, y1 = raster_bounds(raster)
        points += [(x0, y0), (x1, y1)]
    if not points:
        return World.bounds
    xs, ys = [x for x, _ in points], [y for _, y in points]
    return min(xs) - _MARGIN, min(ys) - _MARGIN, max(xs) + _MARGIN, max(ys) + _MARGIN

"""Scenes of the localisation campaign: places on maps, what stands there unmapped, disturbances, and their configs."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from navloom.geometry.grid import GridMap
from navloom.geometry.world import Box, Cylinder, Obstacle, Place, Raster, World
from navloom.plugins import Discovery
from navloom.runs.map_files import rosmap_files
from navloom_astar.grids import RasterMap
from navloom_astar.planning import Found, GridPlanner, Settings
from navloom_maps.floor import floor_of, lookalikes
from numpy.typing import NDArray
from scipy import ndimage

__all__ = ["AT", "CARRIED", "PARTS", "Scene", "Task", "alike", "coverage", "ground_of", "scene_of"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

PARTS = ("global", "wrong_start", "kidnapped", "unmapped", "turn", "spin", "drag", "aisle")
CLEAR = 0.5
"""Least distance of starts and goals from walls, m: the robot is a square of 0.5 m."""
PASSABLE = 0.45
"""Radius for which ways are planned, m."""
WAYS = (6.0, 20.0)
"""Shortest and longest way from start to goal, m."""
AT = 8.0
"""When a disturbance begins, s: the robot drives."""
CARRIED = 2.0
"""Time for which the robot is carried or dragged off, or its wheels spin, s."""
VIEW = 8.0
"""Range within which the covered share of the view is counted, m."""


@dataclass(frozen=True)
class Task:
    """One drive: part of the campaign, name of the map, and a number that seeds all that is drawn."""

    part: str
    map: str
    number: int

    @property
    def key(self) -> str:
        """Its name in a file of results."""
        return f"{self.part} {self.map} {self.number}"


@dataclass(frozen=True, eq=False)
class Scene:
    """A drive of the campaign.

    Attributes:
        changes: Changes of the shipped config `building`.
        start: True start.
        end: Where it is carried to, for `kidnapped`.
        covered: Largest share of the view that unmapped things cover on the way.
    """

    changes: list[str]
    start: Place
    end: Place | None = None
    covered: float = 0.0


@dataclass(frozen=True, eq=False)
class _Ground:
    """Where the robot may stand on a map.

    Attributes:
        world: The world. free: (rows, columns) cells without a wall. room: (rows, columns) distance to a wall, m.
        places: (n, 2) row, column of cells from which all others can be reached.
    """

    world: World
    free: Bools
    room: Floats
    places: NDArray[np.int64]

    def at(self, cell: NDArray[np.int64]) -> tuple[float, float]:
        """Centre of a cell, m, map frame."""
        raster = self.world.raster
        assert raster is not None
        y, x = ((cell + 0.5) * raster.resolution).tolist()
        return x + raster.origin.x, y + raster.origin.y

    def room_at(self, x: float, y: float) -> float:
        """Distance of a place from the nearest wall, m; 0 off the map."""
        raster = self.world.raster
        assert raster is not None
        column, row = int((x - raster.origin.x) / raster.resolution), int((y - raster.origin.y) / raster.resolution)
        inside = 0 <= row < self.free.shape[0] and 0 <= column < self.free.shape[1]
        return float(self.room[row, column]) if inside else 0.0


def scene_of(task: Task, folder: Path) -> Scene:
    """The scene of a task; its files are written to a folder."""
    draw = np.random.default_rng((PARTS.index(task.part), *task.map.encode(), task.number))
    ground = _aisles(folder, draw) if task.part == "aisle" else _ground(_reference(task.map))
    start, way = _drive(ground, draw)
    end = way[-1]
    changes = [
        f"run.seed={task.number}", "run.stop_after=120.0", f'world.ref="{ground.world.name}"',
        f"world.start={_table(start)}", f"navigation.start={_table(start)}",
        f"navigation.goal={{ x = {end[0]:.4f}, y = {end[1]:.4f} }}",
    ]  # fmt: skip
    scene = Scene(changes, start)
    if task.part == "global":
        return replace(scene, changes=[*changes, 'navigation.start="unknown"'])
    if task.part == "wrong_start":
        return replace(scene, changes=[*changes, f"navigation.start={_table(_wrong(start, ground, draw))}"])
    if task.part == "kidnapped":
        place = _elsewhere(ground, way, draw)
        event = f'{{ at = {AT}, do = "displace", over = {CARRIED}, x = {place.x:.4f}, y = {place.y:.4f}, '
        return replace(scene, changes=[*changes, f"event=[{event}heading_deg = {_degrees(place)} }}]"], end=place)
    if task.part == "unmapped":
        return _unmapped(scene, ground, way, folder, draw)
    events = {
        "turn": f'do = "slip", by = {{ heading_deg = {draw.choice([-1.0, 1.0]) * draw.uniform(12.0, 30.0):.2f} }}',
        "spin": f'do = "slip", over = {CARRIED}',
        "drag": f'do = "displace", over = {CARRIED}, by = {{ x = -1.3 }}',
    }
    if task.part == "aisle":
        laser = 'name = "laser", kind = "laser_2d", beams = 271, field_of_view_deg = 270.0, range_max = 8.0'
        changes = [*changes, f"sensor=[{{ {laser}, sigma = 0.03 }}]"]
    if task.part in events:
        changes = [*changes, f"event=[{{ at = {AT}, {events[task.part]} }}]"]
    return replace(scene, changes=changes)


def alike(task: Task, pose: Place) -> tuple[Place, ...]:
    """Poses of a storey's look-alike rooms from which it looks the same."""
    name, _, argument = task.map.partition(":")
    return lookalikes(floor_of(argument), pose) if name == "floor" else ()


def _reference(name: str) -> str:
    files = {"willow": "willow_full_0.1", "house": "aws_small_house"}
    if name not in files:
        return name
    data = os.environ.get("NAVLOOM_DATA")
    if not data:
        raise SystemExit(f"map {name}: set NAVLOOM_DATA to the folder that holds rosmaps/{files[name]}.yaml")
    return f"rosmap:{Path(data).resolve()}/rosmaps/{files[name]}.yaml"


@cache
def _ground(reference: str) -> _Ground:
    return ground_of(Discovery().world(reference, Path.cwd()))


def ground_of(world: World) -> _Ground:
    """Where the robot may stand in a world."""
    raster = world.raster
    assert raster is not None
    free = ~raster.occupied
    for solid in world.obstacles:
        free &= ~_cells_of(solid, raster)
    room = ndimage.distance_transform_edt(free) * raster.resolution
    parts, _ = ndimage.label(room > PASSABLE)
    largest = 1 + int(np.argmax(np.bincount(parts.ravel())[1:]))
    return _Ground(world, free, room, np.argwhere((parts == largest) & (room > CLEAR)))


def _cells_of(solid: Obstacle, raster: Raster) -> Bools:
    """(rows, columns) cells of a raster without a turn that an obstacle covers where it begins."""
    found = np.zeros(raster.occupied.shape, dtype=np.bool_)
    (x, y), cell, origin = solid.centre, raster.resolution, raster.origin
    sides = (solid.x, solid.y) if isinstance(solid, Box) else ((-solid.radius, solid.radius),) * 2
    long, wide = (0.5 * (high - low) for low, high in sides)
    reach = math.hypot(long, wide) + cell
    rows, columns = (
        slice(max(0, int((at - reach) / cell)), max(0, int((at + reach) / cell) + 1))
        for at in (y - origin.y, x - origin.x)
    )
    row, column = np.indices(found[rows, columns].shape)
    dx = (column + columns.start + 0.5) * cell + origin.x - x
    dy = (row + rows.start + 0.5) * cell + origin.y - y
    if isinstance(solid, Cylinder):
        found[rows, columns] = np.hypot(dx, dy) <= solid.radius
        return found
    c, s = math.cos(solid.yaw), math.sin(solid.yaw)
    found[rows, columns] = (np.abs(c * dx + s * dy) <= long) & (np.abs(c * dy - s * dx) <= wide)
    return found


def _drive(ground: _Ground, draw: np.random.Generator) -> tuple[Place, Floats]:
    """A start with any heading, and a way of fitting length from it to a goal, (200, 2) m, map frame."""
    while True:
        first, last = (ground.at(cell) for cell in draw.choice(ground.places, 2, axis=0))
        if WAYS[0] <= math.dist(first, last) <= WAYS[1]:
            way = _way(ground, first, last)
            if way is not None and WAYS[0] <= _length(way) <= WAYS[1]:
                heading = float(draw.uniform(-math.pi, math.pi))
                return Place(*first, heading), _along(way, np.linspace(0.0, _length(way), 200))[:, :2]


def _way(ground: _Ground, first: tuple[float, float], last: tuple[float, float]) -> Floats | None:
    raster = ground.world.raster
    assert raster is not None
    cells = np.where(ground.free, 0, 100).astype(np.int8)
    planner = GridPlanner(Settings(source="cells", inflation="metres", radius=PASSABLE, escape=0.0), None)
    frame = (raster.origin.x, raster.origin.y, raster.origin.heading)
    found = planner.plan(first, last, np.empty((0, 4)), RasterMap(cells, raster.resolution, frame))
    return found.points if isinstance(found, Found) else None


def _length(way: Floats) -> float:
    return float(np.hypot(*np.diff(way, axis=0).T).sum())


def _wrong(start: Place, ground: _Ground, draw: np.random.Generator) -> Place:
    """A free place 1 m from a start, with a heading that is wrong by 30 degrees."""
    turn = math.radians(30.0) * float(draw.choice([-1.0, 1.0]))
    while True:
        bearing = float(draw.uniform(-math.pi, math.pi))
        between = [(start.x + s * math.cos(bearing), start.y + s * math.sin(bearing)) for s in (0.25, 0.5, 0.75, 1.0)]
        if all(ground.room_at(*place) > 0.25 for place in between):
            return Place(*between[-1], math.remainder(start.heading + turn, math.tau))
        turn *= draw.choice([-1.0, 1.0])


def _elsewhere(ground: _Ground, way: Floats, draw: np.random.Generator) -> Place:
    """A place at least 2 m from the whole way, with any heading."""
    while True:
        x, y = ground.at(draw.choice(ground.places))
        if np.hypot(way[:, 0] - x, way[:, 1] - y).min() > 2.5:
            return Place(x, y, float(draw.uniform(-math.pi, math.pi)))


# --- what is not on the map -------------------------------------------------------------------------------------------


def _unmapped(scene: Scene, ground: _Ground, way: Floats, folder: Path, draw: np.random.Generator) -> Scene:
    """The scene with pallets, trolleys and people beside the way, until they cover a drawn share of some view."""
    raster = ground.world.raster
    assert raster is not None
    wanted, things, covered = float(draw.uniform(0.3, 0.7)), list[Obstacle](), 0.0
    cells, views = np.zeros(ground.free.shape, dtype=np.bool_), _along(way, np.arange(0.0, _length(way), 1.0))
    for number in range(60):
        thing = _thing(number, way, ground, draw)
        if thing is None:
            continue
        more = cells | _cells_of(thing, raster)
        now = coverage(ground, more, views)
        if now <= 0.7:
            things, cells, covered = [*things, thing], more, now
        if covered >= wanted:
            break
    changes = [*scene.changes, f'world.ref="{_written(ground.world, things, folder)}"']
    return replace(scene, changes=changes, covered=covered)


def _thing(number: int, way: Floats, ground: _Ground, draw: np.random.Generator) -> Obstacle | None:
    """A pallet or a trolley beside the way, or a person who walks to and fro beside it; None if it does not fit."""
    at, kind = _along(way, np.array([draw.uniform(0.0, _length(way))]))[0], draw.choice(["pallet", "trolley", "person"])
    yaw, name = float(at[2]), f"{kind} {number}"
    long, wide = {"pallet": (0.6, 0.4), "trolley": (0.35, 0.25), "person": (0.25, 0.25)}[kind]
    off = float(draw.choice([-1.0, 1.0]) * (PASSABLE + wide + draw.uniform(0.05, 0.6)))
    x, y = float(at[0] - off * math.sin(yaw)), float(at[1] + off * math.cos(yaw))
    step, speed = float(draw.uniform(0.5, 2.0)), float(draw.uniform(0.3, 1.0))
    ends = [(x, y)]
    if kind == "person":
        ends.append((x + step * math.cos(yaw), y + step * math.sin(yaw)))
    if any(_apart(way, end, long, wide, yaw) < PASSABLE or ground.room_at(*end) < 0.05 for end in ends):
        return None
    if kind != "person":
        return Box(name, (x - long, x + long), (y - wide, y + wide), yaw=yaw, is_mapped=False)
    time = step / speed
    waypoints = ((0.0, *ends[0]), (time, *ends[1]), (2.0 * time, *ends[0]))
    return Cylinder(name, x, y, long, waypoints=waypoints, loops=True, is_mapped=False)


def _apart(way: Floats, middle: tuple[float, float], long: float, wide: float, yaw: float) -> float:
    """Least distance of (n, 2) points from a box of these half sides, m."""
    x, y = (way - middle).T
    along, across = x * math.cos(yaw) + y * math.sin(yaw), y * math.cos(yaw) - x * math.sin(yaw)
    return float(np.hypot(np.maximum(np.abs(along) - long, 0.0), np.maximum(np.abs(across) - wide, 0.0)).min())


def _along(way: Floats, arcs: Floats) -> Floats:
    """(k, 3) poses on a way at arc lengths, m."""
    steps = np.diff(way, axis=0)
    along = np.concatenate([[0.0], np.cumsum(np.hypot(steps[:, 0], steps[:, 1]))])
    x, y = (np.interp(arcs, along, way[:, axis]) for axis in (0, 1))
    part = np.clip(np.searchsorted(along, arcs, side="right") - 1, 0, len(steps) - 1)
    return np.column_stack([x, y, np.arctan2(steps[part, 1], steps[part, 0])])


def coverage(ground: _Ground, things: Bools, views: Floats) -> float:
    """Largest share of a laser's view of 270 degrees, within `VIEW`, that things hide, over (k, 3) poses."""
    raster = ground.world.raster
    assert raster is not None
    bearings, ranges = np.radians(np.linspace(-135.0, 135.0, 91)), np.arange(0.3, VIEW, raster.resolution)
    worst = 0.0
    for x, y, heading in views.tolist():
        ends_x = x + np.cos(heading + bearings)[:, None] * ranges - raster.origin.x
        ends_y = y + np.sin(heading + bearings)[:, None] * ranges - raster.origin.y
        rows = np.clip((ends_y / raster.resolution).astype(int), 0, things.shape[0] - 1)
        columns = np.clip((ends_x / raster.resolution).astype(int), 0, things.shape[1] - 1)
        hidden, walls = (_first(cells[rows, columns]) for cells in (things, ~ground.free))
        worst = max(worst, float((hidden < walls).mean()))
    return worst


def _first(hits: Bools) -> NDArray[np.int64]:
    """(n,) index of the first hit of each beam; the number of steps for none."""
    return np.where(hits.any(axis=1), hits.argmax(axis=1), hits.shape[1])


def _written(world: World, things: Sequence[Obstacle], folder: Path) -> str:
    """Write a world file of a world with further things; its name."""
    raster = world.raster
    assert raster is not None
    cells = np.where(raster.occupied, 100, 0).astype(np.int8)
    if raster.unknown is not None:
        cells[raster.unknown] = -1
    for name, content in rosmap_files(GridMap(cells, raster.resolution, raster.origin), "map").items():
        (folder / name).write_bytes(content)
    tables = "".join(_solid_table(solid) for solid in (*world.obstacles, *things))
    (folder / "world.toml").write_text(f'[raster]\nmap = "map.yaml"\n{tables}', "utf-8")
    return str(folder / "world.toml")


def _solid_table(solid: Obstacle) -> str:
    kind = "box" if isinstance(solid, Box) else "cylinder"
    keys: dict[str, Any] = {"name": solid.name, "z": list(solid.z), "material": solid.material}
    if isinstance(solid, Box):
        keys |= {"x": list(solid.x), "y": list(solid.y), "yaw_deg": math.degrees(solid.yaw)}
    else:
        keys |= {"x": solid.x, "y": solid.y, "radius": solid.radius}
    if solid.waypoints:
        keys |= {"waypoints": [list(point) for point in solid.waypoints], "loops": solid.loops}
    keys["is_mapped"] = solid.is_mapped
    # JSON of numbers, texts, booleans and their lists is TOML too.
    return f"[[{kind}]]\n" + "".join(f"{key} = {json.dumps(value)}\n" for key, value in keys.items())


def _aisles(folder: Path, draw: np.random.Generator) -> _Ground:
    """Bare aisles of 2 m between racks of 24 m, with a way round at each end: along them a laser sees two lines."""
    cell = 0.05
    occupied = np.ones((round(15.0 / cell), round(30.0 / cell)), dtype=np.bool_)
    occupied[2:-2, 2:-2] = False
    for low in np.arange(2.1, 13.0, 3.1):
        occupied[round(low / cell) : round((low + 1.0) / cell), round(3.0 / cell) : round(27.0 / cell)] = True
    # Something tells the two ends, and the aisles' ends, apart.
    occupied[round(float(draw.uniform(1.0, 13.0)) / cell) :][:12, 2:10] = True
    cells = np.where(occupied, 100, 0).astype(np.int8)
    for name, content in rosmap_files(GridMap(cells, cell, Place(0.0, 0.0)), "map").items():
        (folder / name).write_bytes(content)
    return ground_of(Discovery().world(f"rosmap:{folder / 'map.yaml'}", folder))


def _table(place: Place) -> str:
    return f"{{ x = {place.x:.4f}, y = {place.y:.4f}, heading_deg = {_degrees(place)} }}"


def _degrees(place: Place) -> str:
    return f"{math.degrees(place.heading):.3f}"

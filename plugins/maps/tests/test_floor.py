"""Storeys from a seed: `floor:SEED`."""

from __future__ import annotations

import hashlib
import math
from pathlib import Path

import numpy as np
import pytest
from navloom.engine.build import grid_of
from navloom.geometry.collision import clearance
from navloom.geometry.footprints import rectangle
from navloom.geometry.grid import world_to_grid
from navloom.geometry.world import Box, Place, World
from navloom.testing import cast
from navloom.worlds import WorldError
from navloom_maps.floor import DEVELOPMENT_SEEDS, TEST_SEEDS, Floor, floor_of, floor_world, lookalikes
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, label

ROBOT = rectangle(0.5, 0.5)


def free_places(world: World, radius: float) -> NDArray[np.bool_]:
    """Cells of 0.05 m in which the middle of a disc may be, unmapped furniture and glass included."""
    cells = world_to_grid(world, 0.05, (0.0, 0.6)).cells > 0
    return np.asarray(distance_transform_edt(~cells) * 0.05 > radius + 0.05)


def behind_doors(floor: Floor) -> list[tuple[int, int]]:
    """Row and column of the cell 0.8 m behind each door."""
    places = [(room.door.x, room.door.y + (0.8 if room.up else -0.8)) for room in floor.rooms]
    return [(int(y / 0.05), int(x / 0.05)) for x, y in places]


@pytest.mark.parametrize("options", ["", "?furniture=1&glass=1&unmapped=1", "?lookalike=1&size=40x12", "?size=12x9"])
def test_a_robot_of_half_a_metre_reaches_every_room(options: str) -> None:
    for seed in range(50):
        floor = floor_of(f"{seed}{options}")
        # Half a diagonal: the robot may turn anywhere on its way.
        areas, _ = label(free_places(floor.world, 0.354))
        assert {areas[place] for place in behind_doors(floor)} == {areas[behind_doors(floor)[0]]} - {0}, seed


def test_start_and_goal_are_free_and_far_apart() -> None:
    for seed in range(50):
        world = floor_of(f"{seed}?furniture=1").world
        assert world.start is not None and world.goal is not None
        for place in (world.start, world.goal):
            assert clearance(ROBOT, place, world, height=0.6)[0] >= 0.1
        assert math.hypot(world.start.x - world.goal.x, world.start.y - world.goal.y) > 15.0


def test_a_seed_is_the_same_storey_on_every_machine() -> None:
    world = floor_world("7?furniture=0.2&lookalike=0.5&glass=0.3", Path())
    boxes = [f"{o.name} {o.centre[0]:.3f} {o.centre[1]:.3f} {o.is_mapped}" for o in world.obstacles]
    assert world.raster is not None
    content = np.packbits(world.raster.occupied).tobytes() + "\n".join(boxes).encode()
    assert hashlib.sha256(content).hexdigest()[:16] == "35d0228b80da5a54"


def test_another_seed_is_another_storey() -> None:
    assert floor_of("7").world.start != floor_of("8").world.start


def test_furniture_and_glass_leave_the_rooms_as_they_are() -> None:
    assert floor_of("7?furniture=0&glass=0").rooms == floor_of("7?furniture=0.3&glass=0.5").rooms


def test_the_split_of_seeds_does_not_overlap() -> None:
    assert (len(DEVELOPMENT_SEEDS), len(TEST_SEEDS)) == (100, 100)
    assert not set(DEVELOPMENT_SEEDS) & set(TEST_SEEDS)


def test_doors_and_walls_have_the_sizes_of_buildings() -> None:
    for seed in range(50):
        for room in floor_of(f"{seed}").rooms:
            assert 18 <= room.shape.door <= 24
            assert 2 <= room.wall <= 4


def test_look_alike_rooms_are_the_same_in_the_frame_of_their_door() -> None:
    floor = floor_of("3?lookalike=1")
    first, *others = (room for room in floor.rooms if room.alike == 0)
    # A place 1 m inside the first room, 0.3 m to the left of its door's axis.
    up = 1.0 if first.up else -1.0
    pose = Place(first.door.x - 0.3 * up, first.door.y + 1.0 * up, 0.2)
    found = lookalikes(floor, pose)
    assert len(found) == len(others) > 0
    expected = clearance(ROBOT, pose, floor.world, height=0.6)[0]
    for place in found:
        assert clearance(ROBOT, place, floor.world, height=0.6)[0] == pytest.approx(expected, abs=1e-9)


def test_a_laser_in_a_look_alike_room_sees_the_same_but_through_the_door() -> None:
    turns = np.linspace(0.0, 2.0 * math.pi, 180, endpoint=False)
    for seed in range(10):
        floor = floor_of(f"{seed}?lookalike=0.6")
        copy = next(room for room in floor.rooms if room.alike != room.number)
        pose = Place(copy.door.x, copy.door.y + (1.2 if copy.up else -1.2), 0.3)

        def seen(place: Place, world: World = floor.world) -> NDArray[np.float64]:
            ways = np.stack([np.cos(turns + place.heading), np.sin(turns + place.heading), 0.0 * turns], axis=1)
            return cast(world, np.tile([place.x, place.y, 0.3], (180, 1)), ways)

        for other in lookalikes(floor, pose):
            assert (np.abs(seen(other) - seen(pose)) < 1e-6).mean() > 0.8


def test_without_look_alikes_no_room_has_another() -> None:
    floor = floor_of("3?lookalike=0")
    assert all(lookalikes(floor, Place(room.door.x, room.door.y, 0.0)) == () for room in floor.rooms)


def test_look_alikes_are_about_as_many_as_asked_for() -> None:
    rooms = [room for seed in range(50) for room in floor_of(f"{seed}?lookalike=0.5").rooms]
    copies = sum(room.alike != room.number for room in rooms)
    assert 0.35 < copies / len(rooms) < 0.5


def test_the_share_of_glass_is_that_asked_for() -> None:
    shares = []
    for seed in range(50):
        floor = floor_of(f"{seed}?glass=0.4")
        walls = sum(r.shape.left + r.shape.right - r.shape.door for r in floor.rooms) * 0.05
        panes = sum(max(b.x[1] - b.x[0], b.y[1] - b.y[0]) for b in floor.world.obstacles if is_glass(b))
        shares.append(panes / walls)
    assert min(shares) > 0.35 and max(shares) <= 0.4


def is_glass(obstacle: object) -> bool:
    return isinstance(obstacle, Box) and obstacle.material == "glass"


def test_the_map_shows_glass_and_mapped_furniture_only() -> None:
    world = floor_of("5?furniture=0.2&unmapped=0.5&glass=0.5").world
    grid = grid_of(world, 0.05, 0.6)

    def is_shown(obstacle: Box) -> bool:
        x, y = obstacle.centre
        return bool(grid.cells[int(y / 0.05), int(x / 0.05)])

    glass = [o for o in world.obstacles if isinstance(o, Box) and o.material == "glass"]
    shelves = [o for o in world.obstacles if isinstance(o, Box) and o.name.startswith(("shelf", "cabinet"))]
    assert glass and all(map(is_shown, glass))
    assert {is_shown(o) == o.is_mapped for o in shelves} == {True}
    assert {o.is_mapped for o in shelves} == {True, False}


@pytest.mark.parametrize(("unmapped", "is_mapped"), [("0", True), ("1", False)])
def test_all_furniture_is_mapped_or_none(unmapped: str, is_mapped: bool) -> None:
    world = floor_of(f"5?unmapped={unmapped}").world
    # Of a chair, the map shows the legs.
    shown = {o.is_mapped for o in world.obstacles if not (o.name.startswith("chair") and isinstance(o, Box))}
    assert shown == {is_mapped}


def test_a_hundred_metres_square_has_its_size() -> None:
    world = floor_of("1?size=100x100").world
    assert world.raster is not None and world.raster.occupied.shape == (2000, 2000)
    assert len(floor_of("1?size=100x100").rooms) > 200


@pytest.mark.parametrize(
    ("argument", "message"),
    [
        ("x", "floor:x: expected a seed"),
        ("", "floor:: expected a seed"),
        ("-1", "floor:-1: expected a seed"),
        ("1?sise=3x3", "option 'sise' does not exist; did you mean 'size'"),
        ("1?size=30x20,glass=0.2", "separate options by &, not by a comma"),
        ("1?size=30", "size=30: expected width x height from 12x9 to 200x200 m"),
        ("1?size=5x5", "size=5x5: expected width x height"),
        ("1?size=300x20", "size=300x20: expected width x height"),
        ("1?corridors=9", "corridors=9: expected a number from 1 to 2 for this size"),
        ("1?corridors=0", "corridors=0: expected a number from 1 to 2"),
        ("1?glass=2", "glass=2: expected a share from 0 to 1"),
        ("1?furniture=nan", "furniture=nan: expected a share from 0 to 1"),
        ("1?unmapped=", "unmapped=: expected a share"),
    ],
)
def test_a_wrong_option_is_named(argument: str, message: str) -> None:
    with pytest.raises(WorldError, match=message.replace("?", r"\?")):
        floor_of(argument)

"""Halls for fleets: places that robots can stand at, whose ways cross, and that follow from the seed."""

from __future__ import annotations

import math
from itertools import combinations
from pathlib import Path

import pytest
from navloom.geometry.collision import clearance
from navloom.geometry.footprints import disc
from navloom.geometry.world import World
from navloom.worlds import WorldError
from navloom_maps import fleet_world

SCENES = ("circle", "corridor", "doorway", "crossing", "aisles")
RADIUS = 0.31
"""About the corner of a Jackal of 0.458 x 0.416 m, m."""


def scene(argument: str) -> World:
    return fleet_world(argument, Path())


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("robots", [2, 10, 40])
def test_every_start_and_every_goal_is_free_and_apart_from_the_others(name: str, robots: int) -> None:
    world = scene(f"{name}#3?robots={robots}")
    assert len(world.tasks) == robots
    outline = disc(RADIUS)
    for places in zip(*world.tasks, strict=True):
        assert min(clearance(outline, place, world, height=0.3)[0] for place in places) > 0.1
        # 2 * 0.31 m, and room to turn
        assert min(math.dist((a.x, a.y), (b.x, b.y)) for a, b in combinations(places, 2)) > 0.8


@pytest.mark.parametrize("name", SCENES)
def test_each_starts_with_its_front_to_its_goal_and_the_seed_moves_it(name: str) -> None:
    first, again, other = (scene(f"{name}#{seed}") for seed in (1, 1, 2))
    assert first.tasks == again.tasks != other.tasks
    for start, goal in first.tasks:
        assert start.heading == pytest.approx(math.atan2(goal.y - start.y, goal.x - start.x))


def test_ten_on_a_circle_drive_to_the_other_side() -> None:
    """Radius 0.4 m for each robot; start and goal are moved by at most 0.15 m in x and y."""
    for start, goal in scene("circle#1").tasks:
        assert math.hypot(start.x, start.y) == pytest.approx(4.0, abs=0.22)
        assert math.hypot(start.x + goal.x, start.y + goal.y) < 0.43


@pytest.mark.parametrize("name", ["corridor", "doorway"])
def test_two_groups_change_sides_and_the_front_row_goes_to_the_rear(name: str) -> None:
    tasks = scene(f"{name}#1").tasks
    assert all(start.x < 0.0 < goal.x for start, goal in tasks[:5])
    assert all(goal.x < 0.0 < start.x for start, goal in tasks[5:])
    (front, far), (rear, near) = tasks[0], tasks[4]
    assert rear.x < front.x - 1.0 and near.x < far.x - 1.0


def test_streams_cross_at_a_right_angle() -> None:
    tasks = scene("crossing#1").tasks
    assert all(abs(start.heading) < 0.1 for start, _ in tasks[:5])
    assert all(abs(start.heading - 0.5 * math.pi) < 0.1 for start, _ in tasks[5:])


def test_goals_in_a_store_are_dealt_out_each_once() -> None:
    tasks = scene("aisles#1").tasks
    assert all(start.y < -3.0 and goal.y > 3.0 for start, goal in tasks[:5])
    assert len({round(goal.x, 0) for _, goal in tasks[:5]}) == 5


@pytest.mark.parametrize(("name", "width"), [("circle", 9.0), ("corridor", 4.0), ("doorway", 0.9), ("aisles", 2.5)])
def test_width_is_that_of_the_circle_the_corridor_the_door_and_the_aisle(name: str, width: float) -> None:
    world = scene(f"{name}#1?width={width:g}")
    boxes = {obstacle.name: obstacle for obstacle in world.obstacles}
    found = {
        "circle": lambda: 2.0 * max(math.hypot(start.x, start.y) for start, _ in world.tasks),
        "corridor": lambda: boxes["front wall"].y[0] - boxes["rear wall"].y[1],
        "doorway": lambda: boxes["wall left of the door"].y[0] - boxes["wall right of the door"].y[1],
        "aisles": lambda: boxes["shelf 2"].x[0] - boxes["shelf 1"].x[1],
    }[name]()
    assert found == pytest.approx(width, abs=0.44 if name == "circle" else 1e-9)


@pytest.mark.parametrize(
    ("argument", "said"),
    [
        ("circl#1", "no scene 'circl'; did you mean 'circle'"),
        ("circle", "expected a seed after the scene, a whole number from 0, as in fleet:circle#3"),
        ("circle#-1", "expected a seed after the scene"),
        ("circle#1?robots=1", "robots=1: expected a number from 2 to 200"),
        ("corridor#1?robots=5", "robots=5: expected an even number"),
        ("doorway#1?width=9", "width=9: expected a side from 0.6 to 4 m"),
        ("circle#1?people=3", "option 'people' does not exist"),
    ],
)
def test_what_is_no_scene_is_refused(argument: str, said: str) -> None:
    with pytest.raises(WorldError, match=said):
        scene(argument)

"""People who give way, by the law of the orca plugin, in generated crowds and flows: no contacts, seeds, streams."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from navloom.geometry.moving_world import Mover, MovingWorld, RobotBody
from navloom.geometry.walls import walls_of
from navloom.geometry.world import World
from navloom.worlds import WorldError
from navloom_maps import crowd_world, people_flow_world
from navloom_orca.crowd import Reaction, react
from numpy.typing import NDArray

PERIOD, RADIUS, WALL = 0.05, 0.22, 0.2
HALF = 0.2
ROBOT = RobotBody("r1", HALF * np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]]), 0.4)
SCHEMES = {"crowd": crowd_world, "people_flow": people_flow_world}
DENSE = "people_flow:5?people=40&blind=0"


class Seen(NamedTuple):
    """By tick: gaps, m, between two people, people and walls, robot and those who see it, robot and the others."""

    people: NDArray[np.float64]
    walls: NDArray[np.float64]
    seeing: NDArray[np.float64]
    blind: NDArray[np.float64]


def world_of(reference: str) -> World:
    scheme, _, argument = reference.partition(":")
    return SCHEMES[scheme](argument, Path())


def places(world: World, speed: float, seconds: float = 30.0) -> list[dict[str, tuple[float, float]]]:
    """Where everybody is in each tick, while a robot drives straight to the goal, m/s, and gives way to nobody."""
    start, goal = world.start, world.goal
    assert start is not None and goal is not None
    length, heading = math.hypot(goal.x - start.x, goal.y - start.y), start.heading
    law = partial(react, lines=walls_of(world), reaction=Reaction(period=PERIOD))
    moving, found = MovingWorld(world, [ROBOT], PERIOD, law), []
    for tick in range(round(seconds / PERIOD)):
        way = min(speed * tick * PERIOD, length)
        robot = Mover(start.x + way * math.cos(heading), start.y + way * math.sin(heading), heading, speed)
        bodies = moving.advance(round(tick * PERIOD * 1e9), [robot])
        found.append({name: (x, y) for name, (x, y, _) in zip(bodies.names, bodies.poses.tolist(), strict=True)})
    return found


def gaps(reference: str) -> Seen:
    world = world_of(reference)
    sees = {actor.name: actor.course.sees_robots for actor in world.actors}
    x0, y0, x1, y1 = np.array(world.bounds) + WALL * np.array([1.0, 1.0, -1.0, -1.0])
    rows = []
    for tick in places(world, 0.8):
        robot = np.array(tick.pop("r1"))
        people = np.array(list(tick.values()))
        between = np.hypot(*(people[:, None] - people[None]).transpose(2, 0, 1)) + np.diag(np.full(len(people), 9.0))
        inside = min((people - (x0, y0)).min(), ((x1, y1) - people).min())
        to_robot = np.hypot(*np.maximum(np.abs(people - robot) - HALF, 0.0).T) - RADIUS
        is_seeing = np.array([sees[name] for name in tick])
        least = [min(to_robot[mask], default=9.0) for mask in (is_seeing, ~is_seeing)]
        rows.append((between.min() - 2.0 * RADIUS, inside - RADIUS, *least))
    return Seen(*np.array(rows).T)


@pytest.mark.parametrize(
    "reference", ["crowd:5", "crowd:6?people=60", "people_flow:5", DENSE, "people_flow:6?way=across&size=8x4"]
)
def test_people_touch_neither_each_other_nor_walls_nor_a_robot_that_they_see(reference: str) -> None:
    """Though the robot drives at 0.8 m/s whoever is in its way."""
    seen = gaps(reference)
    assert seen.people.min() > 0.0
    assert seen.walls.min() > 0.0
    assert seen.seeing.min() > 0.0


def test_those_who_do_not_see_the_robot_walk_into_it() -> None:
    assert gaps("crowd:5?blind=1").blind.min() == pytest.approx(-RADIUS, abs=0.05)


def test_everybody_keeps_walking() -> None:
    """Of 40 people in a corridor of 16 x 6 m, in both directions, nobody is in the same place for 15 s."""
    found = places(world_of(DENSE), 0.0)
    stays = [
        name
        for name, place in found[-1].items()
        if name != "r1" and math.dist(place, found[-301].get(name, (0.0, 0.0))) < 0.2
    ]
    assert stays == []


def test_the_same_seed_is_the_same_crowd_bit_for_bit() -> None:
    first, second = (places(world_of("crowd:8"), 0.8, 10.0) for _ in range(2))
    assert first == second and first != places(world_of("crowd:9"), 0.8, 10.0)


def test_who_does_not_see_the_robot_walks_alike_whatever_it_does() -> None:
    """Goals, starts and speeds are drawn before: with nobody who sees the robot, nothing depends on it."""
    driving, standing = (places(world_of("crowd:8?blind=1"), speed) for speed in (0.8, 0.0))
    assert [tick | {"r1": None} for tick in driving] == [tick | {"r1": None} for tick in standing]


def test_more_people_leave_the_others_as_they_are() -> None:
    few, many = (world_of(f"crowd:4?people={count}&blind=0").actors for count in (5, 20))
    assert few == many[:5]


@pytest.mark.parametrize(("blind", "count"), [("0", 0), ("0.5", 10), ("1", 20)])
def test_as_many_as_the_share_says_do_not_see_the_robot(blind: str, count: int) -> None:
    actors = world_of(f"crowd:3?blind={blind}").actors
    assert sum(not actor.course.sees_robots for actor in actors) == count and len(actors) == 20


def test_a_share_of_the_flow_walks_against_the_robot() -> None:
    """The robot drives along x from 0 to 16 m: a quarter of 16 people goes the other way."""
    goals = [actor.course.goals[-1][0] for actor in world_of("people_flow:3?against=0.25").actors]
    assert sorted(goals) == [-2.0] * 4 + [18.0] * 12


@pytest.mark.parametrize(
    ("reference", "said"),
    [
        ("crowd:x", "expected a seed, a whole number from 0, as in crowd:3"),
        ("crowd:1?people=0", "people=0: expected a number from 1 to 100, one to a square metre"),
        ("crowd:1?size=5&people=26", "expected a number from 1 to 25"),
        ("crowd:1?size=10x10", "size=10x10: expected a side from 4 to 100 m, as in size=10"),
        ("crowd:1?blind=2", "blind=2: expected a share from 0 to 1"),
        ("crowd:1?people=4,size=8", "separate options by &"),
        ("people_flow:1?size=16", "size=16: expected length x width from 2 to 100 m, as in size=10x6"),
        ("people_flow:1?way=up", "way=up: expected along or across"),
        ("people_flow:1?lane=2", "option 'lane' does not exist"),
    ],
)
def test_what_is_not_valid_is_refused_with_what_is(reference: str, said: str) -> None:
    with pytest.raises(WorldError, match=said.replace("(", r"\(")):
        world_of(reference)

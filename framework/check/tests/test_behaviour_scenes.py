"""Scenes of the behaviour tier: what sensors see of them, their distances, and how they are shrunk."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from navloom import (
    Avoidance,
    Avoider,
    AvoiderInput,
    Claim,
    Extra,
    MapUpdate,
    Message,
    OccupancyGrid,
    Reference,
    Twist2D,
)
from navloom import message as declared
from navloom.geometry.world import Place
from navloom_check.behaviour.avoider_scenes import blocked_scene, closed_scene
from navloom_check.behaviour.measurements import Behaviour, Maker, Measured, Unfit, scan_from, shrunk
from navloom_check.behaviour.obstacle_scene import ALL_ROUND, SONARS, Scene, post, wall
from navloom_check.behaviour.planner_scenes import grid_of, shortest
from navloom_check.tiers import TIERS

PLAIN = Scene(Place(0.0, 0.0), (5.0, 0.0), (post(2.0, 0.0, 0.5), wall(0.0, 1.0, 4.0, 1.0)))


@declared()
class Crowd(Message):
    """Who is near: `count` of them."""

    count: int


@declared()
class Load(Message):
    """A measured mass, kg."""

    mass: float


class Reads(Avoider):
    """An avoider that cannot step without streams of other nodes."""

    name = "reads"
    reference = Extra(Reference)
    map = Extra(MapUpdate)
    crowd = Extra(Crowd)
    load = Extra(Load, optional=True)

    def avoid(self, given: AvoiderInput) -> Avoidance:
        return Avoidance(Twist2D(0.0, 0.0, 0.0), "clear")


class Waits(Reads):
    load = Extra(Load)


def ranges(scene: Scene, pose: tuple[float, float, float] = (0.0, 0.0, 0.0), reach: float = 10.0) -> np.ndarray:
    """What a laser with 120 beams all round sees, from -178.5 deg on."""
    return scan_from(scene, replace(ALL_ROUND[0], reach=reach), pose, 0).ranges


def test_beams_meet_a_post_and_a_wall_at_their_places() -> None:
    ahead, left, behind, right = ranges(PLAIN, (0.0, 0.0, math.radians(-1.5)))[[60, 90, 0, 30]]
    assert (ahead, left, behind, right) == pytest.approx((1.5, 1.0, math.inf, math.inf), abs=1e-5)


def test_an_obstacle_out_of_range_gives_no_echo() -> None:
    assert ranges(PLAIN, (0.0, 0.0, math.radians(-1.5)), 1.4)[60] == math.inf


@pytest.mark.parametrize(
    ("pose", "gap"),
    [
        ((0.0, 0.0, 0.0), 0.8),  # the wall, 1 m to the left, less half the width of 0.4 m
        ((1.0, 0.0, 0.0), 0.25),  # the post: 2.0 - 0.5 - 1.0, less half the length of 0.5 m
        ((1.3, 0.0, 0.0), 0.0),
        ((3.0, 0.9, 0.0), 0.0),
    ],
)
def test_the_gap_is_that_of_the_footprint(pose: tuple[float, float, float], gap: float) -> None:
    assert PLAIN.gap(*pose) == pytest.approx(gap, abs=1e-6)


def test_a_moved_scene_looks_the_same_from_its_start() -> None:
    moved = PLAIN.moved(Place(3.0, -2.0, 0.7))
    there = ranges(moved, (moved.start.x, moved.start.y, moved.start.heading))
    assert there == pytest.approx(ranges(PLAIN), abs=1e-9)
    assert moved.gap(moved.start.x, moved.start.y, moved.start.heading) == pytest.approx(0.8, abs=1e-6)


def test_a_mirrored_scene_has_left_and_right_exchanged() -> None:
    assert ranges(PLAIN.mirrored())[::-1] == pytest.approx(ranges(PLAIN), abs=1e-9)


def test_a_raster_is_occupied_where_obstacles_are() -> None:
    grid: OccupancyGrid = grid_of(PLAIN)
    row, col = (math.floor((v - o) / 0.05) for v, o in ((0.0, grid.origin.y), (2.0, grid.origin.x)))
    assert grid.cells[row, col] == 100
    assert grid.cells[row - 30, col] == 0


def test_the_oracle_goes_straight_where_it_can_and_round_where_it_must() -> None:
    assert shortest(replace(PLAIN, obstacles=PLAIN.obstacles[1:]), 0.1) == pytest.approx(5.0, abs=1e-6)
    tangent = 2.0 * math.sqrt(2.5**2 - 0.6**2)  # to the disc of 0.5 + 0.1 m round the post in the middle
    around = Scene(Place(-0.5, 0.0), (4.5, 0.0), (post(2.0, 0.0, 0.5),))
    arc = 0.6 * (math.pi - 2.0 * math.acos(0.6 / 2.5))
    assert shortest(around, 0.1) == pytest.approx(tangent + arc, abs=0.03)


def test_a_failing_scene_shrinks_to_the_obstacle_that_makes_it_fail() -> None:
    scene = Scene(Place(0.0, 0.0), (5.0, 0.0), (*(post(float(x), 2.0, 0.1) for x in range(6)), *PLAIN.walls))

    def measure(make: Maker, given: Scene) -> Measured:
        return Measured(not any(one.centre == (4.0, 2.0) for one in given.obstacles), "met the post at 4 m", 0.0)

    behaviour = Behaviour("avoider", Claim.MIRROR, "nothing at 4 m", lambda seed: scene, measure, 1)
    small, seen = shrunk(behaviour, Maker(object), scene, measure(Maker(object), scene))  # type: ignore[arg-type]
    assert small.obstacles == (post(4.0, 2.0, 0.1),)
    assert not seen.holds


@pytest.mark.parametrize("seed", range(26))
def test_no_scene_begins_in_contact(seed: int) -> None:
    for scene in (blocked_scene(seed), closed_scene(seed)):
        assert scene.gap(scene.start.x, scene.start.y, scene.start.heading) > 0.01


def test_each_check_of_all_tiers_has_a_unique_name() -> None:
    names = [check.name for checks in TIERS.values() for check in checks]
    assert len(names) == len(set(names))
    assert {claim.value for claim in Claim} <= set(names)


def test_a_scene_gives_the_streams_of_the_framework_that_an_extra_input_reads() -> None:
    given = Maker(Reads).extra(PLAIN, 7, (1.0, 0.2, 0.1))
    reference = given[Reads.reference]
    # The way is the straight line of 5 m along the x axis, and the robot is 0.2 m to its left.
    assert (reference.progress, reference.cross_track) == pytest.approx((1.0, 0.2), abs=1e-6)
    assert (reference.target.x, reference.remaining) == pytest.approx((2.0, 4.0), abs=1e-6)
    assert (given[Reads.map].grid.cells == grid_of(PLAIN).cells).all()


def test_a_message_of_another_plugin_says_that_there_is_nothing_and_an_optional_one_is_missing() -> None:
    given = Maker(Reads).extra(PLAIN, 7, (0.0, 0.0, 0.0))
    assert given[Reads.crowd] == Crowd(0) and given[Reads.load] is None


def test_a_measured_number_of_another_plugin_cannot_be_made_up() -> None:
    with pytest.raises(Unfit, match=r"load \(Load\)"):
        Maker(Waits).extra(PLAIN, 7, (0.0, 0.0, 0.0))


def test_a_sonar_reads_the_nearest_thing_in_its_cone() -> None:
    scan = scan_from(
        Scene(Place(0.0, 0.0), (5.0, 0.0), obstacles=(wall(2.0, -3.0, 2.0, 3.0),)), SONARS[0], (0.0, 0.0, 0.0), 0
    )
    ahead, aside = (int(np.abs(scan.bearings - math.radians(deg)).argmin()) for deg in (11.25, 56.25))
    # Its cone of +-15 deg reaches across the axis of the robot, where the wall is 2 m less the rim of 0.1 m away.
    assert scan.ranges[ahead] == pytest.approx(2.0 - 0.1 * math.cos(math.radians(11.25)), abs=0.001)
    away = 2.0 - 0.1 * math.cos(math.radians(56.25))
    assert scan.ranges[aside] == pytest.approx(away / math.cos(math.radians(41.25)))

"""Actors over time, and the bodies that the node `world` tells of."""

from __future__ import annotations

import math

import numpy as np
import pytest
from navloom.geometry.actors import STEP, Actor, Body, Course, Motion, Walk
from navloom.geometry.actors import parts_of as all_parts_of
from navloom.geometry.moving_world import Mover, MovingWorld, RobotBody, moves, standing
from navloom.geometry.world import Box, Cylinder, World

S = 10**9
WALKER = Cylinder("walker", 0.0, 0.0, 0.25, (0.0, 1.8), waypoints=((1.0, 0.0, 0.0), (3.0, 4.0, 0.0)))
ROBOT = RobotBody("r1", np.array([[0.3, 0.2], [-0.5, 0.2], [-0.5, -0.2], [0.3, -0.2]]), 0.4)


def parts_of(body: Body, motion: Motion) -> list[list[float]]:
    (parts,) = all_parts_of(body, np.array([motion]))
    return parts.tolist()


def at(world: World, time: float):
    return MovingWorld(world, (), 0.05).advance(round(time * S), ())


def test_an_obstacle_with_way_points_is_a_body_with_its_velocity() -> None:
    bodies = at(World("w", (Box("wall", (5.0, 6.0), (0.0, 1.0)), WALKER)), 2.0)
    assert bodies.names == ("walker",) and bodies.robots == 0 and bodies.stamp_ns == 2 * S
    assert bodies.poses.tolist() == [[2.0, 0.0, 0.0]] and bodies.velocities.tolist() == [[2.0, 0.0, 0.0]]
    assert bodies.parts.tolist() == [[0.0, 2.0, 0.0, 0.25, 0.0, 0.0, 0.0, 1.8, 0.0]]


@pytest.mark.parametrize(("time", "x", "vx"), [(0.0, 0.0, 0.0), (1.0, 0.0, 2.0), (3.0, 4.0, 2.0), (9.0, 4.0, 0.0)])
def test_it_stays_before_its_first_way_point_and_after_its_last(time: float, x: float, vx: float) -> None:
    bodies = at(World("w", (WALKER,)), time)
    assert (bodies.poses[0, 0], bodies.velocities[0, 0]) == (x, vx)


def test_a_recorded_person_is_there_from_the_first_sample_to_the_last() -> None:
    person = Actor("p", Course(((1.0, 0.0, 0.0), (1.4, 0.4, 0.0)), leaves=True))
    assert [len(at(World("w", actors=(person,)), time).names) for time in (0.9, 1.0, 1.2, 1.4, 1.5)] == [0, 1, 1, 1, 0]


def test_what_appears_later_is_not_told_of_before() -> None:
    late = Actor("p", Course(((0.0, 0.0, 0.0), (9.0, 9.0, 0.0))), appears_at=2.0)
    assert [at(World("w", actors=(late,)), time).names for time in (1.9, 2.0)] == [(), ("p",)]


def test_what_moves_is_not_in_the_standing_world() -> None:
    wall = Box("wall", (5.0, 6.0), (0.0, 1.0))
    world = World("w", (wall, WALKER), actors=(Actor("p", Course(((0.0, 0.0, 0.0),))),))
    assert moves(world) and standing(world).obstacles == (wall,) and standing(world).actors == ()
    still = World("w", (wall,))
    assert not moves(still) and standing(still) is still


def test_a_phase_begins_the_course_later() -> None:
    """A period of 4 s: at 2.5 s with a phase of 7.5 s it is at 10 s, 2 s into the third round."""
    course = Course(((0.0, 0.0, 0.0), (4.0, 8.0, 0.0)), loops=True, phase=7.5)
    motion = course.at(2.5)
    assert motion is not None and motion.x == pytest.approx(4.0) and motion.vx == 2.0


def test_it_faces_where_it_goes_and_keeps_its_heading_while_it_rests() -> None:
    course = Course(((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (2.0, 0.0, 1.0), (3.0, 0.0, 1.0), (4.0, -1.0, 1.0)))
    heads = [course.at(time).heading for time in (0.5, 1.5, 2.5, 3.5, 9.0)]  # type: ignore[union-attr]
    assert heads == [0.5 * math.pi, 0.5 * math.pi, 0.5 * math.pi, math.pi, math.pi]


def test_the_velocity_of_a_spline_does_not_jump() -> None:
    course = Course(((0.0, 0.0, 0.0), (1.0, 1.0, 0.0), (4.0, 2.0, 3.0), (5.0, 2.0, 5.0)), keys="spline")
    for time in (1.0, 4.0):
        before, after = course.at(time - 1e-7), course.at(time + 1e-7)
        assert before is not None and after is not None
        assert before[:2] == pytest.approx(after[:2], abs=1e-5)
        assert before[3:5] == pytest.approx(after[3:5], abs=1e-5)
    # The slope at the second point is that of the chord from the first to the third: (2, 3) m in 4 s.
    assert course.at(1.0)[3:5] == pytest.approx((0.5, 0.75))  # type: ignore[index]


def test_key_frames_as_gazebo_reads_them() -> None:
    """Over equal steps, whatever the times: halfway, the cubic is (p0 + p1) / 2 + (m0 - m1) / 8."""
    course = Course(((0.0, 0.0, 0.0), (1.0, 1.0, 0.0), (11.0, 2.0, 0.0), (12.0, 4.0, 0.0)), keys="gazebo")
    motion = course.at(6.0)
    assert motion is not None and motion.x == pytest.approx(1.5 + (1.0 - 1.5) / 8.0)


def test_the_foot_on_the_floor_rests_while_the_person_walks() -> None:
    body = Body("legs", 0.44, 0.44, (0.0, 1.75))
    feet = np.array([
        [part[0] for part in parts_of(body, Motion(walked, 0.0, 0.0, 1.0, 0.0, walked))[:2]]
        for walked in np.linspace(0.0, 2.0 * STEP, 41)
    ])  # fmt: skip
    moved = np.diff(feet, axis=0)
    assert np.allclose(moved.min(axis=1), 0.0) and np.allclose(moved.max(axis=1), 2.0 * 2.0 * STEP / 40.0)
    assert np.abs(feet[:, 0] - feet[:, 1]).max() == pytest.approx(STEP)


def test_legs_stand_beside_the_way_and_the_trunk_is_above_them() -> None:
    left, right, trunk = parts_of(Body("legs", 0.44, 0.44, (0.0, 1.75)), Motion(1.0, 2.0, 0.5 * math.pi, 0, 0, 0.3))
    assert left[:4] == pytest.approx([0.89, 2.0, 0.07, 0.0]) and right[:4] == pytest.approx([1.11, 2.0, 0.07, 0.0])
    assert trunk == pytest.approx([1.0, 2.0, 0.22, 0.0, 0.0, 0.8, 1.75, 0.0])


def test_a_trolley_is_four_posts_below_a_deck() -> None:
    *posts, deck = parts_of(Body("trolley", 1.0, 0.6, (0.0, 0.9)), Motion(0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    corners = [(-0.48, -0.28), (-0.48, 0.28), (0.48, -0.28), (0.48, 0.28)]
    assert sorted((round(x, 9), round(y, 9)) for x, y, *_ in posts) == corners
    assert deck == [0.0, 0.0, 0.5, 0.3, 0.0, 0.55, 0.9, 0.0]


def test_a_robot_is_the_last_body_and_its_box_is_about_its_outline() -> None:
    world = MovingWorld(World("w", (WALKER,)), [ROBOT], 0.05)
    bodies = world.advance(2 * S, [Mover(1.0, 2.0, 0.5 * math.pi, 0.5, 0.0, 0.1)])
    assert bodies.names == ("walker", "r1") and bodies.robots == 1
    assert bodies.velocities[1] == pytest.approx([0.0, 0.5, 0.1])
    # Its outline goes from -0.5 to 0.3 m ahead: the middle is 0.1 m behind, which is -y here.
    assert bodies.parts[1] == pytest.approx([1.0, 1.0, 1.9, 0.4, 0.2, 0.5 * math.pi, 0.0, 0.4, 0.0])


def walk_straight(positions, velocities, radii, preferred, max_speeds, sees):
    walk_straight.seen = (positions, velocities, radii, sees)
    return preferred


def test_a_walking_actor_takes_its_goals_in_turn_by_the_law() -> None:
    walk = Walk((0.0, 0.0), ((2.0, 0.0), (2.0, 2.0)), speed=1.0, sees_robots=False)
    people = Actor("p", walk), Actor("q", Course(((0.0, 9.0, 9.0),)), Body("disc", 1.0, 1.0))
    world = MovingWorld(World("w", actors=people), [ROBOT], 0.05, walk_straight)
    for tick in range(100):
        bodies = world.advance(tick * S // 20, [Mover(5.0, 5.0, 0.0, 0.2)])
    # 4.95 s at 1 m/s: 1.7 m until the first goal is within 0.3 m, then towards (2, 2).
    assert np.hypot(*(bodies.poses[1, :2] - (2.0, 2.0))) < 0.35
    positions, velocities, radii, sees = walk_straight.seen
    assert positions[1:].tolist() == [[9.0, 9.0], [5.0, 5.0]] and velocities[2].tolist() == [0.2, 0.0]
    assert radii[1:] == pytest.approx([0.5, math.hypot(0.5, 0.2)]) and sees.tolist() == [
        [True, True, False],
        [False] * 3,
        [False] * 3,
    ]


def test_an_actor_of_a_flow_begins_again() -> None:
    walk = Walk((0.0, 0.0), ((1.0, 0.0),), speed=1.0, flows=True)
    world = MovingWorld(World("w", actors=(Actor("p", walk),)), (), 0.05, walk_straight)
    xs = [world.advance(tick * S // 20, ()).poses[0, 0] for tick in range(40)]
    assert max(xs) < 1.0 and min(np.diff(xs)) < -0.6 and np.count_nonzero(np.diff(xs) < 0.0) == 2


def test_one_of_a_flow_enters_again_when_nothing_is_near_its_entry() -> None:
    """A robot 0.6 m wide and long stands at the entry, and leaves after 3 s: the body is 0.25 m, the room 0.5 m."""
    walk = Walk((1.0, 0.0), ((2.0, 0.0),), speed=1.0, flows=True, entry=(0.0, 0.0))
    world = MovingWorld(World("w", actors=(Actor("p", walk),)), [ROBOT], 0.05, walk_straight)
    seen = [world.advance(tick * S // 20, [Mover(0.0, 0.0 if tick < 60 else 5.0, 0.0)]) for tick in range(80)]
    there = [bodies.names == ("p", "r1") for bodies in seen]
    # 0.7 m at 1 m/s until it is within 0.3 m of its goal.
    assert there.index(False) == pytest.approx(14, abs=1) and there[there.index(False) :].index(
        True
    ) == 60 - there.index(False)
    assert seen[60].poses[0, :2].tolist() == [0.0, 0.0] and seen[60].velocities[0].tolist() == [0.0, 0.0, 0.0]


def test_an_actor_with_goals_that_loop_goes_to_the_first_again() -> None:
    walk = Walk((0.0, 0.0), ((2.0, 0.0), (2.0, 2.0)), speed=1.0, loops=True)
    world = MovingWorld(World("w", actors=(Actor("p", walk),)), (), 0.05, walk_straight)
    ys = [world.advance(tick * S // 20, ()).poses[0, 1] for tick in range(90)]
    assert max(ys) == pytest.approx(1.7, abs=0.1) and ys[-1] < 1.2


def test_the_names_are_the_same_tuple_while_the_same_bodies_are_there() -> None:
    """So that the message does not check the text of each in every tick."""
    world = MovingWorld(World("w", (WALKER,)), (), 0.05)
    assert world.advance(2 * S, ()).names is world.advance(3 * S, ()).names

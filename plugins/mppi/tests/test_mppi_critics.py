"""Each critic against numbers worked by hand. The robot is a square of 0.8 m."""

import math

import numpy as np
import pytest
from mppi_scenes import scene_of, still
from navloom_mppi import critics
from navloom_mppi.critics import CRITICS
from navloom_mppi.rollout import judge


def judged(scene, track):
    part = np.zeros(len(CRITICS))
    judge(scene, part, track)
    return dict(zip(CRITICS, part.tolist(), strict=True))


def test_a_point_15_cm_beyond_the_margin_of_the_front_is_half_near():
    """Front at 0.4 m, margin 0.05 m, soft 0.3 m: a point at 0.6 m is 0.15 m beyond."""
    assert critics.obstacles(scene_of([(0.6, 0.0, 0.05)]), still()) == (8, pytest.approx(0.5))


def test_nothing_near_costs_nothing():
    assert critics.obstacles(scene_of([(0.76, 0.0, 0.05)]), still()) == (8, 0.0)
    assert critics.obstacles(scene_of(), still()) == (8, 0.0)


def test_the_true_footprint_counts_and_not_its_circle():
    """A corner is 0.566 m away, the side 0.4 m: a point at 0.5 m is free at heading 0, and touched after 45 degrees."""
    scene = scene_of([(0.5, 0.0, 0.05)])
    assert critics.obstacles(scene, still())[0] == 8
    assert critics.obstacles(scene, still(heading=0.25 * math.pi))[0] == 0


@pytest.mark.parametrize("y", [0.0, 0.25, -0.25])
def test_a_long_body_touches_a_point_at_its_end(y):
    """1.2 x 0.6 m: the end is at 0.6 m; the body's second point finds what the first one does not."""
    long = np.array([[0.6, 0.3], [-0.6, 0.3], [-0.6, -0.3], [0.6, -0.3]])
    assert critics.obstacles(scene_of([(0.62, y, 0.05), (0.0, 0.4, 0.05)], footprint=long), still())[0] == 0
    assert critics.obstacles(scene_of([(0.66, y, 0.05), (0.0, 0.4, 0.05)], footprint=long), still())[0] == 8


def test_a_collision_costs_more_the_earlier_it_comes():
    assert [critics.collision(step, 8) for step in (0, 4, 7, 8)] == [2.0, 1.5, 1.125, 0.0]


def test_a_roll_out_is_judged_up_to_its_collision():
    """It touches in step 4 of 8, where the way left is that of the pose of step 4."""
    track = still()
    track[:, 0] = 0.1 * np.arange(8)
    costs = judged(scene_of([(0.8, 0.0, 0.05)]), track)
    assert costs["collision"] == 1.5
    assert costs["path_follow"] == pytest.approx(critics.path_follow(scene_of([(0.8, 0.0, 0.05)]), 0.4, 0.0, 1.0, 0.0))


def test_the_way_left_on_a_free_floor_is_the_distance():
    """Target at (3, 0); the base is 2 m away, and the nose 1.5, 2.5 m or sqrt(4.25) = 2.06 m; cells of 0.1 m."""
    left = [critics.path_follow(scene_of(), 1.0, 0.0, c, s) for c, s in ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0))]
    assert left == pytest.approx([1.75, 2.25, 2.03], abs=0.1)


def test_the_distance_from_the_path_is_that_across_it():
    """0.5 m beside a path along the x axis, whose cells are centred 0.05 m above it."""
    assert critics.path_align(scene_of(), still(1.0, -0.45), 8) == pytest.approx(0.5, abs=0.01)
    assert critics.path_align(scene_of(), still(1.0, -0.45), 4) == pytest.approx(0.25, abs=0.005)


def test_a_path_that_is_not_free_does_not_count():
    assert judged(scene_of(is_path_free=False), still(1.0, -0.45))["path_align"] == 0.0


def test_near_the_goal_its_distance_replaces_the_path():
    """(3, 0) from (3, 1): 1 m."""
    costs = judged(scene_of(is_near_goal=True), still(3.0, 1.0))
    assert (costs["goal"], costs["path_follow"], costs["path_align"]) == (pytest.approx(1.0), 0.0, 0.0)


def test_the_path_angle_counts_only_for_a_robot_that_looks_away():
    """The point ahead is at (3, 0), 90 degrees from the heading."""
    turned = still(heading=0.5 * math.pi)
    assert judged(scene_of(turns_away=True), turned)["path_angle"] == pytest.approx(0.5 * math.pi)
    assert judged(scene_of(), turned)["path_angle"] == 0.0


def test_the_goal_angle_is_the_shorter_way_round():
    """From -3 to 3 rad: 2 π - 6."""
    costs = judged(scene_of(turn_to=3.0), still(heading=-3.0))
    assert costs["goal_angle"] == pytest.approx(math.tau - 6.0)
    assert judged(scene_of(), still(heading=-3.0))["goal_angle"] == 0.0


@pytest.mark.parametrize(("v", "w", "cost"), [(2.5, 0.0, 0.5), (-0.75, 0.0, 0.25), (1.0, -4.0, 1.0), (2.0, 3.0, 0.0)])
def test_the_constraint_is_what_exceeds_the_limits(v, w, cost):
    """Limits -0.5 and 2 m/s, 3 rad/s."""
    assert critics.constraint(v, w, -0.5, 2.0, 3.0) == pytest.approx(cost)


def test_only_driving_back_costs_and_turns_to_both_sides_cost_the_same():
    assert [critics.prefer_forward(v) for v in (0.5, 0.0, -0.3)] == [0.0, 0.0, 0.3]
    assert critics.twirling(-0.7) == critics.twirling(0.7) == 0.7

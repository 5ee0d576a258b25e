"""A sent command stays free with its ramps and its braking: the square of 0.8 m among single points."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from navloom_avoidance.clearance import footprint_edges, outside_distance
from navloom_dwa.rollout import choose, stays_free

EDGES = footprint_edges(np.array([[0.4, 0.4], [-0.4, 0.4], [-0.4, -0.4], [0.4, -0.4]]))
TURN = math.radians(25.0)


def near(*points, margin=0.05):
    """Obstacles and gaps as points.obstacles_in_base() gives them."""
    rows = sorted((outside_distance(EDGES, x, y), x, y) for x, y in points)
    gaps = np.array([row[0] for row in rows])
    return np.array([[x, y, min(margin, gap - 1e-6)] for gap, x, y in rows]).reshape(-1, 3), gaps


def rolled(obstacles, gaps, command, speed, down=1.0, lag=0.0, dead_time=0.0):
    """stays_free() with a speed that is also that of the newest command."""
    twist = (speed, command[1])
    return stays_free(
        obstacles, gaps, EDGES, twist, command, 0.05, 0.5, down, 3.0, 0.05, np.array([twist]), lag, dead_time
    )


def free(points, command, speed=0.0):
    obstacles, gaps = near(*points)
    return rolled(obstacles, gaps, command, speed)


def test_braking_distance_counts_from_the_present_speed():
    """From 0.5 m/s the robot stops in 0.125 m at 1 m/s^2: with 0.05 m of margin 0.17 m are too near, 0.18 are not."""
    assert not free([(0.57, 0.0)], (0.0, 0.0), speed=0.5)
    assert free([(0.58, 0.0)], (0.0, 0.0), speed=0.5)


def test_one_period_of_the_command_comes_before_the_braking():
    """0.025 m at 0.5 m/s, and 0.125 m of braking."""
    assert not free([(0.59, 0.0)], (0.5, 0.0), speed=0.5)
    assert free([(0.605, 0.0)], (0.5, 0.0), speed=0.5)


def test_a_corner_must_not_swing_into_an_obstacle_beside_the_robot():
    assert not free([(0.395, 0.455)], (0.0, TURN))
    assert free([(0.395, 0.455)], (0.0, -TURN))


def test_however_slowly_it_brakes_it_is_rolled_to_its_stop():
    """0.5 m/s at 0.02 m/s^2: 6.25 m in 25 s."""
    obstacles, gaps = near((6.9, 0.0))
    assert rolled(obstacles, gaps, (0.0, 0.0), 0.5, down=0.02)
    obstacles, gaps = near((6.6, 0.0))
    assert not rolled(obstacles, gaps, (0.0, 0.0), 0.5, down=0.02)


def test_lag_and_dead_time_lengthen_the_braking_distance():
    """0.1 s of lag and 0.05 s of dead time at 0.5 m/s are 0.075 m more than the 0.125 m of braking."""
    obstacles, gaps = near((0.635, 0.0))
    assert rolled(obstacles, gaps, (0.0, 0.0), 0.5)
    assert not rolled(obstacles, gaps, (0.0, 0.0), 0.5, lag=0.1, dead_time=0.05)
    obstacles, gaps = near((0.66, 0.0))
    assert rolled(obstacles, gaps, (0.0, 0.0), 0.5, lag=0.1, dead_time=0.05)


def test_a_turn_goes_on_while_the_motors_lag():
    """Turning at 1 rad/s the corner at 45 deg swings on by 0.15 rad, over a point at 52 deg and 0.54 m."""
    obstacles, gaps = near((0.332, 0.4255), margin=0.0)
    arguments = obstacles, gaps, EDGES, (0.0, 1.0), (0.0, 0.0), 0.05, 0.5, 1.0, 3.0, 0.05, np.array([[0.0, 1.0]])
    assert stays_free(*arguments, 0.0, 0.0)
    assert not stays_free(*arguments, 0.1, 0.05)


def test_a_robot_within_the_margin_may_leave_but_not_come_nearer():
    assert not free([(0.43, 0.0)], (0.1, 0.0))
    assert free([(0.43, 0.0)], (-0.1, 0.0))
    assert free([(0.0, 0.43)], (0.1, 0.0))


def test_backing_up_is_checked_behind():
    """One tick and braking from 0.15 m/s: 0.0075 + 0.011 m."""
    assert not free([(-0.465, 0.0)], (-0.15, 0.0), speed=-0.15)
    assert free([(-0.475, 0.0)], (-0.15, 0.0), speed=-0.15)


def chosen(points, costs, arcs, twist=(0.0, 0.0), is_checked=True):
    obstacles, gaps = near(*points)
    return choose(
        np.array(costs), np.array(arcs), twist, obstacles, gaps, EDGES, 0.05, 0.5, 1.0, 3.0, 0.05, is_checked,
        np.array([twist]), 0.0, 0.0,
    )  # fmt: skip


STRAIGHT = [[1.0, 0.0, 0.0, 0.4]]


def test_the_cheapest_is_sent_where_it_stays_free():
    assert chosen([], [[3.0, 2.0, 1.0]], STRAIGHT) == (0, 2, pytest.approx(0.4), 0.0)


def test_the_turn_rate_is_ramped_for_one_period():
    """3 rad/s^2 for 0.05 s."""
    arcs = [[0.0, 2.0, 0.0, 0.5]]
    assert chosen([], [[3.0, 2.0, 1.0]], arcs)[3] == pytest.approx(0.15)


def test_a_slower_speed_on_the_arc_is_sent_where_the_cheapest_would_touch():
    """Towards 0.4 m/s tick and braking take 0.011 + 0.025 m; at 0.2 m/s 0.010 + 0.020; 0.035 are free."""
    points = [(0.485, 0.0)]
    assert chosen(points, [[3.0, 2.0, 1.0]], STRAIGHT, (0.2, 0.0))[1] == 1
    assert chosen(points, [[3.0, 2.0, 1.0]], STRAIGHT, (0.2, 0.0), is_checked=False)[1] == 2


def test_where_nothing_is_admissible_nothing_is_chosen():
    assert chosen([], [[math.inf] * 3], STRAIGHT) == (-1, -1, 0.0, 0.0)


@settings(max_examples=100)
@given(
    st.lists(st.tuples(st.floats(-1.2, 1.2), st.floats(-1.2, 1.2)), min_size=1, max_size=8),
    st.floats(0.0, 0.5),
    st.floats(-TURN, TURN),
    st.integers(0, 1000),
)
def test_a_chosen_velocity_keeps_every_margin_while_driven_and_braked(points, speed, turn, seed):
    """Integrated here in independent steps of 1 ms."""
    outside = [p for p in points if max(abs(p[0]), abs(p[1])) > 0.41]
    rng = np.random.default_rng(seed)
    arcs = [[math.cos(a), math.sin(a) / 0.57, 0.0, 0.5] for a in np.linspace(-1.0, 1.0, 5)]
    j, _, v, w = chosen(outside, rng.random((5, 4)), arcs, (speed, turn))
    if j < 0:
        return
    x, y, heading, now, time = 0.0, 0.0, 0.0, speed, 0.0
    least = [min(0.05, outside_distance(EDGES, *p)) for p in outside]
    while time < 0.05 or now > 0.0:
        goal = v if time < 0.05 else 0.0
        now = min(goal, now + 0.0005) if goal > now else max(goal, now - 0.001)
        x, y, heading = x + 0.001 * now * math.cos(heading), y + 0.001 * now * math.sin(heading), heading + 0.001 * w
        time += 0.001
        c, s = math.cos(heading), math.sin(heading)
        for p, kept in zip(outside, least, strict=True):
            gap = outside_distance(EDGES, (p[0] - x) * c + (p[1] - y) * s, (p[1] - y) * c - (p[0] - x) * s)
            assert gap > kept - 0.004  # the swing of corners between two steps of 25 ms

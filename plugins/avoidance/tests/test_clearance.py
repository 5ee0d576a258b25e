"""The square footprint of 0.8 m (half diagonal 0.566 m) against single cells."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from navloom_avoidance.clearance import footprint_edges, free_command, is_free, nearest_ahead, outside_distance

EDGES = footprint_edges(np.array([[0.4, 0.4], [-0.4, 0.4], [-0.4, -0.4], [0.4, -0.4]]))
TURN = math.radians(25.0)


def cells(*points):
    return np.array([[x, y, 3.0] for x, y in points]).reshape(-1, 3)


def free(points, command, speed=0.0, margin=0.05, lag=0.0, dead_time=0.0, floor=0.05):
    """is_free() with a speed and turn rate that are also those of the newest command."""
    twist = (speed, command[1])
    in_flight = np.array([twist])
    return is_free(
        cells(*points), EDGES, twist, command, 0.05, 0.5, 1.0, 0.2, margin, floor, in_flight, lag, dead_time
    )  # fmt: skip


def reduced(points, command, speed=0.0, creep=0.1, margin=0.05):
    twist = (speed, command[1])
    in_flight = np.array([twist])
    return free_command(
        cells(*points), EDGES, twist, command, creep, 0.05, 0.5, 1.0, 0.2, margin, margin, in_flight, 0.0, 0.0
    )  # fmt: skip


def test_lag_and_dead_time_lengthen_the_braking_distance():
    """From 0.5 m/s at 1 m/s^2: 0.125 m, and 0.075 m more with 0.1 s of lag and 0.05 s of dead time."""
    assert free([(0.61, 0.0)], (0.0, 0.0), speed=0.5)
    assert not free([(0.61, 0.0)], (0.0, 0.0), speed=0.5, lag=0.1, dead_time=0.05)
    assert free([(0.67, 0.0)], (0.0, 0.0), speed=0.5, lag=0.1, dead_time=0.05)


def test_distance_beyond_the_sides():
    assert outside_distance(EDGES, 0.0, 0.0) == pytest.approx(-0.4)
    assert outside_distance(EDGES, 0.7, 0.1) == pytest.approx(0.3)
    assert outside_distance(EDGES, 0.5, -0.6) == pytest.approx(0.2)


def test_d30_is_from_the_front_and_the_free_run_is_of_the_strip():
    ahead = cells((1.0, 0.5), (0.9, -0.6), (2.0, 0.0))
    d30, run = nearest_ahead(ahead, math.radians(30.0), 0.4, 0.4, 0.12)
    assert d30 == pytest.approx(math.hypot(1.0, 0.5) - 0.4)
    assert run == pytest.approx(1.0 - 0.4 - 0.12)
    assert nearest_ahead(ahead[1:2], math.radians(30.0), 0.4, 0.4, 0.12) == (math.inf, math.inf)


def test_a_corner_must_not_swing_into_an_obstacle_beside_the_robot():
    """0.25 s at 25 deg/s are 6.25 deg: y' = 0.48 cos - 0.35 sin = 0.439, 0.039 m off the side, margin 0.05 m."""
    assert not free([(0.35, 0.48)], (0.0, TURN))
    assert free([(0.35, 0.50)], (0.0, TURN))  # y' = 0.459
    assert free([(0.35, 0.48)], (0.0, -TURN))


def test_braking_distance_counts_from_the_present_speed():
    """From 0.5 m/s the robot stops in 0.125 m at 1 m/s^2: a cell 0.15 m ahead with a margin of 0.05 m is too near."""
    assert not free([(0.55, 0.0)], (0.0, 0.0), speed=0.5)
    assert free([(0.60, 0.0)], (0.0, 0.0), speed=0.5)


def test_robot_within_the_margin_may_leave_but_not_come_nearer():
    assert not free([(0.43, 0.0)], (0.1, 0.0))
    assert free([(0.0, 0.43)], (0.1, 0.0))  # along it
    assert not free([(0.0, 0.43)], (0.0, TURN))


def test_free_command_passes_unchanged():
    assert reduced([(2.0, 2.0)], (0.3, 0.1)) == (0.3, 0.1)
    assert reduced([], (0.3, 0.1)) == (0.3, 0.1)


def test_speed_is_reduced_before_the_turn():
    """0.06 m to go: 0.325 m/s after one tick needs 0.068 m to stop, 0.25 m/s needs 0.045 m."""
    assert reduced([(0.51, 0.0)], (0.5, 0.1), speed=0.3) == (0.25, 0.1)


def test_a_blocked_turn_creeps_ahead_and_a_boxed_in_robot_stops():
    assert reduced([(0.35, 0.451)], (0.0, TURN)) == (0.1, 0.0)
    assert reduced([(0.35, 0.451), (0.45, 0.0), (-0.35, 0.451)], (0.0, TURN)) == (0.0, 0.0)


@settings(max_examples=200, deadline=None)
@given(
    st.lists(st.tuples(st.floats(-1.2, 1.2), st.floats(-1.2, 1.2)), min_size=1, max_size=8),
    st.floats(0.0, 0.5),
    st.floats(-TURN, TURN),
)
def test_a_free_command_is_sent_as_it_is_and_another_free_or_zero(points, speed, turn):
    outside = [p for p in points if max(abs(p[0]), abs(p[1])) > 0.46]
    sent = reduced(outside, (speed, turn))
    assert sent == (speed, turn) or not free(outside, (speed, turn))
    assert sent == (0.0, 0.0) or free(outside, sent)
    assert abs(sent[1]) <= abs(turn) + 1e-12
    assert sent[0] <= max(speed, 0.1)


def test_a_cell_within_the_margin_may_come_nearer_by_a_share_of_what_is_left_to_the_floor():
    """4 cm before the side of the square, floor 2 cm: a turn that takes 5 mm of it is free, all of it is not."""
    beside = [(0.0, 0.44)]
    assert not free(beside, (0.0, 0.05), margin=0.05)
    assert free([(0.1, 0.44)], (0.0, 0.05), margin=0.05, floor=0.02)
    assert not free([(0.35, 0.44)], (0.0, 0.5), margin=0.05, floor=0.02)

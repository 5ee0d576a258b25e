"""Half planes of agents and line obstacles, against numbers worked out by hand."""

import math

import numpy as np
import pytest
from navloom_orca.half_planes import put_agent, put_line


def agent(place, velocity, speed, radius=1.0, horizon=2.0, period=0.1, share=0.5):
    planes = np.zeros((1, 4))
    assert put_agent(planes, 0, place, velocity, speed, radius, horizon, period, share) == 1
    return planes[0]


def line(*segments, velocity=(0.0, 0.0), radius=0.5, horizon=1.0):
    planes, row = np.zeros((len(segments), 4)), 0
    for segment in segments:
        row = put_line(planes, row, segment, velocity, radius, horizon)
    return planes[:row]


def test_a_slow_approach_is_stopped_at_the_round_end():
    """Others 4 m ahead reach 1 m in 2 s at 1.5 m/s. From 0.5 m/s, 1 m/s more are permitted: half of it each."""
    assert agent((4.0, 0.0), (0.5, 0.0), (0.5, 0.0)) == pytest.approx([1.0, 0.0, 0.0, 1.0])


def test_all_of_the_change_is_taken_for_one_that_does_not_avoid():
    assert agent((4.0, 0.0), (0.5, 0.0), (0.5, 0.0), share=1.0) == pytest.approx([1.5, 0.0, 0.0, 1.0])


def test_a_fast_approach_turns_to_the_leg():
    """Radius 1 at 2 m: legs at 30 degrees. A relative velocity of (2, 0) leaves by 2 sin 30 = 1 m/s to the right."""
    half, cos = 0.5, math.cos(math.radians(30.0))
    planes = agent((2.0, 0.0), (1.0, 0.0), (2.0, 0.0))
    # The leg points back along (-cos, half), and u is (-half, -cos).
    assert planes == pytest.approx([1.0 - 0.5 * half, -0.5 * cos, -cos, half])


def test_those_that_overlap_part_within_one_period():
    """0.2 m too near, at rest: they must part at 2 m/s within 0.1 s, each at 1 m/s."""
    assert agent((0.8, 0.0), (0.0, 0.0), (0.0, 0.0)) == pytest.approx([-1.0, 0.0, 0.0, 1.0])


def test_those_at_one_place_get_a_half_plane_of_numbers():
    assert np.isfinite(agent((0.0, 0.0), (0.0, 0.0), (0.0, 0.0))).all()


def test_a_wall_ahead_limits_the_speed_towards_it():
    """2 m ahead, radius 0.5 m, horizon 1 s: at most 1.5 m/s ahead."""
    plane = line((2.0, -1.0, 2.0, 1.0))[0]
    assert plane[0] == pytest.approx(1.5)
    assert plane[2:] == pytest.approx([0.0, 1.0])


def test_the_ends_of_a_line_may_be_given_in_any_order():
    np.testing.assert_array_equal(line((2.0, -1.0, 2.0, 1.0)), line((2.0, 1.0, 2.0, -1.0)))


def test_a_point_limits_the_speed_by_its_round_end():
    plane = line((2.0, 0.0, 2.0, 0.0))[0]
    assert plane == pytest.approx([1.5, 0.0, 0.0, 1.0])


def test_a_touched_wall_permits_no_velocity_towards_it():
    assert line((0.4, -1.0, 0.4, 1.0)) == pytest.approx(np.array([[0.0, 0.0, 0.0, 1.0]]))


def test_a_touched_end_permits_no_velocity_towards_it():
    """The wall begins 0.3 m ahead and leads on: only its end is touched."""
    assert line((0.3, 0.0, 2.0, 0.0)) == pytest.approx(np.array([[0.0, 0.0, 0.0, 1.0]]))


def test_past_the_end_of_a_wall_the_leg_counts():
    """A wall from (1, 0) to (1, -3), and 1 m/s ahead and 0.4 to the left: its end's leg is at 30 degrees.

    The nearest permitted velocity is on that leg, so its distance from (1, 0.4) is sin 30 - 0.4 cos 30.
    """
    plane = line((1.0, 0.0, 1.0, -3.0), velocity=(2.0, 0.8))[0]
    cos, sin = math.cos(math.radians(30.0)), 0.5
    assert plane[2:] == pytest.approx([cos, sin])
    assert plane[2] * (plane[1] - 0.8) - plane[3] * (plane[0] - 2.0) == pytest.approx(2.0 * sin - 0.8 * cos)


def test_what_another_line_covers_adds_none():
    """A point 1 m behind the middle of a wall."""
    assert len(line((2.0, -5.0, 2.0, 5.0), (3.0, 0.0, 3.0, 0.0))) == 1

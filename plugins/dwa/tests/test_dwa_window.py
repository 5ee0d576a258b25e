"""The dynamic window, its arcs, and the speeds that can be stopped, with numbers that can be checked by hand."""

import math

import numpy as np
import pytest
from navloom_dwa.rollout import highest_speeds, ramp
from navloom_dwa.window import reachable, sample_arcs, stoppable_speed, within


def arcs_of(window, count=41, lever=0.5, half_track=0.3, rim=math.inf):
    arcs = np.zeros((count, 4))
    sample_arcs(window, lever, half_track, rim, arcs)
    return arcs


def test_the_window_is_what_can_be_reached_within_its_time():
    """0.3 m/s, 0.25 s at 0.5 and 1 m/s^2: 0.05 to 0.425 m/s; at most 0.4, at least 0.1 where that is allowed."""
    assert reachable(0.3, 0.0, 1.0, 0.5, 1.0, 0.25) == pytest.approx((0.05, 0.425))
    assert reachable(0.3, 0.1, 0.4, 0.5, 1.0, 0.25) == pytest.approx((0.1, 0.4))


def test_out_of_the_allowed_speeds_the_window_is_the_nearest_allowed():
    assert reachable(-0.5, 0.0, 1.0, 0.5, 1.0, 0.25) == (0.0, 0.0)
    assert reachable(2.0, 0.0, 1.0, 0.5, 1.0, 0.25) == (1.0, 1.0)


def test_the_papers_admissible_speed_is_the_root_of_2_d_b():
    assert stoppable_speed(2.0, 1.0, 0.0) == pytest.approx(2.0)
    assert stoppable_speed(math.inf, 1.0, 0.0) == math.inf
    assert stoppable_speed(-0.1, 1.0, 0.0) == 0.0


def test_with_a_reaction_time_reaction_and_braking_fill_the_distance():
    """2 m at 1 m/s^2 and 0.5 s: v 0.5 + v^2 / 2 = 2."""
    v = stoppable_speed(2.0, 1.0, 0.5)
    assert v * 0.5 + 0.5 * v * v == pytest.approx(2.0)


def test_within_is_the_part_of_a_ray_between_two_bounds():
    assert within(0.0, 9.0, 2.0, 1.0, 4.0) == (0.5, 2.0)
    assert within(0.0, 9.0, -2.0, -4.0, 1.0) == (0.0, 2.0)
    assert within(0.0, 9.0, 0.0, -1.0, 1.0) == (0.0, 9.0)
    low, high = within(0.0, 9.0, 0.0, 0.5, 1.0)
    assert low > high


def test_arcs_stay_in_the_window_and_reach_its_corners():
    window = (0.2, 0.5, -0.3, 0.4)
    arcs = arcs_of(window)
    speeds = np.concatenate([arcs[:, :2] * arcs[:, 2:3], arcs[:, :2] * arcs[:, 3:4]])
    assert speeds[:, 0].min() == pytest.approx(0.2, abs=1e-6) and speeds[:, 0].max() == pytest.approx(0.5, abs=1e-6)
    assert speeds[:, 1].min() == pytest.approx(-0.3, abs=1e-6) and speeds[:, 1].max() == pytest.approx(0.4, abs=1e-6)
    np.testing.assert_allclose(np.hypot(arcs[:, 0], 0.5 * arcs[:, 1]), 1.0)


def test_one_arc_is_straight_ahead_where_the_window_holds_it():
    assert (arcs_of((0.0, 0.5, -0.3, 0.4))[:, 1] == 0.0).sum() == 1
    assert not (arcs_of((0.1, 0.5, 0.1, 0.4))[:, 1] == 0.0).any()


def test_a_window_that_holds_standing_spans_turns_in_place_to_both_sides():
    arcs = arcs_of((0.0, 0.1, -0.4, 0.4))
    assert (arcs[0, 0], arcs[-1, 0]) == (0.0, 0.0)
    assert (arcs[0, 1] * arcs[0, 3], arcs[-1, 1] * arcs[-1, 3]) == pytest.approx((-0.4, 0.4))


def test_wheels_bound_speed_and_turn_together():
    """|v| + 0.3 |w| <= 0.5: turning at 1 rad/s leaves 0.2 m/s."""
    arcs = arcs_of((0.0, 0.5, -1.0, 1.0), rim=0.5)
    assert (np.abs(arcs[:, 0]) + 0.3 * np.abs(arcs[:, 1])) * arcs[:, 3] == pytest.approx(np.minimum(
        0.5, (np.abs(arcs[:, 0]) + 0.3 * np.abs(arcs[:, 1])) * np.where(arcs[:, 1] == 0, 9.0, 1.0 / np.maximum(
            1e-12, np.abs(arcs[:, 1])))))  # fmt: skip


def test_the_highest_speed_of_an_arc_stops_both_way_and_turn_before_the_contact():
    """Straight, 2 m at 1 m/s^2: 2 m/s. In place, 0.5 rad at 1 rad/s^2: 1 rad/s. No contact: no limit."""
    arcs = np.array([[1.0, 0.0, 0.0, 9.0], [0.0, 2.0, 0.0, 9.0], [1.0, 0.0, 0.0, 9.0]])
    limits = np.zeros(3)
    highest_speeds(arcs, np.array([2.0, 0.25, math.inf]), 1.0, 1.0, 0.0, limits)
    np.testing.assert_allclose(limits, [2.0, 0.5, math.inf])


def test_the_ramp_is_that_of_the_gate():
    assert ramp(0.3, 1.0, 0.5, 1.0, 0.1) == pytest.approx(0.35)
    assert ramp(0.3, 0.0, 0.5, 1.0, 0.1) == pytest.approx(0.2)
    assert ramp(0.05, -0.2, 0.5, 1.0, 0.1) == pytest.approx(-0.05)
    assert ramp(-0.1, -0.2, 0.5, 1.0, 0.1) == pytest.approx(-0.15)

"""Turn rate, low-pass, speed rule, trap and wall: the printed numbers of the paper."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from navloom_vff.following import WallFollowing, is_turned_away, wall_direction
from navloom_vff.steering import forward_speed, low_pass, slowed_for_turn, turn_rate

Angle = st.floats(-math.pi, math.pi)
UP, LEFT, RIGHT, DOWN = 0.5 * math.pi, math.pi, 0.0, -0.5 * math.pi


def test_turn_rate_is_the_gain_times_the_shorter_way_round_within_its_limit():
    limit = math.radians(25.0)
    assert turn_rate(math.radians(10.0), 0.0, 1.25, limit) == pytest.approx(math.radians(12.5))
    assert turn_rate(math.radians(-175.0), math.radians(175.0), 1.25, limit) == pytest.approx(math.radians(12.5))
    assert turn_rate(math.radians(170.0), 0.0, 1.25, limit) == limit
    assert turn_rate(math.radians(-170.0), 0.0, 1.25, limit) == -limit


def test_the_low_pass_takes_an_eighth_of_the_way_a_tick():
    """T = 0.05 s, tau = 0.4 s: T / tau = 1 / 8."""
    assert low_pass(0.0, 0.8, 0.05, 0.4) == pytest.approx(0.1)
    assert low_pass(0.1, 0.8, 0.05, 0.4) == pytest.approx(0.1875)


def test_a_step_reaches_63_percent_after_about_tau():
    """1 - (7 / 8)^8 = 0.656."""
    value = 0.0
    for _ in range(8):
        value = low_pass(value, 1.0, 0.05, 0.4)
    assert value == pytest.approx(1.0 - 0.875**8)


def test_a_time_constant_of_no_more_than_the_period_filters_nothing():
    assert low_pass(0.3, 0.8, 0.05, 0.0) == 0.8
    assert low_pass(0.3, 0.8, 0.1, 0.05) == 0.8


def test_speed_is_whole_without_force_and_falls_with_the_cosine():
    """As printed: V_max without force, V_max (1 - |cos theta|) with any."""
    assert forward_speed(0.0, 0.0, 0.5, True, 0.0) == 0.5
    assert forward_speed(0.01, -0.6, 0.5, True, 0.0) == pytest.approx(0.2)
    assert forward_speed(9.0, 0.0, 0.5, True, 0.0) == 0.5
    assert forward_speed(9.0, -1.0, 0.5, True, 0.0) == 0.0
    assert forward_speed(9.0, 1.0, 0.5, True, 0.0) == 0.0


def test_a_weak_push_slows_little_and_one_from_behind_not_at_all():
    assert forward_speed(0.5, -0.6, 0.5, False, 1.0) == pytest.approx(0.5 * (1.0 - 0.3))
    assert forward_speed(2.0, -0.6, 0.5, False, 1.0) == pytest.approx(0.2)
    assert forward_speed(2.0, 0.6, 0.5, False, 1.0) == 0.5


def test_speed_counts_as_far_as_it_leads_in_the_direction():
    assert slowed_for_turn(0.4, math.radians(60.0), 0.0) == pytest.approx(0.2)
    assert slowed_for_turn(0.4, math.radians(91.0), 0.0) == 0.0


@given(st.floats(0.0, 100.0), st.floats(-1.0, 1.0), st.booleans(), st.floats(0.0, 10.0), Angle)
def test_speed_is_within_its_limits(strength, cosine, slows_leaving, full, turn):
    speed = slowed_for_turn(forward_speed(strength, cosine, 0.5, slows_leaving, full), turn, 0.0)
    assert 0.0 <= speed <= 0.5


@given(Angle, Angle, st.floats(-1.0, 1.0))
def test_the_filtered_turn_rate_is_within_its_limit(direction, heading, previous):
    limit = 1.0
    assert abs(low_pass(previous, turn_rate(direction, heading, 5.0, limit), 0.05, 0.4)) <= limit + 1e-12


def test_more_than_ninety_degrees_off_the_target_is_turned_away():
    assert is_turned_away(math.radians(91.0), 0.0)
    assert not is_turned_away(math.radians(89.0), 0.0)
    assert not is_turned_away(math.radians(-175.0), math.radians(100.0))


def test_the_pull_along_a_wall_ahead_is_into_it_by_alpha_less_ninety():
    """The wall is up, F_r points down. With the wall on the right (it goes left): 145 - 90 = 55 deg into the wall."""
    assert wall_direction((0.0, -2.0), -1, math.radians(145.0)) == pytest.approx(math.radians(180.0 - 55.0))
    assert wall_direction((0.0, -2.0), 1, math.radians(145.0)) == pytest.approx(math.radians(55.0))


def test_the_wall_is_followed_in_the_sense_the_robot_has_turned_to():
    for heading, side in ((LEFT, -1), (RIGHT, 1), (UP + 0.1, -1), (UP - 0.1, 1)):
        following = WallFollowing()
        following.begin((0.0, -2.0), heading, math.radians(145.0), 3.0)
        assert (following.side, following.start) == (side, 3.0)


def test_at_the_end_nothing_is_kept():
    following = WallFollowing(hesitated=5.0)
    following.begin((1.0, 0.0), DOWN, math.radians(145.0), 3.0)
    following.end()
    assert following == WallFollowing()


@given(Angle, st.sampled_from([-1, 1]), st.floats(91.0, 179.0))
def test_where_the_wall_pushes_back_enough_the_resultant_is_along_it(theta_r, side, alpha_deg):
    """F_r = -cos(alpha) of the pull cancels its part into the wall; what is left is at a right angle to F_r."""
    alpha = math.radians(alpha_deg)
    push = (math.cos(theta_r), math.sin(theta_r))
    pull = wall_direction(push, side, alpha)
    x, y = math.cos(pull) - math.cos(alpha) * push[0], math.sin(pull) - math.cos(alpha) * push[1]
    assert x * push[0] + y * push[1] == pytest.approx(0.0, abs=1e-12)
    assert push[0] * y - push[1] * x == pytest.approx(side * math.sin(alpha))

"""VFH: choice of the valley, of the direction in it, and of the speed."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from navloom_avoidance.steering import wrap
from navloom_vfh.steering import forward_speed, turn_rate
from navloom_vfh.valleys import nearest_valley, target_offset, valley_direction

N, WIDEST = 72, 18


def direction(valley, target_deg):
    return math.degrees(valley_direction(valley, N, WIDEST, math.radians(target_deg)))


def test_the_nearer_border_is_the_distance_of_a_valley():
    """Sectors 6..15 are 30 to 80 deg."""
    assert target_offset((6, 10), N, math.radians(50.0)) == 0.0
    assert target_offset((6, 10), N, math.radians(10.0)) == pytest.approx(math.radians(20.0))
    assert target_offset((6, 10), N, math.radians(-170.0)) == pytest.approx(math.radians(110.0))


def test_the_valley_nearest_to_the_target_is_taken():
    assert nearest_valley([(6, 10), (30, 4)], N, math.radians(100.0)) == (6, 10)
    assert nearest_valley([(6, 10), (30, 4)], N, math.radians(140.0)) == (30, 4)
    assert nearest_valley([], N, 0.0) is None


def test_a_narrow_valley_is_passed_midway():
    """(30 + 80) / 2."""
    assert direction((6, 10), 100.0) == pytest.approx(55.0)


def test_a_wide_valley_is_followed_half_s_max_from_its_near_border():
    """30 to 180 deg, s_max = 90 deg: from the right border (30 + 120) / 2, from the left (180 + 90) / 2."""
    assert direction((6, 30), 10.0) == pytest.approx(75.0)
    assert direction((6, 30), -170.0) == pytest.approx(135.0)


def test_a_target_well_inside_a_wide_valley_is_headed_for():
    assert direction((6, 30), 100.0) == pytest.approx(100.0)
    assert direction((6, 30), 60.0) == pytest.approx(75.0)


def test_open_space_leads_straight_to_the_target():
    assert direction((0, 72), -123.0) == pytest.approx(-123.0)


Valley = st.tuples(st.integers(0, N - 1), st.integers(1, N - 1))


@given(Valley, st.floats(-math.pi, math.pi - 1e-9))
def test_the_direction_is_inside_the_valley_by_half_its_width_or_half_s_max(valley, target):
    alpha = 2.0 * math.pi / N
    inside = (valley_direction(valley, N, WIDEST, target) - valley[0] * alpha) % (2.0 * math.pi)
    inset = 0.5 * min(valley[1], WIDEST) * alpha
    assert inset - 1e-9 <= inside <= valley[1] * alpha - inset + 1e-9


@given(Valley, st.integers(-N, N), st.floats(0.0, 2.0 * math.pi))
def test_turning_valley_and_target_turns_the_direction(valley, turn, target):
    alpha = 2.0 * math.pi / N
    first, width = valley
    # Halfway between the borders either may be the nearer one, by rounding.
    middle = (first + 0.5 * width) * alpha
    if min(abs(wrap(target - middle)), abs(wrap(target - middle - math.pi))) < 1e-6:
        return
    here = valley_direction(valley, N, WIDEST, target)
    there = valley_direction(((first + turn) % N, width), N, WIDEST, target + turn * alpha)
    assert abs(wrap(there - here - turn * alpha)) < 1e-9


def test_speed_falls_with_the_density_ahead_and_with_the_turn():
    """V' = 0.8 (1 - 1/4) = 0.6; half the turn rate leaves half of it."""
    assert forward_speed(1.0, 4.0, 0.0, 2.0, 0.8, 0.04) == pytest.approx(0.6)
    assert forward_speed(1.0, 4.0, -1.0, 2.0, 0.8, 0.04) == pytest.approx(0.3)
    assert forward_speed(0.0, 4.0, 0.0, 2.0, 0.8, 0.04) == 0.8


def test_speed_never_falls_below_the_least():
    assert forward_speed(9.0, 4.0, 0.0, 2.0, 0.8, 0.04) == 0.04
    assert forward_speed(0.0, 4.0, 2.0, 2.0, 0.8, 0.04) == 0.04


@given(st.floats(0.0, 50.0), st.floats(-3.0, 3.0))
def test_speed_is_within_its_limits(density, turn):
    assert 0.04 <= forward_speed(density, 4.0, turn, 2.0, 0.8, 0.04) <= 0.8


def test_turn_rate_is_the_gain_times_the_shorter_way_round_within_its_limit():
    limit = math.radians(25.0)
    assert turn_rate(math.radians(-175.0), math.radians(175.0), 2.0, limit) == pytest.approx(math.radians(20.0))
    assert turn_rate(math.radians(-30.0), 0.0, 2.0, limit) == -limit


def test_a_free_circle_is_driven_to_the_target_wrapped():
    assert valley_direction((0, 72), 72, 18, 4.0) == pytest.approx(4.0 - 2.0 * math.pi)

"""Pure pursuit and the limits of the drive, by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from navloom_lyapunov_tracker.law import TrackingError
from navloom_trackers.limits import DriveLimits, within_limits, within_reach
from navloom_trackers.pure_pursuit import (
    curvature_speed,
    look_ahead,
    proximity_speed,
    pursuit_curvature,
    pursuit_point,
    reaching,
)


def line(length=5.0, step=0.02):
    """(n, 6) along the x axis."""
    s = np.linspace(0.0, length, round(length / step) + 1)
    zero = np.zeros_like(s)
    return np.column_stack((s, s, zero, zero, zero, np.full_like(s, 0.3)))


def bend(radius, angle=2.0 * math.pi, steps=500):
    """(n, 6) circle to the left, from the origin, facing x."""
    turn = np.linspace(0.0, angle, steps + 1)
    columns = (radius * turn, radius * np.sin(turn), radius * (1.0 - np.cos(turn)), turn)
    return np.column_stack((*columns, np.full_like(turn, 1.0 / radius), np.full_like(turn, 0.3)))


@pytest.mark.parametrize(("speed", "away"), [(0.4, 0.6), (0.1, 0.5), (2.0, 0.9), (-0.2, 0.5)])
def test_the_look_ahead_grows_with_speed_within_bounds(speed, away):
    assert look_ahead(speed, 1.5, 0.5, 0.9) == pytest.approx(away)


def test_far_beside_the_look_ahead_is_longer():
    assert reaching(0.5, -1.0, math.pi / 6.0) == pytest.approx(2.0)
    assert reaching(0.5, 0.2, math.pi / 6.0) == 0.5


@pytest.mark.parametrize(
    ("ahead", "left", "curvature"), [(1.0, 1.0, 1.0), (2.0, 0.0, 0.0), (0.0, -0.5, -4.0), (0.0, 0.0, 0.0)]
)
def test_the_arc_to_a_point(ahead, left, curvature):
    assert pursuit_curvature(ahead, left) == pytest.approx(curvature)


@given(st.floats(0.3, 5.0), st.floats(0.05, 3.0))
def test_a_point_on_a_circle_gives_the_circle(radius, turn):
    assert pursuit_curvature(radius * math.sin(turn), radius * (1.0 - math.cos(turn))) == pytest.approx(1.0 / radius)


@pytest.mark.parametrize(
    ("speed", "curvature", "slowed"),
    [(0.4, 0.5, 0.4), (0.4, -2.0, 0.2), (0.4, 4.0, 0.1), (0.4, 40.0, 0.05), (0.03, 40.0, 0.03)],
)
def test_speed_in_tight_arcs(speed, curvature, slowed):
    assert curvature_speed(speed, curvature, 1.0, 0.05) == pytest.approx(slowed)


@pytest.mark.parametrize(
    ("speed", "distance", "slowed"), [(0.4, 1.0, 0.4), (0.4, 0.3, 0.2), (0.4, 0.0, 0.05), (0.4, -0.1, 0.05)]
)
def test_speed_near_the_end(speed, distance, slowed):
    assert proximity_speed(speed, distance, 0.6, 0.05) == pytest.approx(slowed)


def test_the_point_is_one_look_ahead_away():
    # 0.3 m beside a line: 0.4 m further on of 0.5 m.
    assert pursuit_point(line(), 1.0, 1.0, 0.3, 0.5) == pytest.approx((1.4, 0.0), abs=1e-4)


@given(st.floats(0.0, 4.0), st.floats(-0.25, 0.25), st.floats(0.3, 0.9))
def test_the_point_of_a_bend_is_one_look_ahead_away_and_on_it(turn, beside, away):
    samples, radius = bend(1.5, 1.6 * math.pi), 1.5
    x, y = (radius - beside) * math.sin(turn), radius - (radius - beside) * math.cos(turn)
    px, py = pursuit_point(samples, radius * turn, x, y, away)
    assert math.hypot(px - x, py - y) == pytest.approx(away, abs=1e-3)
    assert math.hypot(px, py - radius) == pytest.approx(radius, abs=1e-3)


def test_a_robot_farther_off_than_its_look_ahead_heads_for_its_foot():
    assert pursuit_point(line(), 1.0, 1.0, 2.0, 0.5) == pytest.approx((1.0, 0.0))


def test_beyond_its_end_the_trajectory_goes_on_straight():
    assert pursuit_point(line(), 4.9, 4.9, 0.3, 0.5) == pytest.approx((5.3, 0.0))
    # A quarter circle of 1 m ends at (1, 1), facing y; 0.4 m of (1, 1.2) is 0.6 m further on.
    assert pursuit_point(bend(1.0, 0.5 * math.pi), 1.5, 1.0, 1.2, 0.4) == pytest.approx((1.0, 1.6))


def test_in_a_bend_too_small_for_its_look_ahead_it_heads_for_the_far_side():
    # No point of a circle of 0.3 m is more than 0.6 m away; the farthest is the one across.
    assert pursuit_point(bend(0.3, 4.0 * math.pi), 0.0, 0.0, 0.0, 0.9) == pytest.approx((0.0, 0.6), abs=0.01)


def test_the_other_leg_of_a_hairpin_is_out_of_sight():
    there, back = line(4.0), line(4.0)
    back[:, 0] += 4.0
    back[:, 1], back[:, 2], back[:, 3] = back[::-1, 1], 0.5, -math.pi
    assert pursuit_point(np.concatenate((there, back[1:])), 1.0, 1.0, 0.1, 0.6)[1] == pytest.approx(0.0)


def test_a_trajectory_without_length():
    samples = np.array([[0.0, 1.0, 0.0, 0.0, 0.0, 0.2]])
    assert pursuit_point(samples, 0.0, 0.7, 0.0, 0.5) == pytest.approx((1.2, 0.0))


# --- limits ----------------------------------------------------------------------------------------------------------

LIMITS = DriveLimits(0.5, 0.4, 12.0, 0.05, 0.3, may_reverse=False)


@pytest.mark.parametrize(
    ("wanted", "given"),
    [
        ((0.3, 0.2), (0.3, 0.2)),
        ((1.0, 0.2), (0.5, 0.1)),
        ((0.3, -4.0), (0.03, -0.4)),
        # The outer wheel would run at (0.5 + 0.3 * 0.4) / 0.05 = 12.4 rad/s.
        ((0.5, 0.4), (0.5 * 12.0 / 12.4, 0.4 * 12.0 / 12.4)),
        ((-0.3, 0.2), (0.0, 0.2)),
    ],
)
def test_a_velocity_beyond_a_limit_is_scaled(wanted, given):
    assert within_limits(*wanted, LIMITS) == pytest.approx(given)


def test_a_drive_that_may_reverse_drives_backwards():
    assert within_limits(-1.0, 0.2, LIMITS._replace(may_reverse=True)) == pytest.approx((-0.5, 0.1))


@given(st.floats(0.0, 9.0), st.floats(-9.0, 9.0))
def test_every_limit_holds_and_the_curvature_stays(v, w):
    slower, turning = within_limits(v, w, LIMITS)
    assert slower <= 0.5 + 1e-12 and abs(turning) <= 0.4 + 1e-12
    assert (slower + 0.3 * abs(turning)) / 0.05 <= 12.0 + 1e-9
    assert slower * w == pytest.approx(v * turning)


@pytest.mark.parametrize(
    ("given", "seen"), [((0.1, -0.2), (0.1, -0.2)), ((0.4, -0.7), (0.25, -0.25))], ids=["in", "out"]
)
def test_a_law_looks_no_farther_than_its_reach(given, seen):
    assert within_reach(TrackingError(*given, 2.0), 0.25) == (*seen, 2.0)

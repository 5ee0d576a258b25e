"""Equations (4), (6) and (7), and the closed loop that they form."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from navloom_lyapunov_tracker.law import (
    TrackingError,
    energy,
    final_turn,
    planar_command,
    sinc,
    stopping_turn,
    tracking_command,
    tracking_error,
    turn_acceleration,
    turn_direction,
    turn_that_stops,
    wrap,
)
from scipy.integrate import solve_ivp

EXACT = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13}


def poses_over_time(start, v_ref, w_ref, k1, k3, times):
    """Robot and reference (6, n) x, y, heading each, as unicycles.

    The heading of the robot is not wrapped. Independent of the paper's eq. (5).
    """

    def rates(_, s):
        v, w = tracking_command(tracking_error(*s), v_ref, w_ref, k1, k3)
        return [v * math.cos(s[2]), v * math.sin(s[2]), w, v_ref * math.cos(s[5]), v_ref * math.sin(s[5]), w_ref]

    solved = solve_ivp(rates, (0.0, times[-1]), start, t_eval=times, **EXACT)
    assert solved.success
    return solved.y


def errors_over_time(*args):
    return np.array([tracking_error(*state) for state in poses_over_time(*args).T]).T


# --- the equations ---------------------------------------------------------------------------------------------------


def test_a_reference_ahead_and_to_the_left():
    assert tracking_error(1.0, 2.0, 0.0, 3.0, 2.5, 0.1) == pytest.approx((2.0, 0.5, 0.1))


def test_the_error_is_seen_in_the_frame_of_the_robot():
    facing_up = tracking_error(1.0, 2.0, 0.5 * math.pi, 3.0, 2.5, 0.5 * math.pi)
    assert facing_up == pytest.approx((0.5, -2.0, 0.0)), "what is to the east is to the right of who faces north"


def test_the_heading_error_goes_the_short_way():
    assert tracking_error(0.0, 0.0, math.radians(170.0), 0.0, 0.0, math.radians(-170.0)).e3 == pytest.approx(
        math.radians(20.0)
    )


@pytest.mark.parametrize(
    ("angle", "wrapped"),
    [(math.pi, -math.pi), (-math.pi, -math.pi), (3.0, 3.0), (7.0, 7.0 - 2.0 * math.pi), (-1e-17, 0.0)],
)
def test_wrap(angle, wrapped):
    assert wrap(angle) == pytest.approx(wrapped)
    assert -math.pi <= wrap(angle) < math.pi


@given(st.floats(-1e3, 1e3))
def test_wrapping_keeps_the_direction(angle):
    assert -math.pi <= wrap(angle) < math.pi
    assert math.cos(wrap(angle)) == pytest.approx(math.cos(angle), abs=1e-9)
    assert math.sin(wrap(angle)) == pytest.approx(math.sin(angle), abs=1e-9)


def test_sinc_is_smooth_through_its_series():
    assert sinc(0.0) == 1.0
    assert sinc(-math.pi) == pytest.approx(0.0, abs=1e-15)
    assert sinc(0.5 * math.pi) == pytest.approx(2.0 / math.pi)
    assert sinc(0.99999e-4) == pytest.approx(math.sin(0.99999e-4) / 0.99999e-4, abs=1e-15)


def test_the_command_by_hand():
    v, w = tracking_command(TrackingError(0.5, 0.2, math.pi / 6.0), 0.3, 0.1, k1=2.0, k3=0.6)
    assert v == pytest.approx(0.3 * math.sqrt(0.75) + 1.0)
    assert w == pytest.approx(0.1 + 0.1 * math.pi + 0.3 * 0.2 * 3.0 / math.pi)


def test_a_robot_on_its_reference_gets_the_feedforward():
    assert tracking_command(TrackingError(0.0, 0.0, 0.0), 0.3, -0.2, 1.0, 0.6) == (0.3, -0.2)


@pytest.mark.parametrize(
    ("error", "sign_v", "sign_w"),
    [((0.1, 0.0, 0.0), 1, 0), ((0.0, 0.1, 0.0), 0, 1), ((0.0, -0.1, 0.0), 0, -1), ((0.0, 0.0, 0.1), -1, 1)],
)
def test_the_command_turns_towards_the_reference(error, sign_v, sign_w):
    v, w = tracking_command(TrackingError(*error), 0.3, 0.0, 1.0, 0.6)
    assert np.sign(round(v - 0.3, 12)) == sign_v
    assert np.sign(w) == sign_w


@given(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0), st.floats(-3.0, 3.0), st.floats(0.0, 0.5), st.floats(-0.4, 0.4))
def test_mirrored_errors_give_mirrored_commands(e1, e2, e3, v_ref, w_ref):
    v, w = tracking_command(TrackingError(e1, e2, e3), v_ref, w_ref, 1.0, 0.6)
    assert tracking_command(TrackingError(e1, -e2, -e3), v_ref, -w_ref, 1.0, 0.6) == (v, -w)


# --- the closed loop --------------------------------------------------------------------------------------------------

starts = st.tuples(
    st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(-2.5, 2.5), st.floats(-3.0, 3.0), st.floats(-3.0, 3.0)
)


@settings(max_examples=40, deadline=None)
@given(starts, st.floats(0.0, 0.5), st.floats(-0.43, 0.43), st.floats(0.1, 5.0), st.floats(0.1, 5.0))
def test_the_energy_falls_by_k1_e1_squared_and_k3_e3_squared(start, v_ref, w_ref, k1, k3):
    """Eq. (9), compared with five-point differences of eq. (7) along the integrated motion of robot and reference."""
    e1, e2, e3, x, y = start
    heading_ref, h = 0.7, 1e-3
    heading = heading_ref - e3
    x_ref = x + e1 * math.cos(heading) - e2 * math.sin(heading)
    y_ref = y + e1 * math.sin(heading) + e2 * math.cos(heading)
    centres = np.array([0.1, 0.7, 2.0])
    times = (centres[:, None] + h * np.arange(-2, 3)).ravel()
    errors = errors_over_time([x, y, heading, x_ref, y_ref, heading_ref], v_ref, w_ref, k1, k3, times)
    levels = np.array([energy(TrackingError(*error)) for error in errors.T])
    slopes = levels.reshape(3, 5) @ [1.0, -8.0, 0.0, 8.0, -1.0] / (12.0 * h)
    now = errors[:, 2::5]
    assert slopes == pytest.approx(-k1 * now[0] ** 2 - k3 * now[2] ** 2, abs=1e-6)


@settings(max_examples=15, deadline=None)
@given(starts, st.floats(0.2, 0.4), st.floats(-0.4, 0.4))
def test_every_error_vanishes_while_the_reference_moves(start, v_ref, w_ref):
    e1, e2, e3, x, y = start
    errors = errors_over_time([x, y, -e3, x + e1, y + e2, 0.0], v_ref, w_ref, 1.0, 0.6, np.array([0.0, 200.0]))
    assert np.abs(errors[:, -1]).max() < 1e-3


def test_with_a_stopped_reference_the_lateral_error_remains():
    errors = errors_over_time([0.0, 0.0, 0.0, 0.4, 0.3, 0.0], 0.0, 0.0, 1.0, 0.6, np.array([0.0, 40.0]))
    assert errors[:, -1] == pytest.approx([0.0, 0.3, 0.0], abs=1e-12)


def settling_time(v_ref, k1, k3, band=0.02, end=80.0):
    """When the *position* error hypot(e1, e2), from e = (0, 0.3, 0) on a straight line, was last `band` or more, s."""
    times = np.arange(0.0, end, 0.01)
    errors = errors_over_time([0.0, -0.3, 0.0, 0.0, 0.0, 0.0], v_ref, 0.0, k1, k3, times)
    outside = np.flatnonzero(np.hypot(errors[0], errors[1]) >= band)
    return times[outside[-1]]


@pytest.mark.parametrize(("k3", "seconds"), [(0.3, 17.0), (0.6, 14.6), (1.0, 28.2), (2.0, 59.3)])
def test_settling_times(k3, seconds):
    assert settling_time(0.3, 1.0, k3) == pytest.approx(seconds, abs=0.1)


def test_a_large_heading_gain_settles_slowly():
    assert settling_time(0.3, 1.0, 5.0) > 60.0


def test_the_critical_gain_has_no_overshoot_and_half_of_it_has():
    """Lateral poles s² + k3 s + v_ref²: a double one at -v_ref for k3 = 2 v_ref; e2 = 0.3 (1 + t v) exp(-v t)."""
    times = np.arange(0.0, 40.0, 0.05)
    start = [0.0, -0.001, 0.0, 0.0, 0.0, 0.0]
    critical = errors_over_time(start, 0.3, 0.0, 1.0, 0.6, times)[1]
    assert critical == pytest.approx(0.001 * (1.0 + 0.3 * times) * np.exp(-0.3 * times), abs=1e-8)
    assert errors_over_time(start, 0.3, 0.0, 1.0, 0.3, times)[1].min() < -1e-4


# --- robustness ------------------------------------------------------------------------------------------------------

RADIUS, HALF_TRACK = 0.05, 0.30


def real_twist(v, w, left, right, half_track):
    """Motion of a robot whose wheels have other radii and another track than its wheel commands assume: eq. (2)."""
    w_right, w_left = (v + HALF_TRACK * w) / RADIUS, (v - HALF_TRACK * w) / RADIUS
    return 0.5 * (right * w_right + left * w_left), (right * w_right - left * w_left) / (2.0 * half_track)


def follow_line(left, right, half_track, seconds=60.0, period=0.01):
    """e1, e2, e3 at the end, behind a reference at 0.3 m/s along the x axis, from e2 = 0.3."""
    x, y, heading = 0.0, -0.3, 0.0
    for k in range(round(seconds / period)):
        error = tracking_error(x, y, heading, 0.3 * k * period, 0.0, 0.0)
        v, w = real_twist(*tracking_command(error, 0.3, 0.0, 1.0, 0.6), left, right, half_track)
        x += v * period * math.cos(heading + 0.5 * w * period)
        y += v * period * math.sin(heading + 0.5 * w * period)
        heading += w * period
    return error


@pytest.mark.parametrize(("radius", "track"), itertools.product([0.95, 1.05], [0.95, 1.05]))
def test_wrong_radius_and_track_leave_only_a_constant_lag(radius, track):
    error = follow_line(RADIUS * radius, RADIUS * radius, HALF_TRACK * track)
    assert error.e2 == pytest.approx(0.0, abs=1e-5)
    assert error.e3 == pytest.approx(0.0, abs=1e-5)
    # radius (v_ref + k1 e1) = v_ref
    assert error.e1 == pytest.approx(0.3 / radius - 0.3, abs=1e-4)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_unequal_wheels_leave_a_constant_offset(sign):
    """A wheel 5 % larger turns the robot by v (Δr / r) / 2R, which v_ref e2 must compensate."""
    error = follow_line(RADIUS * (1.0 - 0.025 * sign), RADIUS * (1.0 + 0.025 * sign), HALF_TRACK)
    assert error.e2 == pytest.approx(-sign * 0.05 / 0.60, rel=0.02)
    assert error.e3 == pytest.approx(0.0, abs=1e-4)


# --- turning in place ------------------------------------------------------------------------------------------------

ABOVE, UNTIL = math.radians(60.0), math.radians(20.0)


@pytest.mark.parametrize(
    ("e3_deg", "turning", "direction"),
    [
        (59, 0, 0),
        (61, 0, 1),
        (-61, 0, -1),
        (59, 1, 1),
        (21, 1, 1),
        (19, 1, 0),
        (-61, 1, -1),
        (-179, 1, 1),
        (179, -1, -1),
    ],
)
def test_turning_has_hysteresis_and_keeps_its_direction_near_180(e3_deg, turning, direction):
    assert turn_direction(math.radians(e3_deg), turning, ABOVE, UNTIL) == direction


def test_turning_can_be_switched_off():
    assert turn_direction(-math.pi, 0, math.pi, UNTIL) == 0


# --- robots that are slow to turn ------------------------------------------------------------------------------------


def test_a_turn_stops_in_time_at_half_the_turn_acceleration():
    """w²/2 = 0.1 e: from 0.3 rad/s a robot that brakes with 0.1 rad/s² turns by 0.45 rad."""
    assert turn_that_stops(-0.45, 1.0, 0.2) == pytest.approx(0.3)
    assert turn_that_stops(0.45, 0.25, 0.2) == 0.25
    assert turn_that_stops(0.45, 1.0, math.inf) == 1.0


@pytest.mark.parametrize("limit", [0.1, 0.2, 0.5, 1.0])
def test_a_final_turn_does_not_pass_its_heading(limit):
    """The robot changes its turn rate by `limit` times the time, and begins 120 degrees away."""
    left, w = math.radians(120.0), 0.0
    for _ in range(4000):
        wanted = final_turn(left, 1.0, limit)
        w += max(-0.01 * limit, min(0.01 * limit, wanted - w))
        left -= 0.01 * w
        assert left > math.radians(-0.5)
    assert abs(left) < math.radians(0.5)


def test_a_correction_is_limited_where_the_robot_could_not_end_it():
    """At gain 4 a correction of 0.8 rad/s turns by 0.2 rad: sqrt(0.2 * 0.2) = 0.2 rad/s can be stopped within that."""
    assert stopping_turn(-0.7, 0.1, 4.0, 0.2) == pytest.approx(-0.1)
    assert stopping_turn(0.14, 0.1, 4.0, 0.2) == 0.14
    assert stopping_turn(-0.7, 0.1, 4.0, math.inf) == -0.7


def test_a_reference_that_drives_backwards_is_followed_backwards() -> None:
    """Law (6) at v_r < 0 is the law of a robot that heads the other way: e1 and e2 change signs, and so does v."""
    error = TrackingError(0.2, 0.3, 0.1)
    v, w = tracking_command(error, -0.4, 0.2, 1.0, 0.6)
    other = tracking_command(TrackingError(-0.2, -0.3, 0.1), 0.4, 0.2, 1.0, 0.6)
    assert (-v, w) == pytest.approx(other)


def test_a_holonomic_robot_drives_at_its_errors() -> None:
    """0.4 m/s to the left of a reference that heads a quarter turn further left: backwards for the robot."""
    command = planar_command(TrackingError(0.1, -0.2, 0.5 * math.pi), (0.0, 0.4), 0.3, 2.0, 1.0)
    assert command == pytest.approx((-0.4 + 0.2, -0.4, 0.3 + 0.5 * math.pi))


def test_the_energy_of_a_holonomic_robots_error_falls() -> None:
    """V' = -k1 (e1² + e2²) - k3 e3²: 2 (0.09 + 0.04) + 0.5 0.16 = 0.34, whatever the reference does."""
    error, (ahead, left), w_ref = TrackingError(0.3, -0.2, 0.4), (0.5, -0.3), 0.2
    vx, vy, w = planar_command(error, (ahead, left), w_ref, 2.0, 0.5)
    cos, sin = math.cos(error.e3), math.sin(error.e3)
    rates = (
        w * error.e2 - vx + cos * ahead - sin * left,
        -w * error.e1 - vy + sin * ahead + cos * left,
        w_ref - w,
    )
    assert sum(part * rate for part, rate in zip(error, rates, strict=True)) == pytest.approx(-0.34)


def test_a_robot_that_steers_turns_faster_by_its_wheels() -> None:
    """0.4 m/s, 1 rad/s of steering, 0.5 m: 0.8 rad/s²."""
    assert turn_acceleration(0.4, math.inf, 0.5, 1.0) == turn_acceleration(-0.4, 2.0, 0.5, 1.0) == pytest.approx(0.8)
    assert turn_acceleration(0.4, 0.3, 0.0, 1.0) == 0.3, "it does not steer"

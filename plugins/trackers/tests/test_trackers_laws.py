"""Kanayama, Fierro-Lewis and RAMSETE: their equations by hand, and the closed loops that they form."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from navloom_lyapunov_tracker import law
from navloom_lyapunov_tracker.law import TrackingError, tracking_error
from navloom_trackers import fierro_lewis, kanayama, ramsete
from scipy.integrate import solve_ivp

EXACT = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13}
KANAYAMA = (10.0, 64.0, 16.0)
FIERRO_LEWIS = (10.0, 5.0, 4.0, 40.0)
RAMSETE = (0.7, 16.0)


# --- the equations ---------------------------------------------------------------------------------------------------


def test_the_error_is_that_of_kanayamas_figure_2():
    error = tracking_error(1.5, 1.0, math.pi / 6.0, 2.5, 1.0 + math.sqrt(3.0), math.pi / 4.0)
    assert error == pytest.approx((math.sqrt(3.0), 1.0, math.pi / 12.0))


def test_the_rates_of_the_error():
    # Straight ahead at 0.5 m/s and turning left: what is on the left moves ahead, what is ahead moves to the right.
    rates = kanayama.error_rates(TrackingError(1.0, 2.0, math.pi / 2.0), 0.5, 0.1, 0.3, 0.4)
    assert rates == pytest.approx((0.2 - 0.5, 0.3 - 0.1, 0.3))


def test_the_control_rule_of_kanayama():
    v, w = kanayama.control_rule(TrackingError(0.1, 0.02, math.pi / 6.0), 0.5, 0.2, *KANAYAMA)
    assert v == pytest.approx(0.5 * math.sqrt(0.75) + 1.0)
    assert w == pytest.approx(0.2 + 0.5 * (1.28 + 8.0))


def test_the_papers_gains_are_critical():
    assert kanayama.critical_gain(64.0) == 16.0


def test_the_energy_of_kanayama():
    assert kanayama.energy(TrackingError(0.3, 0.4, math.pi / 3.0), 2.0) == pytest.approx(0.125 + 0.25)


def test_at_its_reach_the_rule_of_kanayama_keeps_the_approach():
    reach = kanayama.reach(64.0, 16.0, math.pi / 6.0)
    assert reach == pytest.approx(0.125)
    assert kanayama.control_rule(TrackingError(0.0, reach, -math.pi / 6.0), 0.3, 0.1, *KANAYAMA)[1] == pytest.approx(
        0.1
    )


def test_the_gain_of_ramsete():
    assert ramsete.feedback_gain(0.4, 0.3, 0.5, 1.0) == pytest.approx(0.5)


def test_the_command_of_ramsete():
    # k = 2 * 0.5 * sqrt(0 + 4 * 0.25) = 1.
    v, w = ramsete.tracking_command(TrackingError(0.1, 0.2, math.pi / 6.0), 0.5, 0.0, 0.5, 4.0)
    assert v == pytest.approx(0.5 * math.sqrt(0.75) + 0.1)
    assert w == pytest.approx(math.pi / 6.0 + 4.0 * 0.5 * 0.2 * 3.0 / math.pi)


@given(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(-3.0, 3.0), st.floats(0.05, 1.0), st.floats(-1.0, 1.0))
def test_ramsete_with_b_1_is_law_6_with_both_gains_k(e1, e2, e3, v_ref, w_ref):
    error, k = TrackingError(e1, e2, e3), ramsete.feedback_gain(v_ref, w_ref, 0.7, 1.0)
    assert ramsete.tracking_command(error, v_ref, w_ref, 0.7, 1.0) == pytest.approx(
        law.tracking_command(error, v_ref, w_ref, k, k)
    )


def test_at_its_reach_ramsete_keeps_the_approach():
    # k = 2 * 0.7 * 4 * 0.3 = 1.68; 1.68 * (pi/4)^2 / (16 * 0.3 * sqrt(1/2)).
    reach = ramsete.reach(0.3, 0.0, *RAMSETE, math.pi / 4.0)
    assert reach == pytest.approx(1.68 * (math.pi / 4.0) ** 2 / (4.8 * math.sqrt(0.5)))
    assert ramsete.tracking_command(TrackingError(0.0, reach, -math.pi / 4.0), 0.3, 0.0, *RAMSETE)[1] == pytest.approx(
        0.0, abs=1e-12
    )


def test_the_energy_of_ramsete():
    assert ramsete.energy(TrackingError(0.3, 0.4, 2.0), 16.0) == pytest.approx(2.0 + 2.0)


def test_the_kinematic_law_of_fierro_and_lewis():
    v, w = fierro_lewis.kinematic_command(TrackingError(0.1, 0.2, math.pi / 6.0), 0.5, 0.2, 10.0, 5.0, 4.0)
    assert v == pytest.approx(0.5 * math.sqrt(0.75) + 1.0)
    assert w == pytest.approx(0.2 + 0.5 * (1.0 + 2.0))


def test_the_rates_of_the_kinematic_law():
    # e3 = 0: forward k1 e1', turn v_r (k2 e2' + k3 e3').
    rates = fierro_lewis.command_rates(TrackingError(0.0, 0.3, 0.0), TrackingError(0.1, 0.2, -0.1), 0.5, 10.0, 5.0, 4.0)
    assert rates == pytest.approx((1.0, 0.5 * (1.0 - 0.4)))
    # e3 = 90 deg: forward -v_r e3'.
    rates = fierro_lewis.command_rates(
        TrackingError(0.0, 0.3, 0.5 * math.pi), TrackingError(0.0, 0.0, 0.2), 0.5, 10.0, 5.0, 4.0
    )
    assert rates == pytest.approx((-0.1, 0.0))


def test_the_control_of_a_velocity_and_what_it_comes_to():
    assert fierro_lewis.acceleration(0.2, 0.3, 0.5, 40.0) == pytest.approx(4.5)
    # Of 0.1 m/s less, half is left after ln 2 / k4.
    assert fierro_lewis.velocity_after(0.2, 0.3, 0.0, 40.0, math.log(2.0) / 40.0) == pytest.approx(0.25)
    assert fierro_lewis.velocity_after(0.3, 0.3, 0.5, 40.0, 0.05) == pytest.approx(0.325)


@given(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(-2.0, 2.0), st.floats(1.0, 60.0))
@settings(max_examples=20)
def test_the_velocity_after_a_tick_is_the_integral_of_the_control(actual, command, rate, k4):
    solved = solve_ivp(
        lambda t, v: [fierro_lewis.acceleration(v[0], command + rate * t, rate, k4)], (0.0, 0.05), [actual], **EXACT
    )
    after = fierro_lewis.velocity_after(actual, command, rate, k4, 0.05)
    assert after == pytest.approx(solved.y[0, -1], abs=1e-10)


def test_the_foot_of_a_robot_inside_a_bend_moves_faster():
    # 1 m left of the path, half way to the centre of a circle of 2 m: the foot has twice as far to go.
    assert fierro_lewis.projected_speed(0.3, 0.0, 0.5, 1.0) == pytest.approx(0.6)
    assert fierro_lewis.projected_speed(0.3, math.pi / 3.0, 0.0, 5.0) == pytest.approx(0.15)
    assert fierro_lewis.projected_speed(0.3, 0.0, 0.5, 2.0) == pytest.approx(1.5), "at the centre it stays finite"


def test_the_energy_of_fierro_and_lewis():
    # k1 (e1^2 + e2^2) = 2.5; 2 k1 / k2 (1 - cos e3) = 2; (0.16 + 10 / (5 * 4 * 0.5) * 0.64) / 80 = 0.01.
    level = fierro_lewis.energy(TrackingError(0.3, 0.4, math.pi / 3.0), (0.4, 0.8), 0.5, FIERRO_LEWIS)
    assert level == pytest.approx(2.5 + 2.0 + 0.01)


LAWS = {
    "kanayama": lambda error, v_ref, w_ref: kanayama.control_rule(error, v_ref, w_ref, *KANAYAMA),
    "ramsete": lambda error, v_ref, w_ref: ramsete.tracking_command(error, v_ref, w_ref, *RAMSETE),
}
EACH_LAW = pytest.mark.parametrize("name", sorted(LAWS))


@EACH_LAW
@given(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(-3.0, 3.0), st.floats(0.05, 1.0), st.floats(-1.0, 1.0))
def test_mirrored_errors_give_mirrored_commands(name, e1, e2, e3, v_ref, w_ref):
    v, w = LAWS[name](TrackingError(e1, e2, e3), v_ref, w_ref)
    assert LAWS[name](TrackingError(e1, -e2, -e3), v_ref, -w_ref) == pytest.approx((v, -w))


@EACH_LAW
def test_a_robot_on_its_reference_gets_the_feedforward(name):
    assert LAWS[name](TrackingError(0.0, 0.0, 0.0), 0.3, -0.2) == (0.3, -0.2)


# --- the closed loops ------------------------------------------------------------------------------------------------


def motion(command, start, v_ref, w_ref, times):
    """(n, 3) errors of a robot that obeys exactly, behind a moving reference, both integrated exactly."""

    def rates(_, s):
        v, w = command(tracking_error(*s), v_ref, w_ref)
        return [v * math.cos(s[2]), v * math.sin(s[2]), w, v_ref * math.cos(s[5]), v_ref * math.sin(s[5]), w_ref]

    solved = solve_ivp(rates, (0.0, times[-1]), start, t_eval=times, **EXACT)
    assert solved.success
    return [tracking_error(*state) for state in solved.y.T]


def lagging_motion(start, lags, v_ref, w_ref, gains, times):
    """Errors and lags (e4, e5) of a robot whose velocity follows by `acceleration`, integrated exactly."""
    k1, k2, k3, k4 = gains

    def command(error):
        return fierro_lewis.kinematic_command(error, v_ref, w_ref, k1, k2, k3)

    def rates(_, s):
        error, (v, w) = tracking_error(*s[:6]), s[6:]
        changes = kanayama.error_rates(error, v, w, v_ref, w_ref)
        wanted, ahead = command(error), fierro_lewis.command_rates(error, changes, v_ref, k1, k2, k3)
        pushes = [fierro_lewis.acceleration(*given, k4) for given in zip((v, w), wanted, ahead, strict=True)]
        reference = [v_ref * math.cos(s[5]), v_ref * math.sin(s[5]), w_ref]
        return [v * math.cos(s[2]), v * math.sin(s[2]), w, *reference, *pushes]

    moving = np.add(command(tracking_error(*start)), lags)
    solved = solve_ivp(rates, (0.0, times[-1]), [*start, *moving], t_eval=times, **EXACT)
    assert solved.success
    errors = [tracking_error(*state) for state in solved.y[:6].T]
    return errors, [tuple(np.subtract(now, command(error))) for error, now in zip(errors, solved.y[6:].T, strict=True)]


def apart(e1, e2, e3):
    """Robot at the origin, facing x, and its reference: x, y and heading of each."""
    return [0.0, 0.0, 0.0, e1, e2, e3]


STEP = 1e-3
CENTRES = np.array([0.05, 0.4])
TIMES = (CENTRES[:, None] + STEP * np.arange(-2, 3)).ravel()
starts = st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-2.5, 2.5))
speeds, turns = st.floats(0.1, 0.5), st.floats(-0.43, 0.43)


def slopes(levels):
    """Five-point differences of a function of time at CENTRES."""
    return np.reshape(levels, (2, 5)) @ [1.0, -8.0, 0.0, 8.0, -1.0] / (12.0 * STEP)


@settings(max_examples=20)
@given(starts, speeds, turns, st.floats(0.5, 10.0), st.floats(1.0, 64.0), st.floats(0.5, 16.0))
def test_the_energy_of_kanayama_falls_as_in_proposition_1(start, v_ref, w_ref, k_x, k_y, k_theta):
    def command(error, v, w):
        return kanayama.control_rule(error, v, w, k_x, k_y, k_theta)

    errors = motion(command, apart(*start), v_ref, w_ref, TIMES)
    wanted = [kanayama.energy_rate(error, v_ref, k_x, k_y, k_theta) for error in errors[2::5]]
    assert slopes([kanayama.energy(error, k_y) for error in errors]) == pytest.approx(wanted, abs=1e-6)
    assert max(wanted) <= 0.0


@settings(max_examples=20)
@given(starts, speeds, turns, st.floats(0.2, 1.5), st.floats(1.0, 16.0))
def test_the_energy_of_ramsete_falls_by_its_gain(start, v_ref, w_ref, zeta, b):
    def command(error, v, w):
        return ramsete.tracking_command(error, v, w, zeta, b)

    errors = motion(command, apart(*start), v_ref, w_ref, TIMES)
    wanted = [ramsete.energy_rate(error, v_ref, w_ref, zeta, b) for error in errors[2::5]]
    assert slopes([ramsete.energy(error, b) for error in errors]) == pytest.approx(wanted, abs=1e-6)
    assert max(wanted) <= 0.0


@settings(max_examples=20)
@given(
    starts,
    st.tuples(st.floats(-0.3, 0.3), st.floats(-0.5, 0.5)),
    speeds,
    turns,
    st.tuples(st.floats(0.5, 5.0), st.floats(1.0, 10.0), st.floats(0.5, 6.0), st.floats(2.0, 10.0)),
)
def test_the_energy_of_fierro_and_lewis_falls_while_the_velocity_lags(start, lags, v_ref, w_ref, gains):
    errors, behind = lagging_motion(apart(*start), lags, v_ref, w_ref, gains, TIMES)
    states = list(zip(errors, behind, strict=True))
    wanted = [fierro_lewis.energy_rate(error, lag, v_ref, gains) for error, lag in states[2::5]]
    found = slopes([fierro_lewis.energy(error, lag, v_ref, gains) for error, lag in states])
    assert found == pytest.approx(wanted, rel=1e-5, abs=1e-5)
    assert max(wanted) <= 0.0


def settling_time(times, errors, band=0.02):
    """When hypot(e1, e2) was last `band`, m, or more, s."""
    off = np.hypot([error.e1 for error in errors], [error.e2 for error in errors])
    return times[np.flatnonzero(off >= band)[-1]]


BESIDE = [0.0, -0.3, 0.0, 0.0, 0.0, 0.0]
UNTIL_8 = np.arange(0.0, 8.0, 0.002)


@pytest.mark.parametrize(("name", "seconds"), [("kanayama", 1.64), ("ramsete", 2.42)])
def test_settling_time_from_30_cm_beside_a_line(name, seconds):
    """At 0.3 m/s and without limits: `lyapunov_tracker` needs 14.6 s."""
    assert settling_time(UNTIL_8, motion(LAWS[name], BESIDE, 0.3, 0.0, UNTIL_8)) == pytest.approx(seconds, abs=0.01)


def test_settling_time_of_fierro_and_lewis():
    """The velocity follows at 40 1/s from that of the reference; then it follows at once."""
    start = np.subtract((0.3, 0.0), fierro_lewis.kinematic_command(tracking_error(*BESIDE), 0.3, 0.0, 10.0, 5.0, 4.0))
    errors, _ = lagging_motion(BESIDE, tuple(start), 0.3, 0.0, FIERRO_LEWIS, UNTIL_8)
    assert settling_time(UNTIL_8, errors) == pytest.approx(5.57, abs=0.01)
    ideal = motion(lambda *a: fierro_lewis.kinematic_command(*a, *FIERRO_LEWIS[:3]), BESIDE, 0.3, 0.0, UNTIL_8)
    assert settling_time(UNTIL_8, ideal) == pytest.approx(5.54, abs=0.01)


def test_small_steps_aside_decay_as_eq_21_of_kanayama():
    """y = dy (1 + xi t) exp(-xi t) with xi = v_r sqrt(k_y) = 2.4 1/s."""
    times = np.arange(0.0, 3.0, 0.1)
    found = [error.e2 for error in motion(LAWS["kanayama"], [0.0, -1e-4, 0.0, 0.0, 0.0, 0.0], 0.3, 0.0, times)]
    assert found == pytest.approx(1e-4 * (1.0 + 2.4 * times) * np.exp(-2.4 * times), abs=1e-10)

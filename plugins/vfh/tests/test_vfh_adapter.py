"""The three plugins: the framework's contract, and single ticks."""

import math

import numpy as np
import pytest
from avoider_scans import FREE, LIMIT, SQUARE, given, laser, make, sonars
from hypothesis import given as examples
from hypothesis import settings
from hypothesis import strategies as st
from navloom import Discovery, Twist2D
from navloom_avoidance import certainty, clearance, himm
from navloom_vfh import costs, lookahead, survey, turning
from navloom_vfh.adapter import Vfh, VfhPlus, VfhStar
from pydantic import ValidationError

ALL = (Vfh, VfhPlus, VfhStar)
EACH = pytest.mark.parametrize("method", ALL, ids=[method.name for method in ALL])


def is_in_a_slot(angle, diagnostics):
    first, last = diagnostics.slots.T
    return bool(((angle - first) % (2.0 * math.pi) <= last - first).any())


POST_AHEAD = [math.inf, math.inf, math.inf, 0.5, 0.6, math.inf, math.inf, math.inf]


@EACH
def test_is_found_by_its_entry_point(method):
    assert Discovery().role("avoider", method.name) is method


@EACH
def test_free_way_is_clear_and_driven_at_full_speed(method):
    answer = make(method).avoid(given(sonars(FREE)))
    assert (answer.status, answer.twist) == ("clear", Twist2D(0.5, 0.0, 0.0))
    assert answer.diagnostics.chosen == 0.0


@EACH
@pytest.mark.parametrize("sensor", ["sonar", "laser"])
def test_an_obstacle_ahead_on_the_left_is_passed_on_the_right(method, sensor):
    scan = sonars([math.inf, math.inf, 0.7, 0.6, math.inf, math.inf, math.inf, math.inf])
    if sensor == "laser":
        scan = laser(np.where(np.abs(np.linspace(-1.5, 1.5, 101) - 0.2) < 0.2, 1.0, math.inf))
    avoider = make(method)
    for _ in range(5):
        answer = avoider.avoid(given(scan))
    d = answer.diagnostics
    assert answer.status == "steering"
    assert answer.twist.wz < 0.0
    assert 0.0 <= answer.twist.vx < 0.5
    assert d.chosen < 0.0
    assert d.window.max() == 15
    assert is_in_a_slot(d.chosen, d)
    assert not is_in_a_slot(0.0, d)
    assert d.histogram[0] > d.threshold


@EACH
def test_the_robots_size_counts(method):
    """One cell 0.5 m left of a line 1 m ahead: a point passes it, and a robot of 0.3 m, but none of 1.4 m."""
    ranges = np.where(np.abs(np.linspace(-1.5, 1.5, 101) - math.atan2(0.5, 1.0)) < 0.02, math.hypot(1.0, 0.5), math.inf)
    free = []
    for half, disc in ((0.7, "point"), (0.15, "inscribed"), (0.7, "inscribed")):
        avoider = make(method, np.sign(SQUARE) * half, disc=disc)
        for _ in range(5):
            answer = avoider.avoid(given(laser(ranges)))
        free.append(is_in_a_slot(0.0, answer.diagnostics))
    assert free == [True, True, False]


@EACH
def test_all_sides_blocked_is_typed_trapped_after_the_attempts(method):
    """Four rotations of 100 degrees at 25 deg/s take 16 s; the fifth would be one too many."""
    avoider, heading, twist, ticks = make(method, count_down=0, window=33), 0.0, (0.0, 0.0), 0
    scan = laser(np.full(101, 0.9))
    while (answer := avoider.avoid(given(scan, heading=heading, twist=twist))).status != "trapped" and ticks < 600:
        ticks += 1
        twist = (answer.twist.vx, answer.twist.wz)
        heading = math.remainder(heading + 0.05 * answer.twist.wz, 2.0 * math.pi)
    assert answer.status == "trapped"
    assert answer.twist == Twist2D(0.0, 0.0, 0.0)
    assert answer.diagnostics.why == "trapped: nothing free in 4 rotations without progress"
    assert answer.diagnostics.chosen is None
    assert ticks * 0.05 >= 16.0
    again = avoider.avoid(given(sonars(FREE), heading=heading))
    assert again.diagnostics.why == "trapped: neither robot nor target moved since"
    assert avoider.avoid(given(sonars(FREE), heading=heading, target=(3.0, 0.0))).status != "trapped"


@EACH
def test_a_robot_that_another_source_stops_is_not_trapped(method):
    avoider, scan = make(method, patience=3.0), sonars(POST_AHEAD)
    answers = {avoider.avoid(given(scan)).status for _ in range(200)}  # commanded to move, but stopped
    assert answers == {"steering"}


@EACH
def test_an_obstacle_within_the_braking_distance_stops_it(method):
    """One tick and braking at 1 m/s^2 take 0.15 m, the margin is 0.12 m: an echo 0.2 m before the front is too near."""
    scan = laser(np.where(np.abs(np.linspace(-1.5, 1.5, 101)) < 0.3, 0.6, math.inf))
    assert make(method).avoid(given(scan, twist=(0.5, 0.0))).twist.vx == 0.0
    unchecked = make(method, arc_check=False, threshold=50.0) if method is Vfh else make(
        method, arc_check=False, threshold_high=50.0
    )  # fmt: skip
    assert unchecked.avoid(given(scan, twist=(0.5, 0.0))).twist.vx > 0.2


def test_a_turn_too_tight_for_the_speed_is_masked_but_not_for_a_stopped_robot():
    """Cells 0.7 m to the right, ahead and beside: at 0.5 m/s and 25 deg/s the circle has 1.15 m."""
    ranges = np.where(np.linspace(-1.5, 1.5, 101) < -0.6, 0.8, math.inf)
    chosen = []
    for speed in (0.0, 0.5):
        avoider = make(VfhPlus)
        for _ in range(5):
            answer = avoider.avoid(given(laser(ranges), twist=(speed, 0.0), target=(-1.0, -4.0)))
        chosen.append(answer.diagnostics.chosen)
    assert chosen[0] < math.radians(-90.0)
    assert chosen[1] > math.radians(-35.0)


def test_looking_one_step_ahead_answers_as_vfh_plus():
    stream = np.random.default_rng(3)
    plus, star = make(VfhPlus), make(VfhStar, look_ahead=1, window=33)
    turned = 0
    for k in range(60):
        ranges = np.where(stream.random(8) < 0.5, stream.uniform(0.45, 1.5, 8), math.inf)
        told = given(sonars(ranges), x=0.02 * k, heading=0.03 * k, target=(5.0, 1.0), twist=(0.2, 0.1))
        one, other = plus.avoid(told), star.avoid(told)
        assert (one.twist, one.status, one.diagnostics.chosen) == (other.twist, other.status, other.diagnostics.chosen)
        turned += one.twist.wz != 0.0
    assert turned > 30


@EACH
def test_reset_forgets_window_and_trap(method):
    avoider = make(method)
    for _ in range(200):
        avoider.avoid(given(sonars([0.35] * 8)))
    avoider.reset()
    answer = avoider.avoid(given(sonars(FREE)))
    assert (answer.status, answer.twist) == ("clear", Twist2D(0.5, 0.0, 0.0))
    assert answer.diagnostics.window.sum() == 0


@EACH
def test_a_tick_without_scans_keeps_the_obstacles(method):
    avoider = make(method)
    seen = avoider.avoid(given(sonars(POST_AHEAD)))
    after = avoider.avoid(given())
    assert seen.diagnostics.window.sum() == 6
    np.testing.assert_array_equal(after.diagnostics.window, seen.diagnostics.window)


@EACH
def test_no_tick_compiles_after_warm_up(method):
    method.warm_up()
    kernels = {
        Vfh: (survey.survey_valleys,),
        VfhPlus: (survey.survey_openings, costs.cheapest, turning.turning_radius),
        VfhStar: (survey.survey_openings, lookahead.look_ahead, turning.turning_radius),
    }[method] + (himm.count_readings, certainty.place_beams, certainty.scroll_window, clearance.free_command)
    before = [len(kernel.signatures) for kernel in kernels]
    avoider = make(method)
    avoider.avoid(given(sonars([0.5] * 8)))
    avoider.avoid(given(sonars([0.5] * 8), laser(np.full(101, 1.0))))
    avoider.avoid(given(laser(np.full(101, 1.0)), twist=(0.3, 0.1)))
    avoider.avoid(given())
    assert [len(kernel.signatures) for kernel in kernels] == before
    assert min(before) >= 1


@EACH
@settings(max_examples=15, deadline=None)
@examples(
    st.lists(st.one_of(st.floats(0.3, 4.0), st.just(math.inf)), min_size=8, max_size=8),
    st.floats(-math.pi, math.pi - 1e-9),
    st.tuples(st.floats(-4.0, 4.0), st.floats(-4.0, 4.0)),
    st.floats(0.0, 0.5),
    st.booleans(),
)
def test_commands_are_finite_and_within_the_limits(method, ranges, heading, target, speed, is_literal):
    avoider = make(method, **(method.presets["printed"].values() if is_literal else {}))
    for _ in range(4):
        answer = avoider.avoid(given(sonars(ranges), heading=heading, target=target, twist=(speed, 0.0)))
        assert 0.0 <= answer.twist.vx <= 0.5
        assert answer.twist.vy == 0.0
        assert abs(answer.twist.wz) <= LIMIT + 1e-12


def test_unknown_keys_and_wrong_values_are_refused():
    for method, wrong in ((Vfh, {"treshold": 0.2}), (VfhPlus, {"window": 3}), (VfhStar, {"look_ahead": 0})):
        with pytest.raises(ValidationError):
            method.Params(**wrong)

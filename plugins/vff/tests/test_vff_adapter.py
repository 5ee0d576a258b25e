"""The plugin: the framework's contract, and single ticks."""

import math

import numpy as np
import pytest
from avoider_scans import FREE, LIMIT, SQUARE, given, laser, make, sonars
from hypothesis import given as examples
from hypothesis import settings
from hypothesis import strategies as st
from navloom import AvoiderInput, Discovery, Point2D, Pose2D, PoseEstimate, Twist2D
from navloom_avoidance import certainty, clearance, himm
from navloom_vff import forces
from navloom_vff.adapter import Vff
from navloom_vff.avoidance import disc_radius
from navloom_vff.params import VffParams
from pydantic import ValidationError


@pytest.fixture
def avoider():
    return make(Vff)


LEFT_OF_AHEAD = [math.inf, math.inf, 0.6, math.inf, math.inf, math.inf, math.inf, math.inf]


def test_is_found_by_its_entry_point():
    assert Discovery().role("avoider", "vff") is Vff


def test_free_way_is_clear_and_driven_at_full_speed(avoider):
    answer = avoider.avoid(given(sonars(FREE)))
    assert (answer.status, answer.twist) == ("clear", Twist2D(0.5, 0.0, 0.0))
    assert answer.diagnostics.chosen == 0.0


@pytest.mark.parametrize("sensor", ["sonar", "laser"])
def test_an_obstacle_ahead_on_the_left_is_passed_on_the_right(avoider, sensor):
    scan = sonars(LEFT_OF_AHEAD)
    if sensor == "laser":
        scan = laser(np.where(np.abs(np.linspace(-1.5, 1.5, 101) - 0.5) < 0.1, 1.0, math.inf))
    for _ in range(5):
        answer = avoider.avoid(given(scan))
    assert answer.status == "steering"
    assert answer.twist.wz < 0.0
    assert 0.0 < answer.twist.vx < 0.5
    assert answer.diagnostics.chosen < 0.0
    assert answer.diagnostics.window.max() == 15


def test_the_histogram_is_the_push_by_direction_in_units_of_the_targets_pull(avoider):
    """The echo of the sonar at 30 deg is in sector 6 of 72; cell (0.85, 0.55), 1.012 m off, 0.447 m from the disc."""
    answer = avoider.avoid(given(sonars(LEFT_OF_AHEAD)))
    d = answer.diagnostics
    (row, column) = np.argwhere(d.window)[0]
    x, y = d.window_x + (column + 0.5) * 0.1, d.window_y + (row + 0.5) * 0.1
    expected = 0.25**2 / 15.0 * 3.0 / (math.hypot(x, y) - 0.4 * math.sqrt(2.0)) ** 2
    assert d.histogram[math.floor(math.degrees(math.atan2(y, x)) / 5.0)] == pytest.approx(expected)
    assert np.count_nonzero(d.histogram) == 1
    assert (d.threshold, d.slots.shape) == (1.0, (0, 2))
    assert d.why.startswith(f"push {expected:.2f}, ")


def test_the_robots_size_counts(avoider):
    """A wall of cells is far from a point, but near the square of 0.8 m."""
    assert disc_radius(SQUARE, "enclosing") == pytest.approx(0.5657, abs=1e-4)
    assert disc_radius(SQUARE, "inscribed") == pytest.approx(0.4)
    assert disc_radius(SQUARE, "point") == 0.0
    pushes = [make(Vff, disc=disc).avoid(given(sonars(LEFT_OF_AHEAD))).diagnostics.histogram.sum()
              for disc in ("inscribed", "enclosing")]  # fmt: skip
    assert pushes[0] < 0.5 * pushes[1]


def test_balance_of_a_point_counts_from_the_half_width_of_the_body():
    """F_cr = balance^2 / 15, in m^2; the half width is 0.4 m."""
    assert make(Vff, disc="point")._method.constant == pytest.approx(0.65 * 0.65 / 15)
    assert make(Vff)._method.constant == pytest.approx(0.25 * 0.25 / 15)


def test_a_robot_that_does_not_move_as_commanded_is_trapped_after_its_patience():
    """Echoes all round at 0.35 m: it turns in place on the spot for 3 s and then gives up."""
    avoider, heading, twist = make(Vff, patience=3.0), 0.0, (0.0, 0.0)
    ticks = 0
    while (answer := avoider.avoid(given(sonars([0.35] * 8), heading=heading, twist=twist))).status != "trapped":
        ticks += 1
        assert ticks < 200
        twist = (answer.twist.vx, answer.twist.wz)
        heading = math.remainder(heading + 0.05 * answer.twist.wz, 2.0 * math.pi)
    assert answer.twist == Twist2D(0.0, 0.0, 0.0)
    assert answer.diagnostics.why.startswith("trapped: no ")
    assert ticks * 0.05 == pytest.approx(3.0, abs=0.3)
    again = avoider.avoid(given(sonars(FREE), heading=heading))
    assert again.diagnostics.why == "trapped: neither robot nor target moved since"
    assert avoider.avoid(given(sonars(FREE), heading=heading, target=(3.0, 0.0))).status != "trapped"


def test_a_robot_that_another_source_stops_is_not_trapped():
    avoider = make(Vff, patience=3.0)
    scan = sonars(LEFT_OF_AHEAD)
    answers = {avoider.avoid(given(scan)).status for _ in range(200)}  # commanded to move, but stopped
    assert answers == {"steering"}


def test_an_obstacle_within_the_braking_distance_stops_it():
    """One tick and braking at 1 m/s^2 take 0.15 m, the margin is 0.12 m: an echo 0.2 m before the front is too near."""
    scan = laser(np.where(np.abs(np.linspace(-1.5, 1.5, 101)) < 0.3, 0.6, math.inf))
    answer = make(Vff).avoid(given(scan, twist=(0.5, 0.0)))
    assert answer.twist.vx == 0.0
    weak = {"disc": "point", "slow_force": 100.0, "slows_for_turns": False}
    assert make(Vff, **weak, arc_check=False).avoid(given(scan, twist=(0.5, 0.0))).twist.vx > 0.2
    assert make(Vff, **weak).avoid(given(scan, twist=(0.5, 0.0))).twist.vx == 0.0


def test_reset_forgets_window_trap_and_turn_rate(avoider):
    for _ in range(200):
        avoider.avoid(given(sonars([0.35] * 8)))
    avoider.reset()
    answer = avoider.avoid(given(sonars(FREE)))
    assert (answer.status, answer.twist) == ("clear", Twist2D(0.5, 0.0, 0.0))
    assert answer.diagnostics.window.sum() == 0


def test_a_tick_without_scans_keeps_the_obstacles(avoider):
    seen = avoider.avoid(given(sonars(LEFT_OF_AHEAD)))
    after = avoider.avoid(given())
    assert seen.diagnostics.window.sum() == 3
    np.testing.assert_array_equal(after.diagnostics.window, seen.diagnostics.window)


def test_laser_above_a_low_obstacle_does_not_hide_it_from_the_sonars(avoider):
    answer = avoider.avoid(given(sonars(LEFT_OF_AHEAD), laser(np.full(101, math.inf))))
    assert answer.diagnostics.window.max() == 3
    assert answer.status == "steering"


def test_window_in_the_map_frame_follows_the_robot(avoider):
    answer = avoider.avoid(given(sonars(FREE), x=2.05))
    assert answer.diagnostics.window_x == pytest.approx(2.0 - 1.6)
    assert answer.diagnostics.window_y == pytest.approx(-1.6)


def test_no_tick_compiles_after_warm_up(avoider):
    Vff.warm_up()
    kernels = (
        himm.count_readings, forces.repulsive_force, certainty.place_beams, certainty.scroll_window,
        certainty.occupied_cells, clearance.free_command,
    )  # fmt: skip
    before = [len(kernel.signatures) for kernel in kernels]
    avoider.avoid(given(sonars([0.5] * 8)))
    avoider.avoid(given(sonars([0.5] * 8), laser(np.full(101, 1.0))))
    avoider.avoid(given(laser(np.full(101, 1.0))))
    avoider.avoid(given())
    assert [len(kernel.signatures) for kernel in kernels] == before
    assert min(before) >= 1


@settings(max_examples=60)
@examples(
    st.lists(st.one_of(st.floats(0.3, 4.0), st.just(math.inf)), min_size=8, max_size=8),
    st.floats(-math.pi, math.pi - 1e-9),
    st.tuples(st.floats(-4.0, 4.0), st.floats(-4.0, 4.0)),
    st.floats(0.0, 0.5),
    st.booleans(),
)
def test_commands_are_finite_and_within_the_limits(ranges, heading, target, speed, is_literal):
    avoider = make(Vff, **(Vff.presets["printed"].values() if is_literal else {}))
    for _ in range(4):
        answer = avoider.avoid(given(sonars(ranges), heading=heading, target=target, twist=(speed, 0.0)))
        assert 0.0 <= answer.twist.vx <= 0.5
        assert answer.twist.vy == 0.0
        assert abs(answer.twist.wz) <= LIMIT + 1e-12


@settings(max_examples=60)
@examples(st.lists(st.floats(0.45, 1.6), min_size=8, max_size=8), st.integers(1, 3), st.floats(-0.7, 0.7))
def test_turning_robot_target_and_world_by_quarters_turns_the_answer(ranges, quarters, bearing):
    answers = []
    for turn in (0.0, quarters * 0.5 * math.pi):
        # In the middle of its cell the robot sees the same cells after a quarter turn.
        pose = Pose2D(0.05, 0.05, math.remainder(0.013 + turn, 2.0 * math.pi))
        target = Point2D(0.05 + 5.0 * math.cos(bearing + turn), 0.05 + 5.0 * math.sin(bearing + turn))
        estimate = PoseEstimate(0, pose, Twist2D(0.3, 0.0, 0.0), np.zeros((3, 3)))
        scan = sonars(ranges)
        answers.append(make(Vff).avoid(AvoiderInput(0, (scan,), estimate, target, 0.5, Twist2D(0.3, 0.0, 0.0), 1.0)))
    first, second = answers
    if np.array_equal(np.rot90(first.diagnostics.window, -quarters), second.diagnostics.window):
        assert second.twist.vx == pytest.approx(first.twist.vx, abs=1e-6)
        assert second.twist.wz == pytest.approx(first.twist.wz, abs=1e-6)
    else:  # an echo within rounding of a cell's side may fall to either cell
        assert (np.rot90(first.diagnostics.window, -quarters) != second.diagnostics.window).sum() <= 4


def test_unknown_keys_and_wrong_values_are_refused():
    for wrong in ({"balanse": 0.2}, {"window": 3}, {"disc": "square"}, {"wall_angle_deg": 80.0}):
        with pytest.raises(ValidationError):
            VffParams(**wrong)

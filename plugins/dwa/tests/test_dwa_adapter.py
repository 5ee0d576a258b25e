"""The plugin: the framework's contract, and single ticks."""

import math

import numpy as np
import pytest
from avoider_scans import FREE, LIMIT, given, laser, make, sonars
from hypothesis import given as examples
from hypothesis import settings
from hypothesis import strategies as st
from navloom import Discovery, RangeScan, Twist2D
from navloom_avoidance import certainty, points
from navloom_dwa import contact, critics, field, objective, rollout, window
from navloom_dwa.adapter import Dwa, split_scans
from navloom_dwa.params import DwaParams
from pydantic import ValidationError


@pytest.fixture
def avoider():
    return make(Dwa)


def post(bearing, distance):
    """A laser scan that sees a post of 0.2 rad."""
    return laser(np.where(np.abs(np.linspace(-1.5, 1.5, 101) - bearing) < 0.1, distance, math.inf))


def test_is_found_by_its_entry_point():
    assert Discovery().role("avoider", "dwa") is Dwa


def test_in_the_open_it_speeds_up_straight_as_far_as_the_window_reaches(avoider):
    """0.25 s at 0.5 m/s^2 from standing: 0.125 m/s."""
    answer = avoider.avoid(given(sonars(FREE)))
    assert answer.status == "clear"
    assert (answer.twist.vx, answer.twist.wz) == pytest.approx((0.125, 0.0), abs=1e-6)
    assert answer.diagnostics.chosen == pytest.approx(0.0, abs=1e-9)
    assert answer.diagnostics.slots.shape == (1, 2)


LEFT_OF_AHEAD = [math.inf, math.inf, 0.6] + [math.inf] * 5


@pytest.mark.parametrize("scan", [sonars(LEFT_OF_AHEAD), post(0.3, 1.2)], ids=["sonar", "laser"])
def test_an_obstacle_ahead_on_the_left_is_passed_on_the_right(avoider, scan):
    for k in range(5):
        answer = avoider.avoid(given(scan, twist=(0.3, 0.0), time=0.05 * k))
    assert answer.status == "steering"
    assert answer.twist.wz < 0.0 < answer.twist.vx
    assert answer.diagnostics.chosen < 0.0
    assert answer.diagnostics.window.max() == 15
    assert "admissible" in answer.diagnostics.why


def test_a_laser_point_is_taken_where_it_is_and_not_where_a_cell_is():
    """Straight ahead at 1.513 m the front, at 0.4 m, has 1.513 - 0.4 - 0.05 m to drive."""
    avoider = make(Dwa)
    scan = laser(np.where(np.arange(101) == 50, 1.513, math.inf))
    avoider.avoid(given(scan))
    method = avoider._method
    straight = np.flatnonzero(method.arcs[:, 1] == 0.0)[0]
    assert method.contacts[straight] == pytest.approx(1.513 - 0.4 - 0.05)


def test_no_velocity_of_the_window_is_admissible_from_which_it_cannot_stop():
    """Echoes at 0.65 m: an admissible v needs 0.05 v + v^2 / 2 to stop; at 0.5 m/s 0.15 m of the 0.2 m ahead."""
    avoider = make(Dwa)
    answer = avoider.avoid(given(post(0.0, 0.65), twist=(0.5, 0.0)))
    method = avoider._method
    arc, speed = np.nonzero(np.isfinite(method.costs))
    v, low, high = method.arcs[arc, 0], method.arcs[arc, 2], method.arcs[arc, 3]
    u = low + (high - low) * speed / (method.costs.shape[1] - 1)
    assert (0.05 * v * u + 0.5 * (v * u) ** 2 <= v * method.contacts[arc] + 1e-9).all()
    assert len(arc) > 0
    assert answer.twist.vx < 0.5


def test_where_nothing_is_free_it_brakes_on_its_arc():
    """An echo 2 cm before the margin at full speed: no velocity of the window can be stopped in time."""
    answer = make(Dwa).avoid(given(post(0.0, 0.47), twist=(0.5, 0.2)))
    assert (answer.twist.vx, answer.twist.wz) == pytest.approx((0.0, 0.2))
    assert answer.diagnostics.why == "nothing of the window is free: braking"
    assert answer.diagnostics.chosen is None


def ring(distance):
    """Obstacles all round, as seen by a laser of 360 degrees."""
    bearings = np.linspace(-math.pi, math.pi - 0.02, 315)
    return RangeScan(0, np.zeros((315, 2)), bearings, np.zeros(315), np.zeros(315), np.full(315, distance), 0.1, 8.0)


def stand(avoider, scan, ticks=200):
    """Answers until it is trapped; the robot is stopped, as commanded."""
    answers = []
    for k in range(ticks):
        answers.append(avoider.avoid(given(scan, time=0.05 * k)))
        if answers[-1].status == "trapped":
            break
    return answers


def test_walled_in_it_is_trapped_after_its_patience_and_stays_so():
    """Echoes at 0.42 m all round: the sides have 2 cm, the corners none; 1.5 s of standing, and no room to back up."""
    avoider = make(Dwa)
    answers = stand(avoider, ring(0.58))
    assert answers[-1].status == "trapped"
    assert answers[-1].diagnostics.why.startswith("trapped: blocked")
    assert answers[-1].twist == Twist2D(0.0, 0.0, 0.0)
    again = avoider.avoid(given(ring(3.0), time=20.0))
    assert again.diagnostics.why == "trapped: neither robot nor target moved since"
    assert avoider.avoid(given(ring(3.0), time=20.0, target=(3.0, 0.0))).status != "trapped"


CORNERED = np.where(np.abs(np.linspace(-1.5, 1.5, 101)) < 1.2, 0.58, math.inf)


def test_it_is_trapped_at_once_where_the_gate_does_not_let_it_back_up():
    """Without a sensor that looks back, the gate lets the robot back up only where it has been."""
    avoider = make(Dwa)
    answers = [avoider.avoid(given(laser(CORNERED), time=0.05 * k)) for k in range(32)]
    assert answers[-1].twist.vx < 0.0
    answer = avoider.avoid(given(laser(CORNERED), time=1.6, share=0.0))
    assert (answer.status, answer.twist.vx) == ("trapped", 0.0)


def test_blocked_ahead_it_backs_up_and_where_it_may_not_it_is_trapped():
    answers = stand(make(Dwa), laser(CORNERED), 60)
    assert any(a.twist.vx == -0.15 and a.status == "steering" for a in answers)
    answers = stand(make(Dwa, back_up=0.0), laser(CORNERED), 60)
    assert answers[-1].status == "trapped"
    assert min(a.twist.vx for a in answers) == 0.0


def test_a_robot_that_another_source_stops_is_not_trapped():
    """It commands motion and is stopped; its patience of 1 s does not run."""
    held = make(Dwa, patience=1.0)
    answers = [held.avoid(given(post(0.0, 3.0), time=0.05 * k)) for k in range(100)]
    assert all(a.twist.vx > 0.1 and a.status == "steering" for a in answers)


def test_reset_forgets_obstacles_and_traps(avoider):
    stand(avoider, ring(0.58))
    avoider.reset()
    answer = avoider.avoid(given(sonars(FREE)))
    assert answer.status == "clear"
    assert answer.diagnostics.window.sum() == 0


def test_a_tick_without_scans_keeps_the_obstacles(avoider):
    seen = avoider.avoid(given(post(0.3, 1.2)))
    after = avoider.avoid(given(time=0.05))
    np.testing.assert_array_equal(after.diagnostics.window, seen.diagnostics.window)
    assert seen.diagnostics.window.max() == 15


def test_a_laser_above_a_low_obstacle_does_not_hide_it_from_the_sonars(avoider):
    answer = avoider.avoid(given(sonars(LEFT_OF_AHEAD), laser(np.full(101, math.inf)), twist=(0.3, 0.0)))
    assert answer.diagnostics.window.max() == 15
    assert answer.status == "steering"


def test_scans_are_split_into_lasers_and_sonars():
    lasers, cones = split_scans((laser(np.ones(5)), sonars(FREE), sonars(FREE), laser(np.ones(7))))
    assert [beams.ranges.size for beams in lasers] == [5, 7]
    assert cones.ranges.size == 16
    assert cones.sensors.tolist() == [1] * 8 + [2] * 8
    assert split_scans(()) == ([], None)


def test_no_tick_compiles_after_warm_up(avoider):
    Dwa.warm_up()
    kernels = (
        points.remember, points.obstacles_in_base, window.sample_arcs, window.reachable, contact.first_contacts,
        rollout.highest_speeds, rollout.choose, rollout.stays_free, field.fill_field, field.obstacle_distance,
        field.centre_field, critics.score_critics, objective.score_1997,
        certainty.insert_beams, certainty.occupied_cells,
    )  # fmt: skip
    before = [len(kernel.signatures) for kernel in kernels]
    for method in (avoider, make(Dwa, **Dwa.presets["printed"].values())):
        stand(method, ring(0.58), 60)
        method.avoid(given(sonars([0.5] * 8)))
        method.avoid(given(sonars([0.5] * 8), laser(np.full(101, 1.0))))
        method.avoid(given(sonars(FREE), sonars(FREE), laser(np.full(101, 1.0)), laser(np.full(7, 1.0))))
        method.avoid(given())
    assert [len(kernel.signatures) for kernel in kernels] == before
    assert min(before) >= 1


@settings(max_examples=40)
@examples(
    st.lists(st.one_of(st.floats(0.3, 4.0), st.just(math.inf)), min_size=8, max_size=8),
    st.floats(-math.pi, math.pi - 1e-9),
    st.tuples(st.floats(-4.0, 4.0), st.floats(-4.0, 4.0)),
    st.floats(-0.1, 0.5),
    st.booleans(),
)
def test_commands_are_finite_and_within_the_limits(ranges, heading, target, speed, is_1997):
    avoider = make(Dwa, **(Dwa.presets["printed"].values() if is_1997 else {}))
    for k in range(4):
        answer = avoider.avoid(given(sonars(ranges), heading=heading, target=target, twist=(speed, 0.0), time=0.05 * k))
        assert -0.15 <= answer.twist.vx <= 0.5 + 1e-6
        assert answer.twist.vy == 0.0
        assert abs(answer.twist.wz) <= LIMIT + 1e-6


def test_unknown_keys_and_wrong_values_are_refused():
    for wrong in ({"alfa": 0.2}, {"arcs": 1}, {"shape": "point"}, {"horizon": 0.0}):
        with pytest.raises(ValidationError):
            DwaParams(**wrong)

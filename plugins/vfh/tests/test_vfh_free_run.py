"""The fastest free command: a square robot of 0.8 m, brakes of 1 m/s², posts as single echo points."""

import math

import numpy as np
import pytest
from navloom_avoidance.clearance import footprint_edges
from navloom_vfh.free_run import ECHO, choose_command, fastest_free, near_points, progress_score, ramp, stops_free

CORNERS = np.array([[0.4, 0.4], [-0.4, 0.4], [-0.4, -0.4], [0.4, -0.4]])
EDGES, RIM = footprint_edges(CORNERS), math.hypot(0.4, 0.4)
PERIOD, LIMITS, MARGINS = 0.05, (1.0, 1.0, math.inf), np.array([[0.05, 0.02], [0.12, 0.12]])


def near(*cells, beam_spacing=0.0):
    """Points and gaps of cells (x, y, certainty)."""
    points, gaps = np.zeros((8, 4)), np.zeros(8)
    n = near_points(np.array(cells, float).reshape(-1, 3), EDGES, 3.0, MARGINS, beam_spacing, points, gaps)
    return points[:n], gaps[:n]


def is_free(found, twist, command, lag=0.0, dead_time=0.0):
    sent = np.array([twist])
    return stops_free(*found, EDGES, RIM, twist, command, PERIOD, LIMITS, sent, lag, dead_time)


def best(found, speed, error=0.0, turn=0.0, barred=0):
    sent = np.array([(speed, 0.0)])
    return choose_command(
        *found, EDGES, RIM, (speed, 0.0), error, 1.0, turn, 1.0, 3, barred, 0.4, 0.3, PERIOD, LIMITS, sent, 0.0, 0.0
    )


def test_points_are_sorted_by_their_gap_and_echoes_have_the_margin_of_their_beams():
    """An echo 1 m ahead may reach 1 m * 0.02 rad farther."""
    points, gaps = near((1.0, 0.0, ECHO), (0.0, 0.7, 15.0), beam_spacing=0.02)
    np.testing.assert_allclose(gaps, [0.3, 0.6], atol=1e-12)
    np.testing.assert_allclose(points[:, 2:], [[0.12, 0.12], [0.07, 0.04]], atol=1e-12)


@pytest.mark.parametrize(("now", "wanted", "after"), [(0.5, 2.0, 0.6), (0.5, 0.0, 0.3), (-0.1, 1.0, 0.1)])
def test_a_speed_changes_by_the_gates_ramps(now, wanted, after):
    """At most 0.1 faster and 0.2 slower a step; towards the other sign it brakes first."""
    assert ramp(now, wanted, 0.1, 0.2) == pytest.approx(after)


@pytest.mark.parametrize(("gap", "expected"), [(0.62, True), (0.57, False)])
def test_it_stops_before_what_is_ahead(gap, expected):
    """1 m/s for 0.05 s, v²/2b = 0.5 m and the margin of 0.05 m: 0.6 m, less a quarter of the 0.03 m to the floor."""
    assert is_free(near((0.4 + gap, 0.0, ECHO)), (1.0, 0.0), (1.0, 0.0)) is expected


def test_lag_and_dead_time_lengthen_the_way():
    """0.15 s later at 1 m/s: 0.15 m farther."""
    found = near((0.4 + 0.70, 0.0, ECHO))
    assert is_free(found, (1.0, 0.0), (1.0, 0.0))
    assert not is_free(found, (1.0, 0.0), (1.0, 0.0), 0.1, 0.05)


def test_it_brakes_on_the_arc_and_not_beside_it():
    """At 1 m/s and 1 rad/s the circle has 1 m: its centre stays free, and a post on the arc, 30 deg on, is met."""
    assert is_free(near((0.0, 1.0, ECHO)), (1.0, 1.0), (1.0, 1.0))
    assert not is_free(near((math.sin(0.9), 1.0 - math.cos(0.9), ECHO)), (1.0, 1.0), (1.0, 1.0))


def test_a_point_within_the_margin_is_passed_but_not_approached():
    beside = near((0.0, 0.43, ECHO))
    assert is_free(beside, (0.0, 0.0), (0.05, 0.0))
    assert not is_free(near((0.42, 0.0, ECHO)), (0.0, 0.0), (0.05, 0.0))


def test_a_turn_in_place_needs_room_for_the_corners():
    """The corner, 0.57 m from the middle, sweeps 0.5 m beside the robot within 8 deg."""
    assert not is_free(near((0.45, 0.35, ECHO)), (0.0, 0.0), (0.0, -1.0))
    assert is_free(near((0.65, 0.0, ECHO)), (0.0, 0.0), (0.0, -1.0))


def test_the_fastest_speed_is_found_by_halves():
    """With 0.3 m ahead, 0.24 m of it free: v 0.05 + v²/2 = 0.26 gives 0.67 m/s."""
    found = fastest_free(
        *near((0.7, 0.0, ECHO)), EDGES, RIM, (0.7, 0.0), 1.0, 0.0, PERIOD, LIMITS, np.array([(0.7, 0.0)]), 0.0, 0.0
    )
    assert 0.55 <= found <= 0.7


def test_progress_is_the_way_in_the_direction_less_the_heading_error():
    assert progress_score(2.0, 0.0, 0.0, 0.4, 0.3) == pytest.approx(0.8)
    assert progress_score(2.0, 0.0, 0.5, 0.4, 0.3) == pytest.approx(0.8 * math.cos(0.5) - 0.15)
    assert progress_score(0.0, 1.0, 0.5, 0.4, 0.3) == pytest.approx(-0.03)


def test_on_free_ground_it_drives_as_fast_as_the_gate_lets_it_and_turns_within_the_time_of_the_score():
    """From 0.5 m/s at 1 m/s², one tick later 0.55 m/s; of 0.4 + k / 6 rad/s, 0.57 turns 0.2 rad in 0.4 s best."""
    assert best(near(), 0.5, error=0.2, turn=0.4) == pytest.approx((0.55, 0.4 + 1.0 / 6.0))


def test_it_is_slower_towards_what_is_ahead_and_drives_past_what_is_beside():
    assert best(near((0.7, 0.0, ECHO)), 0.8)[0] < 0.8
    assert best(near((0.7, 0.5, ECHO)), 0.8) == pytest.approx((0.85, 0.0))


def test_a_barred_side_is_not_turned_to():
    assert best(near(), 0.5, error=0.2, turn=0.4, barred=1)[1] <= 0.0


def test_closed_in_there_is_no_command():
    ring = [(0.42 * math.cos(a), 0.42 * math.sin(a), ECHO) for a in (0.0, math.pi)]
    corners = [(0.41, 0.39, ECHO), (0.41, -0.39, ECHO), (-0.41, 0.39, ECHO), (-0.41, -0.39, ECHO)]
    assert best(near(*ring, *corners), 0.0)[0] == -1.0

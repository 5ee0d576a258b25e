"""Re-projection of a pose on its trajectory."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from limits import speed_limits
from navloom.navigation.trajectory import make_trajectory
from navloom.navigation.trajectory_projection import point_at, project

LIMITS = speed_limits()
LINE = make_trajectory(np.array([[0.0, 0.0], [6.0, 0.0]]), LIMITS).samples
BENDS = make_trajectory(np.array([[0.0, 0.0], [4.0, 0.0], [7.0, 3.0], [12.0, 3.0]]), LIMITS, rounding=0.2).samples
HAIRPIN = make_trajectory(np.array([[0.0, 0.0], [5.0, 0.0], [5.0, 0.6], [0.0, 0.6]]), LIMITS, rounding=0.1).samples
"""A hairpin: two legs 0.6 m apart, the second back along the first."""


def wrap(angle):
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


def on_path(samples, s, aside):
    """Pose `aside` to the left of the trajectory at arc length s, facing along it."""
    k = min(int(s / samples[1, 0]), len(samples) - 2)
    share = s / samples[1, 0] - k
    x, y = samples[k, 1:3] + share * (samples[k + 1, 1:3] - samples[k, 1:3])
    heading = samples[k, 3] + share * wrap(samples[k + 1, 3] - samples[k, 3])
    return x - aside * math.sin(heading), y + aside * math.cos(heading), heading


def test_abeam_of_a_straight_line():
    found = project(LINE, 2.013, 0.3, 0.2, progress=1.9, look_ahead=1.5)
    assert found.progress == pytest.approx(2.013)
    assert (found.x, found.y, found.heading) == pytest.approx((2.013, 0.0, 0.0))
    assert found.cross_track == pytest.approx(0.3)
    assert (found.curvature, found.speed, found.turn_rate) == pytest.approx((0.0, 0.4, 0.0))
    assert (found.target_x, found.target_y) == pytest.approx((3.513, 0.0))


def test_to_the_right_is_negative():
    assert project(LINE, 2.0, -0.4, 0.0, 2.0, 1.0).cross_track == pytest.approx(-0.4)


def test_before_the_start_and_behind_the_end():
    assert project(LINE, -0.5, 0.1, 0.0, 0.0, 1.0).progress == 0.0
    end = project(LINE, 6.4, 0.1, 0.0, 5.9, 1.0)
    assert end.progress == pytest.approx(6.0)
    assert (end.target_x, end.target_y, end.speed) == pytest.approx((6.0, 0.0, 0.2))


def test_one_step_goes_no_further_than_the_window():
    assert project(LINE, 5.0, 0.0, 0.0, 2.0, 1.0, back=0.5, ahead=1.0).progress == pytest.approx(3.0)
    assert project(LINE, 0.0, 0.0, 0.0, 2.0, 1.0, back=0.5, ahead=1.0).progress == pytest.approx(1.5)


def test_progress_may_decrease():
    assert project(LINE, 1.8, 0.0, 0.0, 2.0, 1.0).progress == pytest.approx(1.8)


def test_a_single_sample_is_its_own_reference():
    point = np.array([[0.0, 1.0, 2.0, 0.5, 0.0, 0.2]])
    found = project(point, 3.0, 3.0, 0.0, 0.0, 1.0)
    assert found[:4] == pytest.approx((0.0, 1.0, 2.0, 0.5))
    assert (found.target_x, found.target_y) == pytest.approx((1.0, 2.0))


@settings(max_examples=200, deadline=None)
@given(st.floats(0.2, float(BENDS[-1, 0]) - 0.2), st.floats(-0.3, 0.3), st.floats(-0.4, 0.8), st.floats(-1.0, 1.0))
def test_progress_is_recovered_beside_the_path(s, aside, behind, turned):
    x, y, heading = on_path(BENDS, s, aside)
    found = project(BENDS, x, y, heading + turned, s - behind, 1.0)
    assert found.progress == pytest.approx(s, abs=2e-3)
    assert found.cross_track == pytest.approx(aside, abs=1e-3)
    assert wrap(found.heading - heading) == pytest.approx(0.0, abs=5e-3)
    e1 = math.cos(heading) * (found.x - x) + math.sin(heading) * (found.y - y)
    assert e1 == pytest.approx(0.0, abs=2e-3)
    assert found.turn_rate == pytest.approx(found.curvature * found.speed, abs=1e-12)
    assert abs(found.turn_rate) <= LIMITS.robot.max_angular + 1e-9


def test_progress_moves_smoothly_with_the_robot():
    along = np.arange(0.3, BENDS[-1, 0] - 0.3, 0.003)
    progress = along[0]
    steps = []
    for s in along[1:]:
        x, y, heading = on_path(BENDS, s, 0.25)
        before, progress = progress, project(BENDS, x, y, heading, progress, 1.0).progress
        steps.append(progress - before)
    assert min(steps) > 0.002
    assert max(steps) < 0.004


@pytest.mark.parametrize("aside", [0.25, 0.35, 0.45])
def test_the_projection_does_not_jump_to_the_other_leg_of_a_hairpin(aside):
    """A robot pushed across the middle between the legs, still facing along the first one."""
    assert HAIRPIN[-1, 0] < 10.6
    progress = 3.5
    for x in np.arange(3.5, 4.6, 0.01):
        progress = project(HAIRPIN, x, aside, 0.0, progress, 1.0, ahead=2.5).progress
    assert progress == pytest.approx(4.59, abs=0.1)


def test_the_whole_hairpin_is_followed():
    progress = 0.0
    for s in np.arange(0.0, HAIRPIN[-1, 0], 0.02):
        progress = project(HAIRPIN, *on_path(HAIRPIN, s, 0.05), progress, 1.0).progress
        assert progress == pytest.approx(s, abs=0.03)


def test_a_robot_led_off_by_an_avoider_catches_up():
    progress = 1.0
    for x in np.arange(1.0, 2.501, 0.02):
        progress = project(BENDS, x, -1.5, 0.8, progress, 1.0).progress
    assert progress == pytest.approx(2.5)


def test_points_by_arc_length():
    assert point_at(LINE, 2.345) == pytest.approx((2.345, 0.0))
    assert point_at(LINE, -1.0) == pytest.approx((0.0, 0.0))
    assert point_at(LINE, 99.0) == pytest.approx((6.0, 0.0))


def test_between_samples_the_turn_rate_does_not_exceed_theirs():
    samples = np.array([[0.0, 0.0, 0.0, 0.0, 0.5, 0.4], [0.1, 0.1, 0.0, 0.0, 4.0, 0.05]])
    found = project(samples, 0.05, 0.0, 0.0, 0.0, 1.0)
    assert found.curvature == pytest.approx(2.25)
    assert found.turn_rate == pytest.approx(0.2), "0.5 * 0.4; 2.25 * 0.225 would be 0.51"
    assert found.speed == pytest.approx(0.2 / 2.25)


@pytest.mark.benchmark
def test_a_projection_costs_little_beside_a_numpy_one(benchmark):
    """Ratio in one run: the kernel against the shortest numpy search of the same window."""
    import timeit

    def with_numpy():
        window = BENDS[100:175]
        return int(np.argmin((window[:, 1] - 3.0) ** 2 + (window[:, 2] - 0.1) ** 2))

    ours = min(timeit.repeat(lambda: project(BENDS, 3.0, 0.1, 0.0, 3.0, 1.0), number=2000, repeat=5))
    numpy_only = min(timeit.repeat(with_numpy, number=2000, repeat=5))
    benchmark(project, BENDS, 3.0, 0.1, 0.0, 3.0, 1.0)
    assert ours < numpy_only

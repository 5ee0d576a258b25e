"""The certainty window of either kind of sensor, and which of its cells enter the histogram."""

import math

import numpy as np
import pytest
from navloom_avoidance.beams import Beams
from navloom_avoidance.robot import Robot
from navloom_improved_vfh.avoidance import Avoidance
from navloom_improved_vfh.params import ImprovedVfhParams

BODY = np.array([[0.4, 0.35], [-0.3, 0.35], [-0.3, -0.35], [0.4, -0.35]])
APART = {
    "cell": 0.11, "window": 31, "safety_distance": 0.07, "arc_margin": 0.13,
    "laser_cell": 0.04, "laser_safety_distance": 0.02, "laser_margin": 0.05, "laser_floor": 0.03,
}  # fmt: skip
LASER, SONAR = 0.0, 0.26
HERE = (0.0, 0.0, 0.0)


def method(**given):
    return Avoidance(ImprovedVfhParams(**given), Robot(BODY, 0.5, 0.4, 0.5, 1.0), 0.05)


def beams(half_angle, *places):
    """Beams of no echo, or with an echo in each of some places, m, base frame."""
    bearings = np.array([math.atan2(y, x) for x, y in places] or [0.0, 0.1])
    ranges = np.array([math.hypot(x, y) for x, y in places] or [math.inf, math.inf])
    n = len(ranges)
    limits, sensors = np.tile([0.1, 4.0], (n, 1)), np.zeros(n, np.int64)
    return Beams(np.zeros((n, 2)), bearings, np.full(n, half_angle), ranges, limits, sensors)


def margins(made):
    """Cell, cells a side, enlargement radius, margin and floor, m."""
    return made.cell, len(made.grid), made.radius, made.arc_margin, made.arc_floor


# 3.41 m are 31 cells of 0.11 m, or 85.25 of 0.04 m: 2 * 43 + 1; the half width is 0.35 m.
OF_SONARS = pytest.approx((0.11, 31, 0.42, 0.13, 0.13))
OF_LASER = pytest.approx((0.04, 87, 0.37, 0.05, 0.03))


def test_each_kind_of_sensor_has_its_own_cells_and_margins_in_any_order():
    made = method(**APART)
    assert margins(made) == OF_SONARS
    for half_angle, wanted in ((LASER, OF_LASER), (SONAR, OF_SONARS), (LASER, OF_LASER)):
        made.sense(beams(half_angle), HERE)
        assert margins(made) == wanted


def test_the_floor_of_a_laser_is_no_larger_than_its_margin():
    made = method(**{**APART, "laser_floor": 0.08})
    made.sense(beams(LASER), HERE)
    assert (made.arc_margin, made.arc_floor) == (0.05, 0.05)


def test_without_an_enlargement_there_is_no_radius():
    made = method(**{**APART, "enlargement": "none"})
    for half_angle in (SONAR, LASER):
        made.sense(beams(half_angle), HERE)
        assert made.radius == -1.0


def test_another_kind_of_sensor_begins_an_empty_window_and_the_same_kind_goes_on():
    made = method(**APART)
    made.sense(beams(LASER, (0.9, 0.1)), HERE)
    assert made.grid.any()
    made.sense(beams(LASER, (1.5, 0.1)), HERE)
    assert np.count_nonzero(made.grid) >= 2
    made.sense(beams(SONAR), HERE)
    assert not made.grid.any()


NEAR, FAR = ((0.8, 0.1), (0.7, -0.3)), ((-1.0, -0.3), (-1.1, 0.4), (-1.2, 0.0))


def histogram(target, *places, **given):
    made = method(**{**APART, **given})
    for _ in range(6):
        made.sense(beams(LASER, *places), HERE)
    made.look(HERE, (0.0, 0.0), (target, 0.0))
    return made.density.copy()


@pytest.mark.parametrize("enlargement", ["footprint", "none"])
def test_only_cells_before_the_target_and_the_robots_width_enter_the_histogram(enlargement):
    """A target at 0.5 m, and 0.37 or 0.35 m more: cells from 0.87 m on do not count; the nearer ones all do."""
    near = histogram(3.0, *NEAR, enlargement=enlargement)
    assert np.count_nonzero(near) > 2
    assert histogram(0.5, *FAR, *NEAR, enlargement=enlargement) == pytest.approx(near)
    assert histogram(0.5, *NEAR, *FAR, enlargement=enlargement) == pytest.approx(near)
    assert histogram(3.0, *FAR, *NEAR, enlargement=enlargement) != pytest.approx(near)
    assert not histogram(0.2, *NEAR, enlargement=enlargement).any()


def test_all_cells_count_for_a_robot_that_does_not_stop_at_its_target():
    everything = histogram(3.0, *FAR, *NEAR)
    assert histogram(0.5, *FAR, *NEAR, stops_at_target=False) == pytest.approx(everything)


def test_a_histogram_of_the_one_before_does_not_remain():
    """Of either enlargement; the second window is empty."""
    for enlargement in ("footprint", "none"):
        made = method(**{**APART, "enlargement": enlargement})
        for _ in range(6):
            made.sense(beams(LASER, *NEAR), HERE)
        made.look(HERE, (0.0, 0.0), (3.0, 0.0))
        assert made.density.any()
        made.sense(beams(SONAR), HERE)
        made.look(HERE, (0.0, 0.0), (3.0, 0.0))
        assert not made.density.any()

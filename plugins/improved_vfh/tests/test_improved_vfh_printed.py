"""The numbers that section III.C prints, each through the shipped preset: echoes in, command out.

Each echo marks one cell of 0.1 m, whose centre is at an odd multiple of 0.05 m. A cell in a sector (5 degrees) and at a
distance d adds m = 1 - d / 2.263 to it. The smoothing spreads that over 11 sectors with the weights 1 to 6 to 1,
divided by 11. A sector is blocked from 0.53 * 6 / 11 on.
"""

import math

import numpy as np
import pytest
from avoider_scans import SQUARE, given
from navloom import RangeScan
from navloom.testing import context, make, robot
from navloom_improved_vfh.adapter import ImprovedVfh

EVERYWHERE = np.arange(0.0, 360.0, 5.0)


def printed(**limits):
    """The preset of the paper on its robot, 0.8 x 0.8 m, whose own limits are out of the way."""
    limits = {"max_linear": 2.0, "max_angular": math.pi, **limits}
    within = context(robot(footprint=SQUARE, **limits), role="avoider")
    return make(ImprovedVfh, within, **ImprovedVfh.presets["printed"].values())


def cones(directions, ranges, heading=0.0, half_angle=0.021, range_min=0.1):
    """A scan of narrow cones from the robot's centre; directions in the pose frame and heading in degrees, m."""
    bearings = np.radians(np.asarray(directions, np.float64) - heading)
    n = bearings.size
    return RangeScan(
        0, np.zeros((n, 2)), bearings, np.full(n, half_angle), np.zeros(n), np.broadcast_to(ranges, n).astype(float),
        range_min, 4.0,
    )  # fmt: skip


def drive(avoider, scan, heading=0.0, x=0.05, target=0.0):
    """Forward speed, m/s, and turn rate, degrees per second, for a target 5 m off in a direction; degrees."""
    place = (x + 5.0 * math.cos(math.radians(target)), 5.0 * math.sin(math.radians(target)))
    answer = avoider.avoid(given(scan, x=x, heading=math.radians(heading), target=place))
    return answer.twist.vx, math.degrees(answer.twist.wz)


def gate(heading=0.0, x=0.05, middle=0.45):
    """Two posts, 0.3 m apart, with the cell centres (middle - x, +-0.15) in axes of the pose frame."""
    side = math.degrees(math.atan2(0.15, middle - x))
    return cones([side, -side], math.hypot(middle - x, 0.15), heading)


def ring(*openings, heading=0.0, width=40.0):
    """Echoes 0.637 m away in all directions but those of the openings; degrees, pose frame."""
    closed = [d for d in EVERYWHERE + 2.5 if all(abs((d - o + 180.0) % 360.0 - 180.0) > width for o in openings)]
    return cones(closed, 0.637, heading)


def test_v_is_5_times_d30_beyond_0_4_m_measured_from_the_centre():
    """The posts at (0.40, +-0.15) are sqrt(0.1825) = 0.4272 m away, in sectors 4 and -5; the slot between them is
    20 degrees wide and straight ahead: V = 5 * 0.0272."""
    assert drive(printed(), gate()) == (pytest.approx(5.0 * (math.sqrt(0.1825) - 0.4)), pytest.approx(0.0, abs=1e-9))


def test_far_from_obstacles_v_is_0_5():
    assert drive(printed(), cones(EVERYWHERE, math.inf)) == (0.5, 0.0)


def test_d30_is_of_the_30_degrees_on_each_side_of_the_heading():
    """Posts at (0.265, +-0.15) are 0.30 m away at 29.5 degrees: V = 0. At (0.255, +-0.15) they are at 30.5 degrees."""
    assert drive(printed(), gate(x=0.085, middle=0.35), x=0.085)[0] == 0.0
    assert drive(printed(), gate(x=0.095, middle=0.35), x=0.095)[0] == 0.5


def test_omega_is_10_times_the_angle_to_the_slot_and_at_most_25_degrees_a_second():
    for off, turn in ((2.0, 20.0), (2.4, 24.0), (2.6, 25.0), (-4.0, -25.0)):
        assert drive(printed(), gate(heading=-off), heading=-off)[1] == pytest.approx(turn)


def test_v_is_divided_by_2_5_from_10_degrees_a_second_on():
    v = 5.0 * (math.sqrt(0.1825) - 0.4)
    for off, speed in ((0.9, v), (-0.99, v), (1.01, v / 2.5), (-1.1, v / 2.5)):
        assert drive(printed(), gate(heading=-off), heading=-off)[0] == pytest.approx(speed)


def test_the_division_ends_where_it_begins():
    """The turn rate alone decides: 11, 11 and 9.9 degrees a second in consecutive ticks."""
    avoider, v = printed(), 5.0 * (math.sqrt(0.1825) - 0.4)
    speeds = [drive(avoider, gate(heading=-off), heading=-off)[0] for off in (1.1, 1.1, 0.99)]
    assert speeds == pytest.approx([v / 2.5, v / 2.5, v])


def test_a_slot_counts_within_100_degrees_of_the_heading():
    """The only opening is in the direction of +90 degrees; the target is to the right, where nothing is open."""
    for heading, turn in ((-9.5, 25.0), (-10.5, -25.0)):  # 99.5 and 100.5 degrees from the opening
        assert drive(printed(), ring(90.0, heading=heading), heading=heading, target=-60.0)[1] == pytest.approx(turn)


def test_below_90_degrees_the_slot_nearest_the_target_is_taken_and_above_it_that_nearest_the_heading():
    """Openings at +-90 degrees, heading -5: the right one is nearer to the heading, the left one to the target."""
    for target, turn in ((84.5, 25.0), (85.5, -25.0)):  # 89.5 and 90.5 degrees from the heading
        scan = ring(90.0, -90.0, heading=-5.0)
        assert drive(printed(), scan, heading=-5.0, target=target)[1] == pytest.approx(turn)


def test_without_a_slot_it_rotates_by_100_degrees_to_the_side_of_the_target():
    """The way opens at once, but the rotation lasts until 100 degrees; then it steers back to the target."""
    avoider, free = printed(), cones(EVERYWHERE, math.inf)
    assert drive(avoider, ring(), target=60.0) == (0.0, pytest.approx(25.0))
    assert drive(avoider, free, heading=99.5, target=60.0) == (0.0, pytest.approx(25.0))
    assert drive(avoider, free, heading=100.5, target=60.0) == (pytest.approx(0.5 / 2.5), pytest.approx(-25.0))
    assert drive(printed(), ring(), target=-60.0)[1] == pytest.approx(-25.0)

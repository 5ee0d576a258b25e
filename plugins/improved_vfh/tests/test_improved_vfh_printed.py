"""The numbers that section III.C prints, each through the shipped preset: echoes in, command out.

Each echo marks one cell of 0.1 m, whose centre is at an odd multiple of 0.05 m. A cell in a sector (5 degrees) and at a
distance d adds m = 1 - d / 2.263 to it. The smoothing spreads that over 11 sectors with the weights 1 to 6 to 1,
divided by 11. A sector is blocked from 0.53 * 6 / 11 on.
"""

import math

import numpy as np
import pytest
from avoider_posts import EVERYWHERE, cones, drive, posts, preset, ring, tick
from navloom_improved_vfh.adapter import ImprovedVfh


def printed(**limits):
    """The shipped preset of the paper."""
    return preset(ImprovedVfh, "printed", **limits)


def gate(heading=0.0, x=0.05, middle=0.45):
    """Two posts, 0.3 m apart, with the cell centres (middle, +-0.15) in the pose frame."""
    return posts((middle, 0.15), (middle, -0.15), x=x, heading=heading)


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


def test_the_histogram_sums_the_cells_of_a_sector_and_smooths_them():
    """Cells at (0.40, 0.15) and (0.90, 0.35), both between 20 and 25 degrees, sector 4: 0.8112 + 0.5732 = 1.3844.

    Each is an axis cell, c = 3, and m = 1 - d / 2.2627 with d = 0.4272 and 0.9657.
    """
    told = tick(printed(), posts((0.45, 0.15), (0.95, 0.35))).diagnostics
    expected = {(4 + i) % 72: 1.3844 * (6 - abs(i)) / 11.0 for i in range(-5, 6)}
    found = {int(k): float(told.histogram[k]) for k in np.flatnonzero(told.histogram)}
    assert found == pytest.approx(expected, abs=1e-4)


def test_a_sector_is_blocked_from_the_threshold_on():
    """0.53 * 6 / 11 = 0.2891. The post in sector 4 leaves 0.8112 * 4 / 11 = 0.2950 in sectors 2 and 6 and
    0.8112 * 3 / 11 = 0.2212 beyond: blocked from 10 to 35 degrees."""
    told = tick(printed(), posts((0.45, 0.15))).diagnostics
    assert told.threshold == pytest.approx(0.53 * 6.0 / 11.0)
    assert np.degrees(told.slots).tolist() == [[pytest.approx(35.0), pytest.approx(370.0)]]


def test_an_arc_cell_weighs_4_where_an_axis_cell_weighs_9():
    """A reading 0.85 m ahead of a cone of 30 degrees: one cell of 3 and arc cells of 2 beside it."""
    told = tick(printed(), cones([3.0], 0.87, half_angle=math.radians(15.0)), x=0.0).diagnostics
    alone = tick(printed(), posts((0.85, 0.05), x=0.0), x=0.0).diagnostics
    (row, column), *more = np.argwhere(told.window == 3)
    assert not more and alone.window[row, column] == 3 and (told.window == 2).sum() == 4
    cells = [(0.05 + 0.1 * (c - 16), 0.05 + 0.1 * (r - 16), told.window[r, c]) for r, c in np.argwhere(told.window)]
    mass = sum(float(c) ** 2 / 9.0 * (1.0 - math.hypot(x, y) / (1.6 * math.sqrt(2.0))) for x, y, c in cells)
    assert told.histogram.sum() == pytest.approx(mass * 36.0 / 11.0)


def test_another_scan_sets_all_other_squares_to_0():
    avoider = printed()
    assert tick(avoider, posts((0.85, 0.25))).diagnostics.window.sum() == 3
    told = tick(avoider, posts((0.85, -0.25))).diagnostics
    assert told.window.sum() == 3 and told.window[13, 24] == 3  # y -0.25 in row 16 - 3, x 0.85 in column 16 + 8


def test_a_slot_wider_than_18_sectors_is_entered_9_sectors_inside_its_edge():
    """Blocked from 10 to 35 degrees: the candidates are 35 + 45 and 10 - 45 degrees; the target is straight ahead."""
    assert math.degrees(tick(printed(), posts((0.45, 0.15))).diagnostics.chosen) == pytest.approx(-35.0)


def test_a_slot_of_20_sectors_is_wide():
    """It is entered 45 degrees inside the edge on the side of the target, not in its middle."""
    told = tick(printed(), ring(90.0, width=62.0), target=60.0).diagnostics
    (slot,) = np.degrees(told.slots).tolist()
    assert slot[1] - slot[0] == pytest.approx(100.0) and math.degrees(told.chosen) == pytest.approx(slot[0] + 45.0)


def test_obstacles_behind_the_target_count():
    """A post 1.05 m away, 0.65 m behind the target, farther than half the robot's width."""
    assert tick(printed(), posts((1.05, 0.05), x=0.0), x=0.0, distance=0.4).diagnostics.histogram.any()


def test_a_robot_that_brakes_badly_is_as_fast():
    """0.02 m/s^2 would stop only 0.106 m/s in the 0.28 m before the posts."""
    assert drive(printed(max_deceleration=0.02), gate())[0] == pytest.approx(5.0 * (math.sqrt(0.1825) - 0.4))


def test_the_direction_chosen_last_is_not_preferred():
    avoider = printed()
    assert drive(avoider, ring(90.0, -90.0), target=1.0)[1] == pytest.approx(25.0)
    assert drive(avoider, ring(90.0, -90.0), target=-1.0)[1] == pytest.approx(-25.0)


def test_it_drives_while_it_turns_to_a_slot_far_off_the_heading():
    """The opening is 90 degrees to the left; nothing is within 0.5 m, so V = 0.5 / 2.5."""
    assert drive(printed(), ring(90.0), target=90.0)[0] == pytest.approx(0.2)


def test_a_laser_marks_cells_of_0_1_m_too_and_its_readings_are_not_averaged():
    told = tick(printed(), cones([1.4, 2.4, 3.4], [1.0, 1.06, 1.0], half_angle=0.0), x=0.0).diagnostics
    assert told.window.shape == (33, 33)
    assert sorted(np.argwhere(told.window == 3).tolist()) == [[16, 25], [16, 26]]  # x from 0.9 and from 1.0 m on


def test_readings_at_the_least_range_count_there_only():
    told = tick(printed(), cones([2.0], 1.03, range_min=1.03), x=0.0).diagnostics
    assert np.argwhere(told.window).tolist() == [[16, 26]]


def test_an_arc_is_drawn_whole_where_a_neighbour_sees_through_it():
    told = tick(printed(), cones([0.0, 10.0], [0.95, math.inf], half_angle=math.radians(12.5))).diagnostics
    assert np.count_nonzero(told.window) == 7


def test_a_far_cell_counts_in_full_however_wide_its_arc_would_be():
    """1.5508 m: m = 1 - 1.5508 / 2.2627 = 0.3146, and 6 / 11 of it are left in its own sector."""
    told = tick(printed(), posts((1.55, 0.05), x=0.0), x=0.0).diagnostics
    assert told.histogram[0] == pytest.approx(0.3146 * 6.0 / 11.0, abs=1e-4)

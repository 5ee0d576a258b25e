"""The preset that is the defaults, value by value: echoes in, command and window out.

A cell at a distance d adds m = 1 - d / 1.3 and blocks the directions within arcsin(0.45 / d) of it (0.4 m of the robot
and 0.05 m of margin) if m is 0.12 or more.
"""

import math

import numpy as np
import pytest
from avoider_posts import EVERYWHERE, SLIM, cones, drive, posts, preset, ring, tick
from navloom_improved_vfh.adapter import ImprovedVfh

GAP = (0.75, 0.35), (0.75, -0.35)
"""Posts at 25 degrees on both sides and sqrt(0.685) m away: a slim robot drives between them."""


def robust(**given):
    return preset(ImprovedVfh, "robust", **given)


def between(avoider, off=0.0, middle=0.75, x=0.0):
    """Speed and turn rate of a robot that looks to the right of the gap by some degrees."""
    return drive(avoider, posts((middle, 0.35), (middle, -0.35), x=x, heading=-off), x=x, heading=-off)


def test_a_cell_blocks_the_directions_in_which_the_robot_would_meet_it():
    """(1.05, 0.15): d = 1.06066, 8.13 degrees, arcsin(0.45 / d) = 25.10 degrees. The middles of the sectors -3 to 6,
    -12.5 to 32.5 degrees, lie within -16.97 and 33.23."""
    told = tick(robust(), posts((1.05, 0.15), x=0.0), x=0.0).diagnostics
    found = {int(k): float(told.histogram[k]) for k in np.flatnonzero(told.histogram)}
    assert found == pytest.approx({k % 72: 1.0 - 1.06066 / 1.3 for k in range(-3, 7)}, abs=1e-5)


def test_a_cell_blocks_from_0_12_on():
    """1.1311 m leaves 0.1299, 1.1511 m leaves 0.1145."""
    assert tick(robust(), posts((1.15, 0.05), x=0.02), x=0.02).diagnostics.chosen != 0.0
    assert tick(robust(), posts((1.15, 0.05), x=0.0), x=0.0).diagnostics.chosen == 0.0


def test_cells_behind_the_target_do_not_count():
    """The cell is 1.051 m away: behind a target at 0.5 m and the robot's 0.45 m, before one at 0.7 m."""
    assert tick(robust(), posts((1.05, 0.05), x=0.0), x=0.0, distance=0.5).diagnostics.chosen == 0.0
    assert tick(robust(), posts((1.05, 0.05), x=0.0), x=0.0, distance=0.7).diagnostics.chosen != 0.0


def test_a_wide_slot_is_entered_9_sectors_inside_its_edge():
    """Blocked from -15 to 35 degrees: 45 degrees to the right of that is -60; the target is at -30."""
    told = tick(robust(), posts((1.05, 0.15), x=0.0), x=0.0, target=-30.0).diagnostics
    assert math.degrees(told.chosen) == pytest.approx(-60.0)


def test_a_slot_of_20_sectors_is_wide():
    told = tick(robust(), ring(90.0, width=75.0, distance=1.0), target=20.0).diagnostics
    (slot,) = np.degrees(told.slots).tolist()
    assert slot == [pytest.approx(40.0), pytest.approx(140.0)]
    assert math.degrees(told.chosen) == pytest.approx(40.0 + 45.0)


def test_slots_count_within_100_degrees_of_the_heading():
    for heading, turn in ((-9.5, 25.0), (-10.5, -25.0)):
        scan = ring(90.0, heading=heading, distance=1.0, width=60.0)
        assert drive(robust(), scan, heading=heading, target=-60.0)[1] == pytest.approx(turn)


def test_from_90_degrees_on_the_slot_nearest_the_heading_is_taken():
    for target, turn in ((84.5, 25.0), (85.5, -25.0)):
        scan = ring(90.0, -90.0, heading=-5.0, distance=1.0, width=60.0)
        assert drive(robust(), scan, heading=-5.0, target=target)[1] == pytest.approx(turn)


def test_the_direction_chosen_last_is_worth_20_degrees():
    """Openings at +-90 degrees, the left one chosen; for a target at -9.5 it costs 99.5 - 20, the right one 80.5."""
    for target, turn in ((-9.5, 25.0), (-10.5, -25.0)):
        avoider = robust()
        drive(avoider, ring(90.0, -90.0, distance=1.0, width=60.0), target=2.0)
        assert drive(avoider, ring(90.0, -90.0, distance=1.0, width=60.0), target=target)[1] == pytest.approx(turn)


def test_a_rotation_lasts_100_degrees():
    avoider, free = robust(), cones(EVERYWHERE, math.inf, half_angle=0.3)
    assert drive(avoider, ring(distance=1.0), target=60.0) == (0.0, pytest.approx(25.0))
    assert drive(avoider, free, heading=99.5, target=60.0)[1] == pytest.approx(25.0)
    assert drive(avoider, free, heading=100.5, target=60.0)[1] == pytest.approx(-25.0)


def test_v_is_5_times_d30_beyond_0_4_m_measured_from_the_front():
    """sqrt(0.685) - 0.4 = 0.42765 m before the front."""
    assert between(robust(footprint=SLIM)) == (
        pytest.approx(5.0 * (math.sqrt(0.685) - 0.8)), pytest.approx(0.0, abs=1e-9)
    )  # fmt: skip


def test_far_from_obstacles_v_is_0_5():
    assert drive(robust(), cones(EVERYWHERE, math.inf)) == (0.5, 0.0)


def test_d30_is_of_the_30_degrees_on_each_side_of_the_heading():
    """Posts at (0.615, +-0.35) are at 29.6 degrees, 0.31 m before the front; at (0.595, +-0.35) at 30.5 degrees."""
    assert between(robust(footprint=SLIM), middle=0.65, x=0.035)[0] == 0.0
    assert between(robust(footprint=SLIM), middle=0.65, x=0.055)[0] == 0.5


def test_omega_is_10_times_the_angle_to_the_slot_and_at_most_25_degrees_a_second():
    for off, turn in ((2.0, 20.0), (2.4, 24.0), (2.6, 25.0), (-4.0, -25.0)):
        assert between(robust(footprint=SLIM), off)[1] == pytest.approx(turn)


def test_v_is_divided_by_2_5_from_10_degrees_a_second_until_below_8():
    avoider, v = robust(footprint=SLIM), 5.0 * (math.sqrt(0.685) - 0.8)
    speeds = [between(avoider, off)[0] for off in (0.9, 1.1, 0.85, 0.75, 0.9)]
    assert speeds == pytest.approx([v, v / 2.5, v / 2.5, v, v])


def test_it_turns_in_place_to_a_slot_more_than_45_degrees_off():
    for off, is_driving in ((44.0, True), (46.0, False)):
        speed, turn = between(robust(footprint=SLIM, changes={"arc_check": False}), off)
        assert (speed > 0.0, turn) == (is_driving, pytest.approx(25.0))


def test_it_can_brake_before_an_obstacle_ahead():
    """1.15 m less 0.4 m to the front and 0.12 m of margin are 0.63 m, in which 0.1 m/s^2 stop sqrt(0.126) m/s."""
    avoider = robust(max_deceleration=0.1, changes={"arc_check": False})
    assert drive(avoider, posts((1.15, 0.05), x=0.0), x=0.0)[0] == pytest.approx(math.sqrt(2.0 * 0.1 * 0.63))


def test_a_turn_in_place_keeps_0_12_m_for_a_tick_and_0_2_s():
    """A post 0.15 m beside the robot and p ahead of its centre: after 0.25 s at 25 degrees a second it is
    0.55 cos 6.25 - p sin 6.25 - 0.4 m beside it: 0.118 m for p = 0.26, so half the turn; 0.123 m for p = 0.22."""
    for x, turn in ((0.09, -12.5), (0.13, -25.0)):
        answer = drive(robust(), ring(distance=0.8, width=0.0), posts((0.35, -0.55), x=x), x=x, target=-90.0)
        assert answer == (0.0, pytest.approx(turn))


def test_a_scan_clears_its_own_cones_only():
    avoider = robust()
    tick(avoider, posts((0.85, 0.25)))
    assert tick(avoider, posts((0.85, -0.25))).diagnostics.window.sum() == 6


def test_part_of_an_arc_that_a_neighbour_sees_through_is_left_out():
    told = tick(robust(), cones([0.0, 10.0], [0.95, math.inf], half_angle=math.radians(12.5))).diagnostics
    assert np.count_nonzero(told.window) == 4


def test_a_reading_at_the_least_range_marks_0_25_m_before_it():
    """1.08 m at steps of 0.05 m down to 0.83 m: the cells from 1.0, 0.9 and 0.8 m on."""
    told = tick(robust(), cones([2.0], 1.08, range_min=1.08), x=0.0).diagnostics
    assert np.argwhere(told.window).tolist() == [[16, 24], [16, 25], [16, 26]]


def test_a_reading_beyond_the_least_range_clears_what_is_nearer():
    avoider = robust()
    tick(avoider, posts((0.85, 0.05), x=0.0), x=0.0)
    told = tick(avoider, cones([3.4], math.inf, half_angle=0.3, range_min=1.2), x=0.0).diagnostics
    assert told.window.sum() == 0


def test_cells_within_0_05_m_of_a_cones_flank_are_kept():
    """The cell is 0.8515 m away at 3.366 degrees, the flank 3.6 degrees from it, 0.0535 m; or 3.1 degrees, 0.046 m."""
    for beside, left in ((3.6, 0), (3.1, 3)):
        avoider = robust()
        tick(avoider, posts((0.85, 0.05), x=0.0), x=0.0)
        axis = 3.366 + math.degrees(0.3) - beside
        assert tick(avoider, cones([axis], math.inf, half_angle=0.3), x=0.0).diagnostics.window.sum() == left


def test_cells_deep_under_the_robot_are_cleared():
    assert tick(robust(), posts((0.25, 0.15))).diagnostics.window.sum() == 0


def test_a_lasers_readings_within_0_1_m_are_averaged():
    """Of 1.00, 1.09 and 1.00 m each becomes 1.03 m; 1.11 m stays apart. Cells are 0.05 m: the one from 1.0 m on is
    column 33 + 20, that from 0.95 m on 52, that from 1.1 m on 55."""
    for middle, columns in ((1.09, [53]), (1.11, [52, 55])):
        told = tick(robust(), cones([0.4, 1.4, 2.4], [1.0, middle, 1.0], half_angle=0.0), x=0.0).diagnostics
        assert told.window.shape == (67, 67)
        assert sorted({int(column) for _, column in np.argwhere(told.window)}) == columns


def test_a_laser_is_exact_so_its_cells_block_with_0_03_m_of_margin():
    """(0.725, 0.225): d = 0.7591, 17.24 degrees, arcsin(0.43 / d) = 34.50 degrees: -17.26 to 51.74 degrees; the middles
    -12.5 to 47.5 of the sectors -3 to 9 lie within. (0.725, 0.275): 20.77 and 33.68, so -12.91 to 54.45 degrees."""
    for bearing, distance, last in ((17.24, 0.7591, 9), (20.77, 0.7754, 10)):
        told = tick(robust(), cones([bearing], distance, half_angle=0.0), x=0.0).diagnostics
        found = sorted(((np.flatnonzero(told.histogram) + 36) % 72 - 36).tolist())
        assert found == list(range(-3, last + 1))


def test_a_laser_keeps_0_06_m_and_lets_a_cell_within_come_nearer_by_a_quarter_of_what_it_is_above_0_02_m():
    """A cell 0.075 m beside the robot and p ahead: after 0.25 s at 25 degrees a second it is
    0.475 cos 6.25 - p sin 6.25 - 0.4 m beside it, 0.0510 m for p = 0.195 and 0.0493 m for p = 0.21; 0.05 m are left."""
    for x, turn in ((0.03, -25.0), (0.015, -12.5)):
        side = math.degrees(math.atan2(-0.475, 0.225 - x))
        scan = cones([*(EVERYWHERE + 2.5), side], [0.8] * 72 + [math.hypot(0.225 - x, 0.475)], half_angle=0.0)
        avoider = robust(changes={"agreement": 0.0})
        assert drive(avoider, scan, x=x, target=-90.0)[1] == pytest.approx(turn)


def test_without_room_to_turn_it_creeps_out_at_0_1_m_a_second():
    """A post 0.05 m beside the robot's front half."""
    answer = drive(robust(), ring(distance=0.8, width=0.0), posts((0.35, -0.45), x=0.0), x=0.0, target=-90.0)
    assert answer == (pytest.approx(0.1), pytest.approx(0.0))


def test_after_1_s_without_room_to_move_it_turns_the_other_way():
    """Posts 0.05 m off on all sides. Ticks are 0.25 s apart: after the fifth it was blocked for 1.25 s."""
    scan = posts((0.35, 0.45), (0.35, -0.45), (-0.35, 0.45), (-0.35, -0.45), (0.45, 0.05), (0.45, -0.05), x=0.0)
    avoider, signs = robust(period=0.25), []
    for _ in range(7):
        told = tick(avoider, scan, ring(distance=0.8, width=0.0), x=0.0, target=-90.0)
        assert (told.twist.vx, told.twist.wz) == (0.0, 0.0)
        signs.append("right" if "rotating right" in told.diagnostics.why else "left")
    assert signs == ["right"] * 5 + ["left"] * 2


def test_the_fourth_time_without_room_after_a_search_is_the_last():
    """The search counts as the first of four attempts, and every fifth tick of 0.25 s as another: the 20th gives up."""
    scan = posts((0.35, 0.45), (0.35, -0.45), (-0.35, 0.45), (-0.35, -0.45), (0.45, 0.05), (0.45, -0.05), x=0.0)
    avoider = robust(period=0.25)
    told = [tick(avoider, scan, ring(distance=0.8, width=0.0), x=0.0, target=-90.0).status for _ in range(20)]
    assert told == ["steering"] * 19 + ["trapped"]


def test_after_a_trap_the_side_of_the_next_rotation_is_that_of_the_new_target():
    """It rotated to the left, gave up, and is sent to the right."""
    avoider, wall = robust(period=0.5), ring(distance=0.8, width=0.0)
    told = [tick(avoider, wall, x=0.0, target=90.0) for _ in range(61)]
    assert (told[0].twist.wz > 0.0, told[-1].status) == (True, "trapped")
    assert tick(avoider, wall, x=0.0, target=-90.0).twist.wz < 0.0


def trapped(avoider, scan, period):
    """Seconds until it gives up."""
    for count in range(1, 1000):
        if tick(avoider, scan, x=0.0, target=30.0).status == "trapped":
            return count * period
    return math.inf


POST = posts((0.85, 0.25), x=0.0)


def test_it_gives_up_after_30_s_without_progress():
    assert trapped(robust(period=0.5), POST, 0.5) == pytest.approx(30.5)


def test_an_approach_of_more_than_0_1_m_is_progress():
    for nearer, waits in ((0.09, False), (0.11, True)):
        avoider = robust(period=0.5)
        for _ in range(60):
            tick(avoider, POST, x=0.0, target=30.0)
        is_steering = tick(avoider, POST, x=0.0, target=30.0, distance=5.0 - nearer).status == "steering"
        assert is_steering is waits


def test_a_target_more_than_0_5_m_away_from_the_last_is_new():
    for away, waits in ((0.48, False), (0.52, True)):
        avoider = robust(period=0.5)
        for _ in range(60):
            tick(avoider, POST, x=0.0, target=30.0)
        is_steering = tick(avoider, POST, x=0.0, target=30.0, distance=5.0 + away).status == "steering"
        assert is_steering is waits


def test_a_trapped_robot_is_released_by_0_3_m_by_45_degrees_or_by_another_target():
    for changed, is_released in (
        ({"x": 0.29}, False), ({"x": 0.31}, True), ({"heading": 44.0}, False), ({"heading": -46.0}, True),
        ({"distance": 5.48}, False), ({"distance": 5.52}, True),
    ):  # fmt: skip
        avoider = robust(period=0.5)
        trapped(avoider, POST, 0.5)
        place = {"x": 0.0, "target": 30.0, "distance": 5.0} | changed
        told = tick(avoider, cones(EVERYWHERE, math.inf, half_angle=0.3), **place)
        assert (told.status != "trapped") is is_released, changed

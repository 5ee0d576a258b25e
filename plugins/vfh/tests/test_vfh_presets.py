"""The presets of the three methods, value by value: echoes in, command and window out.

A cell of full certainty, 15, has the magnitude 1 - d / 1.6 in VFH and 1 - (d / 1.6)^2 in VFH+ and VFH*; by default it
blocks the directions within arcsin(0.5 / d), 0.4 m of the robot and 0.1 m of margin.
"""

import math

import numpy as np
import pytest
from avoider_posts import EVERYWHERE, cones, drive, posts, preset, ring, tick
from navloom_vfh.adapter import Vfh, VfhPlus, VfhStar
from navloom_vfh.lookahead import TOTAL

FREE = cones(EVERYWHERE, math.inf, half_angle=0.0)
ALL = [(method, name) for method in (Vfh, VfhPlus, VfhStar) for name in ("robust", "printed")]
EACH = pytest.mark.parametrize(("method", "name"), ALL, ids=[f"{m.name}@{n}" for m, n in ALL])
ROBUST = pytest.mark.parametrize("method", [Vfh, VfhPlus, VfhStar], ids=lambda method: method.name)
ENLARGED = [case for case in ALL if case != (Vfh, "printed")]
EACH_ENLARGED = pytest.mark.parametrize(("method", "name"), ENLARGED, ids=[f"{m.name}@{n}" for m, n in ENLARGED])
AFTER = [(VfhPlus, "robust"), (VfhPlus, "printed"), (VfhStar, "robust"), (VfhStar, "printed")]
EACH_AFTER = pytest.mark.parametrize(("method", "name"), AFTER, ids=[f"{m.name}@{n}" for m, n in AFTER])


def is_point(method, name):
    """Whether the preset is VFH as printed: readings only add, by 1, and the robot is a point."""
    return (method, name) == (Vfh, "printed")


def sure(avoider, *scans, times=15, **place):
    """The last answer to scans that are repeated until their cells have full certainty."""
    for _ in range(times):
        answer = tick(avoider, *scans, **place)
    return answer


def sectors(diagnostics):
    """Sectors with any density, from -36 to 35."""
    return sorted(((np.flatnonzero(diagnostics.histogram) + 36) % 72 - 36).tolist())


@EACH
def test_the_window_has_cells_of_0_1_m_and_the_histogram_72_sectors(method, name):
    side = 81 if method is VfhStar else 33
    told = tick(preset(method, name), FREE, x=2.05).diagnostics
    assert told.window.shape == (side, side) and told.histogram.shape == (72,)
    assert (told.window_x, told.window_y) == pytest.approx((2.0 - 0.1 * (side // 2), -0.1 * (side // 2)))


@EACH
def test_an_echo_adds_3_and_a_look_through_takes_1_off(method, name):
    """As printed, VFH adds 1 and takes nothing off."""
    avoider, added, left = preset(method, name), *((1, 1) if is_point(method, name) else (3, 2))
    assert tick(avoider, posts((0.85, 0.25))).diagnostics.window.sum() == added
    bearing = math.degrees(math.atan2(0.25, 0.8))
    assert tick(avoider, cones([bearing], math.inf)).diagnostics.window.sum() == left


@ROBUST
def test_the_last_0_1_m_before_an_echo_are_not_taken_off(method):
    """The beam at 6.14 degrees enters the cell (0.95, 0.05) 0.9052 m away. Its echo at 1.02 m takes it off, that at
    0.99 m does not."""
    for echo, left in ((1.02, 2), (0.99, 3)):
        avoider = preset(method, "robust")
        tick(avoider, posts((0.95, 0.05), x=0.0), x=0.0)
        window = tick(avoider, cones([6.14], echo), x=0.0).diagnostics.window
        assert window[window.shape[0] // 2, window.shape[0] // 2 + 9] == left


@EACH_AFTER
def test_as_printed_a_beam_takes_off_all_cells_before_its_echo(method, name):
    avoider = preset(method, name)
    tick(avoider, posts((0.95, 0.05), x=0.0), x=0.0)
    window = tick(avoider, cones([6.14], 0.945), x=0.0).diagnostics.window
    assert window[window.shape[0] // 2, window.shape[0] // 2 + 9] == (3 if name == "robust" else 2)


@EACH
def test_a_reading_at_the_least_range_counts_0_1_m_before_it_too(method, name):
    """As printed it does not. At steps of 0.05 m, 0.3 m from a sensor at 0.5 m counts at 0.8, 0.75 and 0.7 m (times the
    cosine of 2 degrees: the cells from 0.7 and from 0.6 m on), and 1.07 m at 1.07 and 1.02 m."""
    for origin, distance, columns in ((0.5, 0.3, [6, 7]), (0.0, 1.07, [10])):
        scan = cones([2.0], distance, range_min=distance, origin=(origin, 0.0))
        window = tick(preset(method, name), scan, x=0.0).diagnostics.window
        middle = window.shape[0] // 2
        expected = columns if name == "robust" else columns[-1:]
        assert np.argwhere(window).tolist() == [[middle, middle + column] for column in expected]


@EACH
def test_a_lasers_readings_within_0_1_m_are_averaged(method, name):
    """Of 1.00, 1.09 and 1.00 m each becomes 1.03 m; 1.11 m stays apart. As printed, all stay as they are."""
    for middle, columns in ((1.09, [10]), (1.11, [9, 11])):
        scan = cones([0.4, 1.4, 2.4], [1.0, middle, 1.0], half_angle=0.0)
        window = tick(preset(method, name), scan, x=0.0).diagnostics.window
        found = sorted({int(column) - window.shape[0] // 2 for _, column in np.argwhere(window)})
        assert found == (columns if name == "robust" else sorted({9, math.floor(10.0 * middle)}))


@EACH_ENLARGED
def test_a_cell_blocks_the_directions_in_which_the_inscribed_disc_and_0_1_m_would_meet_it(method, name):
    """(1.05, 0.15): 8.13 degrees, arcsin(0.5 / 1.0607) = 28.13: the middles -17.5 to 32.5 of the sectors -4 to 6.
    (1.05, 0.25): 13.39 degrees, arcsin(0.5 / 1.0794) = 27.60: -12.5 to 37.5, sectors -3 to 7. VFH smooths over one
    sector more on each side."""
    more = 1 if method is Vfh else 0
    for y, first, last in ((0.15, -4, 6), (0.25, -3, 7)):
        told = tick(preset(method, name), posts((1.05, y), x=0.0), x=0.0).diagnostics
        assert sectors(told) == list(range(first - more, last + more + 1))


def test_the_density_of_a_cell():
    """(1.05, 0.15) after one reading of 3: VFH (3 / 15)^2 (1 - 1.0607 / 1.6) times the smoothing's 4 / 3 in the middle;
    VFH+ (3 / 15)^2 (1 - (1.0607 / 1.6)^2); VFH as printed (1 / 15)^2 (1 - 1.0607 / 2.2627) times 6 / 11."""
    near = 1.0606602 / 1.6
    for method, name, expected in (
        (Vfh, "robust", 0.04 * (1.0 - near) * 4.0 / 3.0),
        (VfhPlus, "robust", 0.04 * (1.0 - near * near)),
        (VfhPlus, "printed", 0.04 * (1.0 - near * near)),
        (VfhStar, "robust", 0.04 * (1.0 - near * near)),
        (Vfh, "printed", (1.0 - 1.0606602 / 2.2627417) / 225.0 * 6.0 / 11.0),
    ):
        told = tick(preset(method, name), posts((1.05, 0.15), x=0.0), x=0.0).diagnostics
        assert told.histogram[1] == pytest.approx(expected, rel=1e-5), (method, name)


def test_as_printed_vfh_smooths_a_cell_of_a_point_robot_over_11_sectors():
    told = tick(preset(Vfh, "printed"), posts((1.05, 0.15), x=0.0), x=0.0).diagnostics
    assert sectors(told) == list(range(-4, 7))
    assert told.histogram[3] == pytest.approx(told.histogram[1] * 4.0 / 6.0)


def test_vfh_blocks_from_0_3_on():
    """By default 1 - d / 1.6: 0.3056 at 1.1111 m and 0.2931 at 1.1311 m; as printed 1 - d / 2.2627: 0.3061 at 1.5700 m
    and 0.2977 at 1.5890 m."""
    for x, is_blocked in ((0.04, True), (0.02, False)):
        told = sure(preset(Vfh, "robust"), posts((1.15, 0.05), x=x), x=x).diagnostics
        assert (told.chosen != 0.0) is is_blocked
    for y, is_blocked in ((0.25, True), (0.35, False)):
        target = math.degrees(math.atan2(y, 1.55))
        told = sure(preset(Vfh, "printed"), posts((1.55, y), x=0.0), x=0.0, target=target).diagnostics
        assert (told.chosen != pytest.approx(math.radians(target))) is is_blocked


@EACH_AFTER
def test_vfh_plus_blocks_above_0_4_and_frees_below_0_2(method, name):
    """1 - (d / 1.6)^2 is 0.4079 at 1.2311 m and 0.3983 at 1.2410 m. Looked through four times the certainty is 11, and
    (11 / 15)^2 0.4079 = 0.2194; after the fifth time (10 / 15)^2 0.4079 = 0.1813."""
    assert sure(preset(method, name), posts((1.25, 0.05), x=0.01), x=0.01).diagnostics.chosen == 0.0
    avoider = preset(method, name)
    assert sure(avoider, posts((1.25, 0.05), x=0.02), x=0.02).diagnostics.chosen != 0.0
    through = cones([math.degrees(math.atan2(0.05, 1.23))], math.inf)
    assert [tick(avoider, through, x=0.02).diagnostics.chosen == 0.0 for _ in range(5)] == [False] * 4 + [True]


@EACH_ENLARGED
def test_cells_behind_the_target_do_not_count(method, name):
    """The cell is 1.051 m away, behind a target at 0.5 m and the robot's 0.5 m. As printed it counts."""
    told = tick(preset(method, name), posts((1.05, 0.05), x=0.0), x=0.0, distance=0.5).diagnostics
    assert bool(told.histogram.any()) is (name == "printed")
    assert tick(preset(method, name), posts((1.05, 0.05), x=0.0), x=0.0, distance=0.6).diagnostics.histogram.any()


def test_as_printed_a_point_counts_cells_behind_the_target():
    told = tick(preset(Vfh, "printed"), posts((1.05, 0.05), x=0.0), x=0.0, distance=0.5).diagnostics
    assert told.histogram.any()


@EACH
def test_the_turn_rate_is_twice_the_angle_and_at_most_120_degrees_a_second(method, name):
    """The speed falls with it, from 0.78 to 0.04 m/s: V = 0.78 (1 - 10 / 120)."""
    assert drive(preset(method, name), FREE) == (pytest.approx(0.78), 0.0)
    assert drive(preset(method, name), FREE, target=5.0) == (pytest.approx(0.78 * 11.0 / 12.0), pytest.approx(10.0))
    assert drive(preset(method, name), FREE, target=90.0) == (pytest.approx(0.04), pytest.approx(120.0))


@EACH
def test_the_density_ahead_slows_it_down_and_4_stops_it(method, name):
    """The last posts that do not block, in the direction of travel: V = 0.78 (1 - m / 4)."""
    if is_point(method, name):
        bearing, m = math.degrees(math.atan2(0.35, 1.55)), 1.0 - math.hypot(1.55, 0.35) / (1.6 * math.sqrt(2.0))
        scan = posts((1.55, 0.35), x=0.0, heading=bearing)
        answer = sure(preset(method, name), scan, x=0.0, heading=bearing, target=bearing)
    elif method is Vfh:
        m = 1.0 - math.hypot(1.13, 0.05) / 1.6
        answer = sure(preset(method, name), posts((1.15, 0.05), x=0.02), x=0.02)
    else:
        m = 1.0 - (1.24**2 + 0.05**2) / 1.6**2
        answer = sure(preset(method, name), posts((1.25, 0.05), x=0.01), x=0.01)
    assert answer.twist.vx == pytest.approx(0.78 * (1.0 - m / 4.0))


@EACH
def test_a_wide_slot_is_entered_half_s_max_inside_its_edge(method, name):
    """VFH: 18 sectors, so 45 degrees beyond the edge; VFH+: 16 sectors, 40 degrees."""
    told = sure(preset(method, name), posts((0.85, 0.05), x=0.0), x=0.0).diagnostics
    (slot,) = np.degrees(told.slots)
    half = 45.0 if method is Vfh else 40.0
    assert min(abs(math.degrees(told.chosen) - edge) for edge in (slot[0] + half, slot[1] - half - 360.0)) < 1e-6


@EACH
def test_a_slot_as_wide_as_s_max_and_two_sectors_more_is_wide(method, name):
    """It is entered half of s_max inside the edge on the side of the target, not in its middle."""
    widest = 18 if method is Vfh else 16
    answers = []
    for width in np.arange(45.0, 90.0, 2.5):
        told = sure(preset(method, name), ring(90.0, width=width, distance=0.9), target=10.0, times=15).diagnostics
        (slot,) = np.degrees(told.slots)
        answers.append((round((slot[1] - slot[0]) / 5.0), math.degrees(told.chosen) - slot[0]))
    wide = [offset for sectors, offset in answers if widest < sectors <= widest + 4]
    assert wide and wide == pytest.approx([2.5 * widest] * len(wide))


@pytest.mark.parametrize("name", ["robust", "printed"])
def test_the_target_weighs_5_and_heading_and_last_direction_2_each(name):
    """Openings at +-90 degrees, heading -30, where the last direction was too. The left one costs 5 (90 - t) + 4 * 120,
    the right one 5 (90 + t) + 4 * 60: equal at t = 24."""
    for target, turn in ((23.0, -120.0), (25.0, 120.0)):
        avoider = preset(VfhPlus, name, changes={"arc_check": False})
        scan = ring(90.0, -90.0, heading=-30.0, width=60.0, distance=1.0)
        for _ in range(15):
            avoider._method._previous = math.radians(-30.0)
            answer = tick(avoider, scan, heading=-30.0, target=target)
        assert np.degrees(answer.diagnostics.slots).round(6).tolist() == [[55.0, 125.0], [235.0, 305.0]]
        assert math.degrees(answer.twist.wz) == pytest.approx(turn)


STAR = pytest.mark.parametrize("name", ["robust", "printed"])


@STAR
def test_vfh_star_looks_5_steps_of_half_a_metre_ahead(name):
    """A target 1.2 m away is within a step of the second place, 1.0 m on: the third step leads there."""
    assert ", 5 steps ahead" in tick(preset(VfhStar, name), FREE).diagnostics.why
    assert ", 3 steps ahead" in tick(preset(VfhStar, name), FREE, distance=1.2).diagnostics.why
    assert preset(VfhStar, name)._method.nodes.shape[0] == 400


@STAR
def test_a_projected_step_weighs_5_1_and_1_and_counts_0_8_of_the_one_before(name):
    """At 2.0944 m/s and 120 degrees a second the circle has a radius of 1 m, and a step of 0.5 m turns by 0.5 rad.

    The target is 5 m to the left. The first step costs 2 * 1.5708 for the heading and as much for the last direction.
    It leads to (0.4794, 0.1224); from there the target is at 1.6688 rad, the step leads to 0.75 rad, and the heading is
    0.5 rad: 0.8 (5 * 0.9188 + 1.1688 + 0.0980) = 4.6885.
    """
    avoider = preset(VfhStar, name, changes={"look_ahead": 2, "max_speed": 3.0}, max_linear=3.0)
    tick(avoider, FREE, x=0.0, target=90.0, twist=(math.radians(120.0), 0.0))
    method = avoider._method
    assert method.nodes[method.way_end, TOTAL] == pytest.approx(2.0 * math.pi + 4.6885, abs=1e-3)


@EACH
def test_as_printed_the_command_is_sent_as_it_is(method, name):
    """The turn in place beside a post, which by default is halved: see below."""
    avoider = preset(method, name, max_angular=math.radians(25.0))
    answer = sure(avoider, ring(distance=0.8, width=0.0), posts((0.35, -0.55), x=0.09), x=0.09, target=-90.0)
    assert math.degrees(answer.twist.wz) == pytest.approx(-25.0 if name == "printed" else -12.5)


@EACH_AFTER
def test_cells_of_a_certainty_above_3_block_turning_circles(method, name):
    """At 1 m/s and 120 degrees a second the circle has a radius of 0.477 m; the cell (0.25, 0.75) lies in the left one.
    The target is 60 degrees to the left, where the cell alone, 4 / 15 or less, blocks nothing."""
    chosen = []
    for times in (1, 2):
        avoider = preset(method, name, changes={"count_up": 3 if times == 1 else 2, "arc_check": False})
        told = sure(avoider, posts((0.25, 0.75), x=0.0), times=times, x=0.0, target=80.0, twist=(1.0, 0.0)).diagnostics
        chosen.append(math.degrees(told.chosen))
    assert chosen[0] == pytest.approx(80.0) and chosen[1] < 72.0


def trapped(avoider, scan, period, **place):
    """Seconds until a robot that does as commanded, but comes no nearer to its target, gives up."""
    twist = (0.0, 0.0)
    for count in range(1, 2000):
        answer = tick(avoider, scan, twist=twist, **place)
        if answer.status == "trapped":
            return count * period
        twist = (answer.twist.vx, answer.twist.wz)
    return math.inf


POST = posts((0.85, 0.25), x=0.0)
HERE = {"x": 0.0, "target": 30.0}


@ROBUST
def test_it_gives_up_after_60_s_without_progress(method):
    assert trapped(preset(method, "robust", period=1.0), POST, 1.0, **HERE) == pytest.approx(61.0)


@ROBUST
def test_progress_is_0_1_m_and_a_target_0_5_m_away_is_another(method):
    for distance, is_new in ((4.91, False), (4.89, True), (5.48, False), (5.52, True)):
        avoider, twist = preset(method, "robust", period=1.0), (0.0, 0.0)
        for _ in range(60):
            answer = tick(avoider, POST, twist=twist, **HERE)
            twist = (answer.twist.vx, answer.twist.wz)
        after = tick(avoider, POST, twist=twist, distance=distance, **HERE)
        assert (after.status != "trapped") is is_new, distance


@ROBUST
def test_a_trapped_robot_is_released_by_0_3_m_by_45_degrees_or_by_another_target(method):
    for changed, is_released in (
        ({"x": 0.29}, False), ({"x": 0.31}, True), ({"heading": 44.0}, False), ({"heading": -46.0}, True),
        ({"distance": 5.48}, False), ({"distance": 5.52}, True),
    ):  # fmt: skip
        avoider = preset(method, "robust", period=1.0)
        trapped(avoider, POST, 1.0, **HERE)
        assert (tick(avoider, FREE, **{**HERE, **changed}).status != "trapped") is is_released, changed


@ROBUST
def test_where_nothing_is_free_it_turns_four_times_by_100_degrees(method):
    """It sees itself turn by 10.5 degrees a tick: each rotation ends after 10 ticks."""
    avoider = preset(method, "robust")
    answer = sure(avoider, ring(distance=0.8, width=0.0), target=60.0)
    assert (answer.twist.vx, math.degrees(answer.twist.wz)) == (0.0, pytest.approx(120.0))
    ticks = 0
    while answer.status != "trapped" and ticks < 99:
        ticks += 1
        heading = math.remainder(10.5 * ticks, 360.0)
        answer = tick(avoider, ring(distance=0.8, width=0.0, heading=heading), heading=heading, target=60.0)
    assert ticks == 40


@ROBUST
def test_a_turn_in_place_keeps_0_12_m_for_a_tick_and_0_2_s(method):
    """A robot of at most 25 degrees a second. A post 0.15 m beside it and p ahead: after 0.25 s it is
    0.55 cos 6.25 - p sin 6.25 - 0.4 m beside it: 0.118 m for p = 0.26, so half the turn; 0.123 m for p = 0.22."""
    for x, turn in ((0.09, -12.5), (0.13, -25.0)):
        avoider = preset(method, "robust", max_angular=math.radians(25.0))
        scans = ring(distance=0.8, width=0.0), posts((0.35, -0.55), x=x)
        answer = sure(avoider, *scans, x=x, target=-90.0)
        assert (answer.twist.vx, math.degrees(answer.twist.wz)) == (0.0, pytest.approx(turn))
        assert ("reduced by what is on the arc" in answer.diagnostics.why) is (turn == -12.5)


@ROBUST
def test_without_room_to_turn_it_creeps_out_at_0_1_m_a_second(method):
    """A post 0.05 m beside the robot's front half."""
    avoider = preset(method, "robust", max_angular=math.radians(25.0))
    scans = ring(distance=0.8, width=0.0), posts((0.35, -0.45), x=0.0)
    assert drive_after(avoider, *scans, x=0.0, target=-90.0) == (pytest.approx(0.1), pytest.approx(0.0))


@ROBUST
def test_after_1_s_without_room_to_move_it_turns_the_other_way(method):
    """Posts 0.05 m off on all sides. Ticks are 0.25 s apart: after five it was blocked for 1.25 s."""
    scan = posts((0.35, 0.45), (0.35, -0.45), (-0.35, 0.45), (-0.35, -0.45), (0.45, 0.05), (0.45, -0.05), x=0.0)
    avoider, sides = preset(method, "robust", period=0.25, max_angular=math.radians(25.0)), []
    for _ in range(40):
        told = tick(avoider, ring(distance=0.8, width=0.0), scan, x=0.0, target=-90.0)
        if "rotating" in told.diagnostics.why:
            sides.append("right" if "rotating right" in told.diagnostics.why else "left")
    turn = sides.index("left")
    assert sides[turn : turn + 6] == ["left"] * 5 + ["right"]


def drive_after(avoider, *scans, **place):
    """Speed and turn rate, degrees a second, once the scans have full certainty."""
    answer = sure(avoider, *scans, **place)
    return answer.twist.vx, math.degrees(answer.twist.wz)


STOPPED_BY_POSTS = {"threshold": 99.0, "min_speed": 0.0, "slow_density": 0.01}


def test_a_turn_slower_than_0_01_rad_a_second_counts_as_no_movement():
    """Two posts ahead stop it, and twice the angle to the target is its turn rate. After 1 s it turns away."""
    wall = posts((0.55, 0.05), (0.55, -0.05), x=0.0)
    for turn, ends in ((0.0115, 0.0115), (0.009, -math.radians(25.0))):
        limits = {"period": 0.25, "max_angular": math.radians(25.0), "changes": STOPPED_BY_POSTS}
        avoider, twist = preset(Vfh, "robust", **limits), (0.0, 0.0)
        for _ in range(8):
            answer = tick(avoider, wall, x=0.0, target=math.degrees(0.5 * turn), twist=twist)
            twist = (answer.twist.vx, answer.twist.wz)
        assert twist == (0.0, pytest.approx(ends)), turn


def test_it_turns_away_from_what_stops_it_at_its_own_limit():
    """The robot could turn by 180 degrees a second, the method by 10."""
    wall, changes = posts((0.55, 0.05), (0.55, -0.05), x=0.0), {**STOPPED_BY_POSTS, "max_turn_deg": 10.0}
    avoider = preset(Vfh, "robust", period=0.25, changes=changes)
    turns = [drive(avoider, wall, x=0.0) for _ in range(8)]
    assert turns[0] == (0.0, 0.0)
    assert turns[-1] == (0.0, pytest.approx(-10.0))


@EACH
def test_the_reason_counts_the_direction_from_the_target(method, name):
    """Nothing is in the way of a target 40 degrees to the left."""
    assert " +0 deg off the target" in tick(preset(method, name), FREE, target=40.0).diagnostics.why


@EACH_AFTER
def test_the_reason_counts_the_direction_across_180_degrees(method, name):
    """The middle of the only opening, 190 degrees to the left, is 20 degrees to the left of the target."""
    closed = ring(-170.0, heading=-170.0, width=70.0)
    told = sure(preset(method, name), closed, heading=-170.0, target=170.0).diagnostics
    assert " +20 deg off the target" in told.why


@EACH
def test_a_free_way_is_clear_in_every_direction(method, name):
    """Wrapping a direction changes its last digit, which is no obstacle."""
    told = [tick(preset(method, name), FREE, heading=float(t), target=float(t)).status for t in range(-180, 180, 15)]
    assert told == ["clear"] * 24

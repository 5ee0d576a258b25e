"""What `vfh_swept` adds to VFH*: the kept target, backing up, what the gate holds, and the speed to the target."""

import math

import numpy as np
import pytest
from avoider_drives import BOTH_KINDS, LASER, door, field, way_past
from avoider_scans import LIMIT, given, laser, make, sonars
from navloom_avoidance.points import points_in_base, remember
from navloom_vfh import free_run, survey
from navloom_vfh.adapter import VfhSwept
from navloom_vfh.held import Held
from navloom_vfh.kept_target import KeptTarget
from navloom_vfh.steering import stopping_speed, turning_speed
from navloom_vfh.stuck import Stuck

PERIOD = 0.05
FRONT = 0.4
AHEAD, BEHIND = (2.0, 0.0), (-2.0, 0.0)


def kept():
    """A keeper that has the target 2 m ahead, with 3 m of path after it; it keeps for 1 s, and 0.5 m is near."""
    keeper = KeptTarget(1.0, 0.5, 0.5)
    keeper.choose((0.0, 0.0), AHEAD, 3.0, True, PERIOD)
    return keeper


def test_a_jump_to_a_longer_path_is_not_followed_while_the_way_is_seen():
    assert kept().choose((0.0, 0.0), BEHIND, 8.0, True, PERIOD) == AHEAD


def test_the_path_is_followed_if_the_way_is_not_seen_if_it_is_shorter_and_if_the_target_slides():
    assert kept().choose((0.0, 0.0), BEHIND, 8.0, False, PERIOD) == BEHIND
    assert kept().choose((0.0, 0.0), BEHIND, 2.0, True, PERIOD) == BEHIND
    assert kept().choose((0.0, 0.0), (2.3, 0.3), 9.0, True, PERIOD) == (2.3, 0.3)


def test_a_kept_target_is_given_up_when_it_is_passed_and_after_its_time():
    assert kept().choose((1.6, 0.0), BEHIND, 8.0, True, PERIOD) == BEHIND
    keeper = kept()
    answers = [keeper.choose((0.0, 0.0), BEHIND, 8.0, True, 0.25) for _ in range(4)]
    assert answers == [AHEAD, AHEAD, AHEAD, BEHIND]


def test_a_robot_that_does_not_move_is_stuck_and_one_that_turns_is_not():
    stuck = Stuck(0.8, 0.4, 0.2)
    for k in range(20):
        stuck.note((0.0, 0.0, 0.1 * k), PERIOD)
    assert not stuck.is_due
    for _ in range(18):
        stuck.note((0.0, 0.0, 2.0), PERIOD)
    assert stuck.is_due


def test_backing_up_ends_after_its_distance_and_after_its_time():
    """0.4 m at 0.2 m/s take 2 s; after 3 s it ends anyway."""
    stuck = Stuck(0.8, 0.4, 0.2)
    stuck.begin((0.0, 0.0, 0.0))
    stuck.note((-0.39, 0.0, 0.0), PERIOD)
    assert stuck.backs_up
    stuck.note((-0.41, 0.0, 0.0), PERIOD)
    assert not stuck.backs_up
    stuck.begin((0.0, 0.0, 0.0))
    stuck.note((0.0, 0.0, 0.0), 3.1)
    assert not stuck.backs_up


def test_a_turn_that_the_gate_holds_is_barred_for_a_second():
    held = Held()
    for _ in range(7):
        held.note(0.0, (0.1, 2.0), PERIOD)
    assert not held.allows((0.0, 1.0))
    assert held.allows((0.5, -1.0))
    assert held.allows((-0.2, 0.0))
    held.note(1.0, (0.1, -2.0), 1.1)
    assert held.allows((0.0, 1.0))


def test_backing_up_that_the_gate_holds_is_barred():
    held = Held()
    for _ in range(7):
        held.note(0.0, (-0.2, 0.0), PERIOD)
    assert not held.allows((-0.2, 0.0))
    assert held.allows((0.1, 1.0))


def test_the_speed_to_stop_and_to_turn_by_hand():
    """v = sqrt(2 b d); with 1 s of reaction v + v²/4 = 1.25 m gives 1 m/s. A circle of radius d / 2 turns 90 deg."""
    assert stopping_speed(1.0, 2.0, 0.0) == pytest.approx(2.0)
    assert stopping_speed(1.25, 2.0, 1.0) == pytest.approx(1.0)
    assert turning_speed(1.0, 0.5 * math.pi, 2.0) == pytest.approx(1.0)
    assert turning_speed(1.0, math.radians(30.0), 2.0) == pytest.approx(2.0)
    assert turning_speed(1.0, math.pi, 2.0) == pytest.approx(0.0)


def test_a_target_beside_it_is_turned_to_and_not_circled():
    """0.5 m beside it at 25 deg/s: 0.5 * 0.44 * 0.5 = 0.11 m/s."""
    answer = make(VfhSwept).avoid(given(sonars([math.inf] * 8), target=(0.0, 0.5), twist=(0.11, 0.0)))
    assert answer.twist.wz == pytest.approx(LIMIT)
    assert answer.twist.vx <= 0.12


def test_it_slows_down_for_the_goal_but_not_for_a_target_on_the_way():
    far, near = ({"target": (0.1, 0.0), "remaining": left, "twist": (0.5, 0.0)} for left in (1.0, 0.0))
    free = laser(np.full(101, math.inf))
    assert make(VfhSwept).avoid(given(free, **far)).twist.vx == pytest.approx(0.5)
    assert make(VfhSwept).avoid(given(free, **near)).twist.vx < 0.45


def test_echo_points_are_where_the_laser_sees_them_and_sonars_stay_cells():
    avoider = make(VfhSwept)
    scan = laser(np.where(np.arange(101) == 50, 1.234, math.inf))
    answer = avoider.avoid(given(scan, sonars([math.inf] * 3 + [1.0] * 5)))
    d = answer.diagnostics
    assert d.window[math.floor(-d.window_y / 0.1), math.floor((1.234 - d.window_x) / 0.1)] == 15
    np.testing.assert_allclose(avoider._method.memory.points[:, :2], [[1.234, 0.0]], atol=1e-12)
    assert avoider._method.has_cells


def test_with_lasers_alone_a_gap_of_its_own_width_and_9_cm_is_open():
    """Half of 0.8 m and point_distance, 0.02 m; cells need safety_distance, 0.1 m."""
    bearings = np.linspace(-1.5, 1.5, 101)
    door_posts = np.where(
        np.abs(bearings) > math.atan2(0.45, 0.6), 0.6 / np.cos(np.clip(bearings, -1.3, 1.3)), math.inf
    )
    answer = make(VfhSwept).avoid(given(laser(door_posts)))
    assert abs(answer.diagnostics.chosen) < math.radians(5.0)
    coarse = make(VfhSwept, echoes="cells")
    answers = [coarse.avoid(given(laser(door_posts))) for _ in range(5)]  # a cell counts from several scans on
    assert abs(answers[-1].diagnostics.chosen) > math.radians(60.0)


def test_no_tick_compiles_after_warm_up():
    VfhSwept.warm_up()
    kernels = (survey.openings, free_run.choose_command, free_run.near_points, free_run.stops_free, remember,
               points_in_base)  # fmt: skip
    before = [len(kernel.signatures) for kernel in kernels]
    avoider = make(VfhSwept)
    avoider.avoid(given(laser(np.full(101, 1.0))))
    avoider.avoid(given(sonars([0.5] * 8), laser(np.full(101, 1.0)), twist=(0.3, 0.1)))
    avoider.avoid(given())
    assert [len(kernel.signatures) for kernel in kernels] == before
    assert min(before) >= 1


@BOTH_KINDS
def test_a_field_is_crossed(sensors):
    assert field(1, sensors=sensors, avoider="vfh_swept").word == "reached"


def test_a_door_of_1_1_m_is_passed_with_a_laser():
    """VFH* needs 1.2 m."""
    assert way_past(door(1.1, 0, sensors=LASER, avoider="vfh_swept")) == "through"

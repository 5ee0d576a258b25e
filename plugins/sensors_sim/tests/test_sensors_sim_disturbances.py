"""Displacements of the robot, slips of its wheels, and glass."""

from __future__ import annotations

import math

import numpy as np
import pytest
from navloom import Box, Cylinder, Disturbance, InputError, Place

SECOND = 1_000_000_000
EXACT = {"slip": 0.0}
LASER = ("laser", "laser_2d", {"noise": False, "beams": 3, "field_of_view_deg": 90.0})
SONARS = ("sonars", "sonar_ring", {"noise": False, "layout": "pairs"})


def pose(out):
    return out.truth.pose.x, out.truth.pose.y, out.truth.pose.heading


def odometry(out):
    return out.odometry.pose.x, out.odometry.pose.y, out.odometry.pose.heading


def test_a_displacement_to_a_place_is_exact_and_the_wheels_do_not_feel_it(bench):
    robot = bench(disturbances=(Disturbance("displace", SECOND, to=(3.0, -2.0, 1.5)),))
    assert pose(robot.step(count=19)) == (0.0, 0.0, 0.0)
    out = robot.step()
    assert pose(out) == (3.0, -2.0, 1.5)
    assert odometry(out) == (0.0, 0.0, 0.0)


def test_a_displacement_between_two_ticks_is_in_the_later_one(bench):
    robot = bench(disturbances=(Disturbance("displace", 1_010_000_000, to=(3.0, 0.0, 0.0)),))
    assert pose(robot.step(count=20))[0] == 0.0
    assert pose(robot.step())[0] == 3.0


def test_a_displacement_in_the_first_tick(bench):
    robot = bench(disturbances=(Disturbance("displace", 0, to=(3.0, 0.0, 0.0)),))
    assert pose(robot.first)[0] == 3.0


def test_a_motion_is_in_the_frame_of_the_robot(bench):
    half = 0.5 * math.pi
    robot = bench(start=Place(1.0, 1.0, half), disturbances=(Disturbance("displace", SECOND, by=(2.0, 0.5, half)),))
    x, y, heading = pose(robot.step(count=20))
    assert (x, y) == pytest.approx((0.5, 3.0))
    assert abs(heading) == pytest.approx(math.pi)


def test_a_displacement_over_a_time_moves_evenly(bench):
    robot = bench(disturbances=(Disturbance("displace", SECOND, 2 * SECOND, to=(4.0, 0.0, 0.0)),))
    assert pose(robot.step(count=20))[0] == 0.0
    assert pose(robot.step(count=10))[0] == pytest.approx(1.0)
    assert pose(robot.step(count=30))[0] == 4.0


def test_the_robot_drives_on_from_where_it_was_put(bench):
    robot = bench(disturbances=(Disturbance("displace", SECOND, to=(0.0, 5.0, 0.0)),))
    robot.step(count=20)
    out = robot.step(0.2, count=20)
    assert (out.truth.pose.x, out.truth.pose.y) == pytest.approx((0.2, 5.0))


def test_in_the_hand_the_robot_touches_nothing(bench):
    wall = Box("wall", (1.5, 1.7), (-5.0, 5.0))
    robot = bench(obstacles=(wall,), disturbances=(Disturbance("displace", SECOND, SECOND, to=(4.0, 0.0, 0.0)),))
    outs = [robot.step(0.4) for _ in range(40)]
    assert not any(out.contact.touching or out.truth.touching for out in outs)
    assert {out.truth.clearance for out in outs[21:38]} == {math.inf}
    assert outs[-1].truth.clearance == pytest.approx(1.9)


@pytest.mark.parametrize("duration", [0, SECOND])
def test_a_place_in_an_obstacle_is_refused_when_it_is_reached(bench, duration):
    post = Cylinder("post", 4.0, 0.0, 0.2)
    robot = bench(obstacles=(post,), disturbances=(Disturbance("displace", SECOND, duration, to=(4.0, 0.5, 0.0)),))
    robot.step(count=19)
    with pytest.raises(InputError, match=r"displace at 1 s: at \(4.00, 0.50\), 0°, the robot touches post"):
        robot.step(count=21)


def test_while_the_wheels_spin_the_robot_does_not_move(bench):
    robot = bench(EXACT, disturbances=(Disturbance("slip", SECOND, 2 * SECOND),))
    robot.step(0.2, count=19)
    before = robot.step(0.2)
    out = robot.step(0.2, count=39)
    assert pose(out) == pose(before)
    assert out.odometry.pose.x == pytest.approx(before.odometry.pose.x + 0.39)
    assert (out.truth.twist.vx, out.odometry.twist.vx) == (0.0, pytest.approx(0.2))
    assert robot.step(0.2, count=21).truth.pose.x == pytest.approx(before.truth.pose.x + 0.2)


def test_wheels_that_spin_meet_no_wall(bench):
    wall = Box("wall", (0.45, 0.6), (-5.0, 5.0))
    robot = bench(EXACT, obstacles=(wall,), disturbances=(Disturbance("slip", 0, 3 * SECOND),))
    out = robot.step(0.2, count=40)
    assert not out.contact.touching
    assert out.odometry.pose.x == pytest.approx(0.4)


def test_a_step_of_the_odometry_is_not_felt_by_the_robot(bench):
    robot = bench(EXACT, disturbances=(Disturbance("slip", SECOND, by=(0.0, 0.0, 0.4)),))
    out = robot.step(0.2, count=40)
    assert pose(out) == pytest.approx((0.4, 0.0, 0.0))
    assert out.odometry.pose.heading == pytest.approx(0.4)
    assert out.odometry.pose.x == pytest.approx(0.2 + 0.2 * math.cos(0.4), abs=0.005)


def test_a_reported_motion_over_a_time_has_a_velocity(bench):
    robot = bench(disturbances=(Disturbance("slip", SECOND, SECOND, by=(0.5, 0.0, 0.0)),))
    out = robot.step(count=30)
    assert out.odometry.twist.vx == pytest.approx(0.5)
    assert robot.step(count=20).odometry.pose.x == pytest.approx(0.5)


def test_disturbances_do_not_change_what_is_drawn(bench):
    """A displacement aside changes no random number: the odometry of both robots is the same."""
    move = (Disturbance("displace", SECOND, SECOND, to=(0.0, 50.0, 0.0)),)
    one, other = (bench({"slip": 0.05}, disturbances=given).step(0.3, 0.1, count=60) for given in ((), move))
    assert odometry(one) == odometry(other)


def test_times_count_from_the_first_tick(bench):
    robot = bench(disturbances=(Disturbance("displace", SECOND, to=(3.0, 0.0, 0.0)),))
    robot.platform.reset()
    robot.ticks = 99  # a live robot whose run clock is at 5 s in its first tick
    assert pose(robot.step(count=20))[0] == 0.0
    assert pose(robot.step())[0] == 3.0


def test_a_laser_sees_what_is_behind_glass_and_a_sonar_the_glass(bench):
    glass = Box("glass", (2.0, 2.1), (-5.0, 5.0), material="glass")
    robot = bench(sensors=(LASER, SONARS), obstacles=(glass, Box("wall", (4.0, 4.2), (-9.0, 9.0))))
    scans = robot.first.scans
    assert scans["laser"].ranges[1] == pytest.approx(4.0 - scans["laser"].origins[1, 0])
    ahead = np.argmin(np.abs(scans["sonars"].bearings))
    assert scans["sonars"].ranges[ahead] == pytest.approx(2.0 - scans["sonars"].origins[ahead, 0], abs=0.01)


def test_glass_is_solid(bench):
    glass = Cylinder("glass", 1.0, 0.0, 0.3, material="glass")
    out = bench(obstacles=(glass,)).step(0.4, count=40)
    assert out.contact.touching
    assert out.truth.nearest == "glass"


def test_glass_that_appears_stays_invisible(bench):
    glass = Box("glass", (2.0, 2.1), (-5.0, 5.0), appears_at=0.5, material="glass")
    late = Box("wall", (4.0, 4.2), (-9.0, 9.0), appears_at=0.5)
    robot = bench(sensors=(LASER,), obstacles=(glass, late))
    assert robot.first.scans["laser"].ranges[1] == math.inf
    assert robot.step(count=10).scans["laser"].ranges[1] > 3.0

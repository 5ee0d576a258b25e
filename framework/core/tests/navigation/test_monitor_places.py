"""Where and for how long the monitor keeps what its sensors saw: stamps, frames, motion and restarts."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
import pytest
from navloom.messages import Odometry, Pose2D, PoseEstimate, RangeScan, Twist2D
from navloom.navigation.collision_monitor import CollisionMonitor, MonitorLimits
from navloom.testing import robot

FOOTPRINT = np.array([(0.35, 0.2), (-0.25, 0.2), (-0.25, -0.2), (0.35, -0.2)])
LIMITS = MonitorLimits(robot(footprint=FOOTPRINT, max_deceleration=0.8), 0.05, 0.04)
RISING = math.atan2(0.6, 0.8)
"""A direction of cosine 0.8 and sine 0.6."""
LASER = (0.25, -0.1)
"""Place of the sensor in the base frame, m."""
Place = tuple[float, float] | None


def monitor(*odometry: tuple[float, float, float, float], twist: tuple[float, float] = (0.0, 0.0)) -> CollisionMonitor:
    """A monitor that received odometry of (time, x, y, heading), and does not mind unseen space."""
    made = CollisionMonitor(LIMITS)
    made.ignores_unseen = True
    move(made, *odometry, twist=twist)
    return made


def move(
    made: CollisionMonitor, *odometry: tuple[float, float, float, float], twist: tuple[float, float] = (0.0, 0.0)
) -> None:
    for time, x, y, heading in odometry:
        wrapped = math.remainder(heading, math.tau)
        made.move(Odometry(round(time * 1e9), Pose2D(x, y, wrapped), Twist2D(twist[0], 0.0, twist[1])))


def scan(
    time: float,
    bearings: list[float],
    ranges: list[float],
    offsets: list[float] | None = None,
    half: float = 0.0,
    origin: tuple[float, float] = LASER,
) -> RangeScan:
    n = len(ranges)
    return RangeScan(
        round(time * 1e9), np.tile(np.array([origin]), (n, 1)), np.array(bearings, dtype=float), np.full(n, half),
        np.array(offsets or [0.0] * n), np.array(ranges), 0.05, 4.0,
    )  # fmt: skip


def twice(time: float, bearing: float, distance: float, offset: float = 0.0) -> RangeScan:
    """A laser of two beams that agree."""
    return scan(time, [bearing, bearing], [distance, distance], [offset, offset])


def hit(made: CollisionMonitor, v: float = 1.0, w: float = 0.0) -> Place:
    """Place of what a command would touch, m, base frame."""
    place = made.judge(Twist2D(v, 0.0, w), 0.0, made._track.stamps[-1]).place
    return None if place is None else (place.x, place.y)


# --- frames and stamps ------------------------------------------------------------------------------------------------


def test_an_echo_is_where_its_beam_ended_from_the_sensors_own_place() -> None:
    """From (0.25, -0.1) along (0.8, 0.6): 0.5 m farther it is at (0.65, 0.2), on the left edge of the way."""
    made = monitor((2.0, 1.3, -0.7, 1.9))
    assert made.look("laser", twice(2.0, RISING, 0.5))
    assert hit(made) == pytest.approx((0.65, 0.2))


def test_an_echo_stays_in_its_place_when_the_robot_moves_and_turns() -> None:
    """At (1.0, 2.0), heading 0, it is at (1.95, 2.0). Seen from (1.15, 1.4), turned to (0.8, 0.6): (1.0, 0.0)."""
    made = monitor((0.0, 1.0, 2.0, 0.0))
    made.look("laser", scan(0.0, [0.0, 0.0], [0.7, 0.7], origin=(0.25, 0.0)))
    assert hit(made) == pytest.approx((0.95, 0.0))
    move(made, (0.2, 1.15, 1.4, RISING))
    assert hit(made) == pytest.approx((0.8 * 0.8 + 0.6 * 0.6, 0.8 * 0.6 - 0.6 * 0.8), abs=1e-9)


@pytest.mark.parametrize(
    ("time", "offset", "share"),
    [(1.02, 0.0, 0.2), (1.02, 0.05, 0.7), (1.08, -0.05, 0.3), (1.0, 0.0, 0.0), (1.1, 0.0, 1.0)],
)
def test_a_scan_between_two_odometry_stamps_is_placed_in_between(time: float, offset: float, share: float) -> None:
    """The robot drives from (1.0, 2.0) to (1.2, 2.1) and turns from 3.1 rad by 0.1 rad, across 180 degrees."""
    made = monitor((0.9, 0.9, 2.0, 3.0), (1.0, 1.0, 2.0, 3.1), (1.1, 1.2, 2.1, 3.2))
    assert made.look("laser", twice(time, 0.1, 0.6, offset))
    x, y = 0.25 + 0.6 * math.cos(0.1), -0.1 + 0.6 * math.sin(0.1)
    then = 3.1 + 0.1 * share
    east = 0.2 * (share - 1.0) + x * math.cos(then) - y * math.sin(then)
    north = 0.1 * (share - 1.0) + x * math.sin(then) + y * math.cos(then)
    cos, sin = math.cos(3.2), math.sin(3.2)
    assert hit(made, 1.1) == pytest.approx((cos * east + sin * north, cos * north - sin * east), abs=1e-9)


def test_each_beam_has_its_own_time() -> None:
    """In 0.1 s the robot drives 0.2 m: what is 0.9 m ahead at the beginning is at 0.7 m at the end, and the echo at
    0.6 m behind, measured half-way, at 0.7 m."""
    made = monitor((0.0, 0.0, 0.0, 0.0), (0.1, 0.2, 0.0, 0.0))
    bearings, offsets = [0.0, 0.0, math.pi, math.pi], [0.0, 0.0, 0.05, 0.05]
    made.look("laser", scan(0.0, bearings, [0.9, 0.9, 0.6, 0.6], offsets, origin=(0.0, 0.0)))
    assert hit(made) == pytest.approx((0.7, 0.0), abs=1e-9)
    assert hit(made, -1.0) == pytest.approx((-0.7, 0.0), abs=1e-9)


def test_beams_after_the_newest_odometry_are_placed_by_its_twist() -> None:
    """0.05 s at 0.6 m/s and 0.4 rad/s from a heading of (0.8, 0.6): 3 cm farther, and 0.02 rad."""
    made = monitor((0.0, 1.0, 2.0, RISING - 0.1), (0.1, 1.3, 2.1, RISING), twist=(0.6, 0.4))
    assert made.look("laser", twice(0.1, 0.1, 0.7, 0.05))
    x, y = 0.25 + 0.7 * math.cos(0.1), -0.1 + 0.7 * math.sin(0.1)
    turned = math.cos(0.02) * x - math.sin(0.02) * y, math.sin(0.02) * x + math.cos(0.02) * y
    assert hit(made) == pytest.approx((0.03 + turned[0], turned[1]), abs=1e-9)


def test_a_scan_of_a_newer_time_waits_for_the_odometry() -> None:
    made = monitor((0.0, 0.0, 0.0, 0.0))
    assert not made.look("laser", twice(0.07, 0.0, 0.6))
    assert hit(made) is None
    move(made, (0.05, 0.1, 0.0, 0.0))
    assert hit(made) is None
    move(made, (0.1, 0.2, 0.0, 0.0))
    # Taken at 0.14 m, where the echo was 0.85 m ahead: 0.79 m now.
    assert hit(made) == pytest.approx((0.79, -0.1), abs=1e-9)


def test_a_scan_before_any_odometry_waits_too() -> None:
    made = monitor()
    assert not made.look("laser", twice(0.0, 0.0, 0.6))
    move(made, (0.0, 0.0, 0.0, 0.0))
    assert hit(made) == pytest.approx((0.85, -0.1))


def test_every_scan_that_waits_is_taken_once() -> None:
    made = monitor((0.0, 0.0, 0.0, 0.0))
    made.look("left", twice(0.02, 0.0, 0.6))
    made.look("right", scan(0.02, [math.pi] * 2, [0.6] * 2))
    move(made, (0.1, 0.0, 0.0, 0.0))
    assert hit(made) == pytest.approx((0.85, -0.1))
    assert hit(made, -1.0) == pytest.approx((-0.35, -0.1))
    assert made._waiting == []


def test_an_old_scan_is_refused() -> None:
    made = monitor((0.0, 0.0, 0.0, 0.0), (0.1, 0.0, 0.0, 0.0))
    assert made.look("laser", twice(0.05, 0.0, 3.0))
    assert not made.look("laser", twice(0.05, 0.0, 0.6))
    assert not made.look("laser", twice(0.04, 0.0, 0.6))
    assert hit(made) is None
    assert made.look("other", twice(0.04, 0.0, 0.6)), "another sensor has its own stamps"


def test_odometry_that_does_not_advance_is_passed_over() -> None:
    made = monitor((0.0, 0.0, 0.0, 0.0), (0.1, 0.2, 0.0, 0.0))
    made.look("laser", twice(0.1, 0.0, 0.6))
    move(made, (0.1, 0.3, 0.0, 0.0), (0.05, 0.4, 0.0, 0.0))
    assert hit(made) == pytest.approx((0.85, -0.1))


def test_old_odometry_is_forgotten_and_the_last_256_kept() -> None:
    made = monitor(*((k * 0.01, k * 0.001, 0.0, 0.0) for k in range(513)))
    assert [len(kept) for kept in (made._track.stamps, made._track.poses, made._track.ways)] == [257] * 3
    assert made.look("laser", twice(2.57, 0.0, 0.8))
    assert hit(made) == pytest.approx((1.05 - 0.255, -0.1), abs=1e-9)


def test_the_way_is_the_length_of_the_steps() -> None:
    made = monitor((0.0, 0.0, 0.0, 0.0), (0.1, 0.3, 0.4, 0.0), (0.2, 0.0, 0.0, 1.0))
    assert made._track.ways == pytest.approx([0.0, 0.5, 1.0])


def test_before_the_first_scan_there_is_no_obstacle() -> None:
    made = monitor((0.0, 0.0, 0.0, 0.0))
    assert made._near(Twist2D(0.5, 0.0, 0.0), 0.0).shape == (0, 3)
    made.look("laser", scan(0.0, [0.0], [math.inf]))
    assert made._sensors["laser"].obstacles.shape == (0, 3)


# --- how long echoes count --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("last", "counts"), [(0.5, True), (0.51, False)])
def test_an_echo_counts_for_half_a_second(last: float, counts: bool) -> None:
    made = monitor((0.0, 0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
    for time, distance in ((0.0, 0.6), (0.3, math.inf), (0.4, math.inf), (last, math.inf)):
        made.look("laser", twice(time, 0.0, distance))
    assert (hit(made) is not None) is counts


@pytest.mark.parametrize("more", [0, 1])
def test_the_last_two_scans_count_however_old(more: int) -> None:
    made = monitor(*((0.5 * k, 0.0, 0.0, 0.0) for k in range(9)))
    for time, distance in ((0.0, 0.6), (2.0, math.inf), (4.0, math.inf))[: 2 + more]:
        made.look("laser", twice(time, 0.0, distance))
    assert (hit(made) is not None) is (more == 0)


@pytest.mark.parametrize(("distance", "counts"), [(1.499, True), (1.51, False)])
def test_an_echo_where_no_beam_points_any_more_counts_within_1_5_m(distance: float, counts: bool) -> None:
    """The laser turns away with the robot, which turns back only after the scan has been forgotten."""
    made = monitor((0.0, 0.0, 0.0, 0.0))
    made.look("laser", scan(0.0, [0.0, 0.0], [distance] * 2, origin=(0.0, 0.0)))
    for k in range(1, 8):
        move(made, (0.2 * k, 0.0, 0.0, 1.0))
        made.look("laser", scan(0.2 * k, [0.0, 0.0], [math.inf] * 2, origin=(0.0, 0.0)))
    move(made, (1.6, 0.0, 0.0, 0.0))
    assert (hit(made, 2.0) is not None) is counts


def test_an_echo_is_kept_until_a_beam_points_there_again() -> None:
    """The nearest in its direction; a beam that sees nothing there ends it."""
    made = monitor((0.0, 0.0, 0.0, 0.0))
    made.look("laser", scan(0.0, [0.0, 0.0], [0.9] * 2, origin=(0.0, 0.0)))
    for k in range(1, 8):
        move(made, (0.2 * k, 0.0, 0.0, -1.0))
        made.look("laser", scan(0.2 * k, [0.0, 0.0], [math.inf] * 2, origin=(0.0, 0.0)))
    move(made, (1.6, 0.0, 0.0, 0.0))
    assert hit(made) == pytest.approx((0.9, 0.0))
    made.look("laser", scan(1.6, [0.0, 0.0], [math.inf] * 2, origin=(0.0, 0.0)))
    assert hit(made) is None


# --- sonars -----------------------------------------------------------------------------------------------------------


def ring(time: float, distance: float, other: float = math.inf) -> RangeScan:
    """A sonar that looks ahead and one that looks back, with cones of no more than a point."""
    return scan(time, [0.0, math.pi], [distance, other], half=0.001, origin=(0.0, 0.0))


@pytest.mark.parametrize(
    ("second", "counts"), [(0.9, True), (0.785, True), (0.775, False), (1.015, True), (1.025, False)]
)
def test_a_sonars_echo_counts_if_the_next_reading_agrees(second: float, counts: bool) -> None:
    """Within three standard deviations of 4 cm."""
    made = monitor((0.0, 0.0, 0.0, 0.0), (0.1, 0.0, 0.0, 0.0))
    made.look("ring", ring(0.0, 0.9))
    assert hit(made) is None
    made.look("ring", ring(0.1, second))
    assert (hit(made) is not None) is counts


@pytest.mark.parametrize(
    ("x", "y", "heading", "second", "counts"),
    [
        (0.3, 0.4, 3.3, 0.285, True),  # 0.5 m of way: up to 0.62 m less
        (0.3, 0.4, 3.3, 0.275, False),
        (0.0, 0.0, 3.5, 0.7, True),  # 0.2 rad of 0.4031 m: up to 0.2006 m
        (0.0, 0.0, 3.5, 0.69, False),
        (0.0, 0.0, 3.1, 0.7, True),
        (0.3, 0.4, 3.1, 0.21, True),
        (0.3, 0.4, 3.1, 0.19, False),
    ],
)
def test_a_sonars_readings_may_differ_by_the_motion_since(
    x: float, y: float, heading: float, second: float, counts: bool
) -> None:
    """The first at the origin, heading 3.3 rad; the farthest corner of the footprint is 0.4031 m from the base."""
    made = monitor((0.0, 0.0, 0.0, 3.3), (0.2, x, y, heading))
    made.look("ring", ring(0.0, 0.9))
    made.look("ring", ring(0.2, second))
    assert (len(made._sensors["ring"].obstacles) > 0) is counts


def test_a_ring_of_another_number_of_sonars_begins_again() -> None:
    made = monitor((0.0, 0.0, 0.0, 0.0), (0.2, 0.0, 0.0, 0.0))
    made.look("ring", ring(0.0, 0.9))
    made.look("ring", scan(0.1, [0.0], [0.9], half=0.001, origin=(0.0, 0.0)))
    assert hit(made) is None
    made.look("ring", scan(0.2, [0.0], [0.9], half=0.001, origin=(0.0, 0.0)))
    assert hit(made) == pytest.approx((0.9, 0.0), abs=1e-3)


def test_a_sonar_that_hears_nothing_more_counts_for_half_a_second() -> None:
    made = monitor((0.0, 0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
    for k in range(8):
        made.look("ring", ring(0.09 * k, 0.9 if k < 2 else math.inf))
        assert (hit(made) is not None) is (1 <= k <= 6), k


@pytest.mark.parametrize("silent", [0, 2])
def test_all_points_of_an_arc_fit(silent: int) -> None:
    """An arc of 2 rad at 2.4 m, 4.8 m long, of a single sonar or of a ring of three: 97 steps and one more point."""
    made = monitor((0.0, 0.0, 0.0, 0.0), (0.1, 0.0, 0.0, 0.0))
    for time in (0.0, 0.1):
        bearings, ranges = [0.0] + [math.pi] * silent, [2.4] + [math.inf] * silent
        made.look("ring", scan(time, bearings, ranges, half=1.0, origin=(0.0, 0.0)))
    assert len(made._sensors["ring"].obstacles) == 98
    last = made._sensors["ring"].obstacles[-1]
    assert last == pytest.approx((2.4 * math.cos(1.0), 2.4 * math.sin(1.0), 0.0))


# --- restarts of the platform -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("time", "x", "y", "heading", "restarted"),
    [
        (2.2, 0.78, 1.04, 0.7, False),  # 1.3 m in 0.2 s: 0.3 m + 5 m/s
        (2.2, 0.79, 1.04, 0.7, True),
        (2.2, -0.79, -1.04, 0.7, True),
        (2.01, 0.0, 0.0, 1.299, False),  # 0.599 rad in 0.01 s: 0.5 rad + 10 rad/s
        (2.01, 0.0, 0.0, 1.301, True),
        (2.01, 0.0, 0.0, 0.099, True),
        (2.01, 0.0, 0.0, 0.101, False),
        (3.0, 0.0, 0.0, 0.7, False),  # 1 s of silence
        (3.01, 0.0, 0.0, 0.7, True),
        (1.9, 9.0, 0.0, 0.7, False),  # odometry of before is passed over
        (1.0, 0.0, 0.0, 0.7, False),  # 1 s back
        (0.99, 0.0, 0.0, 0.7, True),
    ],
)
def test_odometry_that_jumps_is_silent_or_goes_back_shows_a_restart(
    time: float, x: float, y: float, heading: float, restarted: bool
) -> None:
    made = monitor((2.0, 0.0, 0.0, 0.7))
    made.look("laser", twice(2.0, 0.0, 0.6))
    made.give(2.0, Twist2D(0.3, 0.0, 0.0))
    move(made, (time, x, y, heading))
    assert ("laser" not in made._sensors) is restarted
    assert (len(made._given) == 0) is restarted


@pytest.mark.parametrize(("x", "heading"), [(0.6125, 0.0), (0.0, 1.125)])
def test_the_farthest_that_a_robot_may_go_is_no_restart(x: float, heading: float) -> None:
    """In 1/16 s 0.3 m + 0.3125 m, or 0.5 rad + 0.625 rad, without rounding."""
    made = monitor((1.0, 0.0, 0.0, 0.0), (1.0625, x, 0.0, heading))
    assert len(made._track.stamps) == 2


def test_the_heading_may_pass_180_degrees() -> None:
    made = monitor((1.0, 0.0, 0.0, 3.1), (1.01, 0.0, 0.0, -3.1), (1.02, 0.0, 0.0, 3.1))
    assert len(made._track.stamps) == 3
    assert [heading for _, _, heading in made._track.poses] == pytest.approx([3.1, math.tau - 3.1, 3.1])


def test_a_slow_robot_may_be_silent_for_five_periods() -> None:
    for time, restarted in ((2.4, False), (2.6, True)):
        made = CollisionMonitor(MonitorLimits(robot(footprint=FOOTPRINT, max_deceleration=0.8), 0.3, 0.03))
        move(made, (1.0, 0.0, 0.0, 0.0), (time, 0.0, 0.0, 0.0))
        assert (len(made._track.stamps) == 1) is restarted


def test_a_restart_forgets_the_way_and_the_speed() -> None:
    made = monitor((1.0, 0.0, 0.0, 0.0), (1.1, 0.4, 0.0, 0.0), twist=(0.5, 0.2))
    move(made, (5.0, 0.0, 0.0, 0.0))
    assert made._track.ways == [0.0] and made._track.stamps == [5.0] and made._waiting == []


def pose_estimate(time: float, x: float, state: Literal["tracking", "searching"] = "tracking") -> PoseEstimate:
    stamp_ns = round(time * 1e9)
    return PoseEstimate(stamp_ns, Pose2D(x, 0.0, 0.0), Twist2D(0.0, 0.0, 0.0), np.eye(3), state)


@pytest.mark.parametrize(("found_at", "is_held"), [(0.4, True), (0.6, False)])
def test_a_robot_that_tracks_again_elsewhere_remembers_nothing_out_of_view(found_at: float, is_held: bool) -> None:
    """An echo ahead, then a turn by half a turn: it is 0.75 m behind, and no beam looks there."""
    made = monitor((0.0, 0.0, 0.0, 0.0))
    made.look("laser", twice(0.0, 0.0, 0.5))
    move(made, (0.2, 0.0, 0.0, 1.5), (0.4, 0.0, 0.0, math.pi))
    made.look("laser", twice(0.4, 0.0, 3.0))
    made.locate(pose_estimate(0.4, 0.0), None)
    made.locate(pose_estimate(0.4, 0.0, "searching"), None)
    assert hit(made, v=-1.0) is not None
    made.locate(pose_estimate(0.4, found_at), None)
    assert (hit(made, v=-1.0) is not None) == is_held

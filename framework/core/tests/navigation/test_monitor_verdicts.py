"""Verdicts of the monitor: which share of a command it lets pass, and how a robot brakes that may not drive it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from limits import with_robot
from navloom.messages import Odometry, Pose2D, RangeScan, Twist2D
from navloom.navigation.collision_monitor import CollisionMonitor, MonitorLimits, Verdict
from navloom.testing import robot

FOOTPRINT = np.array([(0.35, 0.2), (-0.25, 0.2), (-0.25, -0.2), (0.35, -0.2)])
LIMITS = MonitorLimits(robot(footprint=FOOTPRINT, max_deceleration=0.8), 0.05, 1e-6, 0.01)
FRONT, REAR = 0.39, -0.29
"""Place of front and rear and the margin at 0.3 m/s or more, m: 4 cm."""


def scan(time: float, *places: tuple[float, float]) -> RangeScan:
    """A laser at the base's origin: two beams that agree for each place, and a field of view of 1 rad about each."""
    bearings = np.repeat([math.atan2(y, x) for x, y in places], 2)
    ranges = np.repeat([math.hypot(x, y) for x, y in places], 2)
    nothing = np.zeros(len(ranges))
    return RangeScan(round(time * 1e9), np.zeros((len(ranges), 2)), bearings, nothing, nothing, ranges, 0.05, 9.0)


def monitor(
    *places: tuple[float, float],
    limits: MonitorLimits = LIMITS,
    twist: tuple[float, float] = (0.0, 0.0),
    time: float = 1.0,
) -> CollisionMonitor:
    """A monitor of a robot that stands at (3.0, -1.0), heading 2.5 rad, and sees places of the base frame."""
    made = CollisionMonitor(limits)
    made.ignores_unseen = True
    made.move(Odometry(round(time * 1e9), Pose2D(3.0, -1.0, 2.5), Twist2D(twist[0], 0.0, twist[1])))
    if places:
        made.look("laser", scan(time, *places))
    return made


def judge(made: CollisionMonitor, v: float, w: float = 0.0, speed: float = 0.0, time: float = 1.0) -> Verdict:
    return made.judge(Twist2D(v, 0.0, w), speed, time)


def test_a_free_command_passes_unchanged() -> None:
    verdict = judge(monitor((0.0, 0.9)), 0.7, 0.2)
    assert verdict == Verdict(Twist2D(0.7, 0.0, 0.2), 1.0, "", None, None)
    assert not verdict.is_stopped


def test_without_odometry_every_command_passes() -> None:
    made = CollisionMonitor(LIMITS)
    assert judge(made, 0.7) == Verdict(Twist2D(0.7, 0.0, 0.0))


def stopping(v: float, deceleration: float = 0.8, period: float = 0.05) -> float:
    """Way of a command for a period and of braking, m."""
    speeds = [v - deceleration * period * k for k in range(1000)]
    return period * sum(speed for speed in speeds if speed > 0.0)


@pytest.mark.parametrize(("v", "back"), [(0.7, False), (-0.7, True)])
@pytest.mark.parametrize("deceleration", [0.8, 0.31, 2.3])
def test_a_command_is_free_where_its_stopping_way_ends_before_the_obstacle(
    v: float, back: bool, deceleration: float
) -> None:
    limits = with_robot(LIMITS, max_deceleration=deceleration)
    way = stopping(0.7, deceleration)
    for more, share in ((0.001, 1.0), (-0.001, 31 / 32)):
        x = REAR - way - more if back else FRONT + way + more
        assert judge(monitor((x, 0.1), limits=limits), v).share == pytest.approx(share)


def test_the_share_is_the_largest_32nd_that_is_free() -> None:
    """Of 0.7 m/s before an obstacle 0.2 m ahead."""
    made = monitor((FRONT + 0.2, 0.1))
    free = max(k for k in range(33) if stopping(0.7 * k / 32) <= 0.2)
    verdict = judge(made, 0.7, 0.01)
    assert 20 < free < 30 and verdict.share == free / 32
    assert verdict.twist.vx == pytest.approx(0.7 * free / 32) and verdict.twist.wz == pytest.approx(0.01 * free / 32)
    assert verdict.kind == "obstacle" and not verdict.is_stopped
    assert verdict.place is not None and (verdict.place.x, verdict.place.y) == pytest.approx((FRONT + 0.2, 0.1))
    assert verdict.distance == pytest.approx(0.24)


def test_an_obstacle_within_the_footprint_has_no_distance() -> None:
    assert judge(monitor((0.3, 0.1)), 0.7).distance == 0.0


def test_speed_falls_by_no_more_than_the_deceleration() -> None:
    """From 0.7 m/s no less than 0.66 m/s; of a command of 0.7 m/s a share between 0.66/0.7 and 1 in 32 parts."""
    lowest = 0.66 / 0.7
    verdict = judge(monitor((FRONT + stopping(0.6801), 0.1)), 0.7, speed=0.7)
    assert verdict.share == pytest.approx(lowest + (1.0 - lowest) * 16 / 32)


def test_a_command_below_that_is_not_raised() -> None:
    """A command of 0.6 m/s at 0.7 m/s: it brakes harder than the deceleration already; all of it or braking."""
    made = monitor((FRONT + stopping(0.6) + 0.001, 0.1))
    assert judge(made, 0.6, speed=0.7).share == 1.0
    made = monitor((FRONT + stopping(0.6) - 0.001, 0.1))
    assert judge(made, 0.6, speed=0.7).twist.vx == 0.0


def test_a_command_in_the_other_direction_may_fall_to_nothing() -> None:
    made = monitor((-0.2601, 0.1))
    verdict = judge(made, -0.7, speed=0.02)
    assert verdict.twist.vx == 0.0 and verdict.is_stopped


@pytest.mark.parametrize(("place", "v", "w", "speed"), [((-0.36, 0.1), -0.7, 0.0, 0.5), ((0.3, 0.26), 0.0, 3.0, 0.5)])
def test_reversing_and_turning_may_fall_to_any_share(
    place: tuple[float, float], v: float, w: float, speed: float
) -> None:
    verdict = judge(monitor(place), v, w, speed)
    assert 0.3 < verdict.share < 0.95
    assert (verdict.twist.vx, verdict.twist.wz) == (v * verdict.share, w * verdict.share)


def test_a_turn_may_fall_to_nothing() -> None:
    """A point beside the front corner: at any turn to the left the corner comes nearer."""
    verdict = judge(monitor((0.3, 0.205)), 0.0, 0.8, speed=0.5)
    assert verdict.twist == Twist2D(0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("v", "gap", "twist"),
    [
        (0.3, 0.00135, 0.0),  # 1/32 of it, 0.0094 m/s for 0.05 s, and 0.1 s of margin: 1.41 mm
        (0.3, 0.0015, 0.0),  # less than a twentieth and less than 2 cm/s
        (0.3, 0.0029, 0.01875),  # 2/32 is more than a twentieth: 2.81 mm
        (0.8, 0.0038, 0.025),  # 1/32, and 2.5 cm/s: 3.75 mm
        (0.8, 0.0037, 0.0),
        (-0.8, 0.0038, -0.025),
        (0.64, 0.0031, 0.02),  # 1/32, and 2 cm/s: 3 mm
    ],
)
def test_a_small_share_of_a_slow_command_stops_the_robot(v: float, gap: float, twist: float) -> None:
    made = monitor((0.36 + gap if v > 0.0 else -0.26 - gap, 0.0))
    assert judge(made, v).twist.vx == pytest.approx(twist, abs=1e-12)


@pytest.mark.parametrize(
    ("w", "gap", "share"),
    [
        (0.0, 0.00038, 0.0),  # 3/32 of 0.02 m/s for 0.05 s, and the margin: 0.37 mm, but 1.9 mm/s is too slow
        (0.0, 0.00041, 4 / 32),  # 0.40 mm, 2.5 mm/s
        (0.001, 0.00038, 0.0),  # and 0.04 mm/s of the farthest corner, which is 0.403 m from the base
        (0.004, 0.00038, 3 / 32),  # 1.88 mm/s and 0.15 mm/s
        (-0.004, 0.00038, 3 / 32),
    ],
)
def test_a_robot_slower_than_2_mm_s_stops(w: float, gap: float, share: float) -> None:
    """At 0.36 m, 1.5 of the 1440 directions are 2.36 mm: with 1 cm, a margin of hypot(10, 2.36) = 10.27 mm."""
    made = monitor((0.36 + gap, 0.0))
    assert judge(made, 0.02, w).share == share


# --- braking ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_robot_that_may_not_drive_a_command_brakes_along_the_curvature_of_its_last_one(side: float) -> None:
    """Commanded is a turn into a point 4.5 cm beside the way of a corner; given was 0.4 m/s with -0.1 rad/s, and it
    drives at 0.5 m/s: 0.46 m/s, and as much of the turn."""
    made = monitor((0.45, 0.245) if side > 0.0 else (-0.35, 0.245))
    made.give(0.9, Twist2D(0.3, 0.0, 0.7))
    made.give(0.95, Twist2D(side * 0.4, 0.0, -side * 0.1))
    verdict = judge(made, side * 0.5, side * 1.2, speed=side * 0.5)
    assert (verdict.twist.vx, verdict.twist.wz) == pytest.approx((side * 0.46, -side * 0.115))
    assert verdict.share == 0.0 and verdict.kind == "obstacle" and not verdict.is_stopped


@pytest.mark.parametrize(
    ("given", "speed"), [(None, 0.5), (Twist2D(0.0, 0.0, -0.1), 0.5), (Twist2D(0.5, 0.0, 0.9), 0.5)]
)
def test_a_robot_that_can_brake_along_no_way_stops_at_once(given: Twist2D | None, speed: float) -> None:
    """No command was given, or one to turn in place, or one that meets the obstacle too."""
    made = monitor((0.45, 0.245))
    if given is not None:
        made.give(0.9, given)
    verdict = judge(made, 0.5, 1.2, speed=speed)
    assert verdict.twist == Twist2D(0.0, 0.0, 0.0) and verdict.is_stopped and verdict.share == 0.0


# --- what is within the margin ----------------------------------------------------------------------------------------

AWAY = with_robot(LIMITS, motor_lag=0.2)
"""With a lag, a measured speed of -0.1 m/s lasts for 0.02 m: longer than a command of 0.04 m/s leads ahead."""


@pytest.mark.parametrize("measured", [(-0.1, 0.0), (0.0, 0.0)])
def test_a_measured_speed_makes_no_room_for_a_command_towards_what_is_within_the_margin(
    measured: tuple[float, float],
) -> None:
    """A point 8 mm before the front, within the margin of 1 cm at any speed."""
    assert judge(monitor((0.358, 0.1), limits=AWAY, twist=measured), 0.04).is_stopped


def test_a_measured_speed_counts_for_what_is_beyond_the_margin() -> None:
    """A point 1.5 cm before the front, from which the robot slides away: the command alone would bring it nearer."""
    assert judge(monitor((0.365, 0.1), limits=AWAY), 0.04).share < 1.0
    assert judge(monitor((0.365, 0.1), limits=AWAY, twist=(-0.1, 0.0)), 0.04).share == 1.0


def test_a_command_away_from_what_is_within_the_margin_is_free() -> None:
    for v in (-0.04, -0.7):
        assert judge(monitor((0.355, 0.1)), v).share == 1.0


@pytest.mark.parametrize(
    ("v", "curvature", "kind"),
    [
        (0.05, 0.05, ""),  # the rear corner, 0.25 m behind, comes nearer by 1.25 % of the way
        (0.0501, 0.05, "obstacle"),  # faster than 5 cm/s it must not
        (0.05, 0.1, "obstacle"),  # 2.5 %
        (0.05, -0.1, ""),  # it moves away
        (-0.05, -0.05, ""),  # turning left backwards it comes nearer too
        (-0.05, -0.1, "obstacle"),
    ],
)
def test_up_to_5_cm_a_second_what_is_within_the_margin_may_come_nearer_by_two_percent(
    v: float, curvature: float, kind: str
) -> None:
    """A point 5 mm beside the rear right corner, and the robot turns left: its rear swings out."""
    made = monitor((-0.2501, -0.205))
    assert judge(made, v, v * curvature).kind == kind


# --- odometry of before, and commands on their way --------------------------------------------------------------------

LATE = with_robot(LIMITS, dead_time=0.2)


@pytest.mark.parametrize(("more", "share"), [(0.001, 1.0), (-0.001, 31 / 32)])
def test_commands_in_flight_and_the_age_of_the_odometry_count(more: float, share: float) -> None:
    """Odometry of 1.0 s, judged at 1.05 s: 0.5 m/s act until 1.15 s, 0.8 m/s until 1.25 s, and then the command."""
    made = monitor((FRONT + 0.5 * 0.15 + 0.8 * 0.1 + stopping(0.7) + more, 0.1), limits=LATE)
    made.give(0.75, Twist2D(0.5, 0.0, 0.0))
    made.give(0.95, Twist2D(0.8, 0.0, 0.0))
    assert judge(made, 0.7, time=1.05).share == share


@pytest.mark.parametrize(("more", "share"), [(0.001, 1.0), (-0.001, 31 / 32)])
def test_odometry_that_is_newer_than_the_command_has_no_age(more: float, share: float) -> None:
    made = monitor((FRONT + 0.5 * 0.2 + stopping(0.7) + more, 0.1), limits=LATE)
    made.give(0.75, Twist2D(0.5, 0.0, 0.0))
    assert judge(made, 0.7, time=0.9).share == share


@pytest.mark.parametrize("v", [1.1, -1.1])
def test_a_fast_command_in_flight_reaches_farther_than_a_slow_one(v: float) -> None:
    """0.55 m in the dead time of 0.5 s; the command alone, 0.03 m/s, would reach 0.002 m."""
    made = monitor((0.8, 0.1) if v > 0.0 else (-0.7, 0.1), limits=with_robot(LIMITS, dead_time=0.5))
    made.give(0.9, Twist2D(v, 0.0, 0.0))
    assert judge(made, math.copysign(0.03, v)).kind == "obstacle"


@pytest.mark.parametrize("v", [1.1, -1.1])
def test_the_measured_speed_reaches_farther_than_a_slow_command(v: float) -> None:
    """With a lag of 0.4 s, 1.1 m/s end after 0.44 m."""
    made = monitor((0.75, 0.1) if v > 0.0 else (-0.65, 0.1), limits=with_robot(LIMITS, motor_lag=0.4), twist=(v, 0.0))
    assert judge(made, math.copysign(0.03, v)).kind == "obstacle"


def test_the_measured_turn_rate_counts_too() -> None:
    """With a lag of 0.4 s, 0.5 rad/s end after 0.2 rad: the front corner goes 0.07 m to the left."""
    made = monitor((0.3, 0.23), limits=with_robot(LIMITS, motor_lag=0.4), twist=(0.0, 0.5))
    assert judge(made, 0.03).kind == "obstacle"
    assert judge(monitor((0.3, 0.23), limits=with_robot(LIMITS, motor_lag=0.4)), 0.03).kind == ""


@pytest.mark.parametrize(("turn_deceleration", "kind"), [(0.5, "obstacle"), (50.0, ""), (math.inf, "")])
def test_turning_ends_by_the_turn_deceleration(turn_deceleration: float, kind: str) -> None:
    """0.6 rad/s: with 0.5 rad/s² 0.36 rad and a period, else 0.03 rad, which take the corner 1 cm aside."""
    made = monitor((0.3, 0.26), limits=with_robot(LIMITS, max_angular_acceleration=turn_deceleration))
    assert judge(made, 0.0, 0.6).kind == kind


def test_commands_that_act_no_more_are_forgotten() -> None:
    """After a dead time of 0.2 s, and 0.5 s, the one before the oldest that counts is the first of the roll-out."""
    made = monitor(limits=LATE)
    for time in (0.0, 0.1, 0.12, 0.3):
        made.give(time, Twist2D(time, 0.0, -time))
    assert len(made._given) == 4
    made.give(0.795, Twist2D(0.8, 0.0, 0.0))
    assert made._given[0] == (0.0, 0.0, 0.0, 0.0)
    made.give(0.805, Twist2D(0.0, 0.0, 0.0))
    assert list(made._given)[:2] == [(0.1, 0.1, -0.1, 0.0), (0.12, 0.12, -0.12, 0.0)]
    made.give(9.0, Twist2D(0.0, 0.0, 0.0))
    assert list(made._given) == [(0.805, 0.0, 0.0, 0.0), (9.0, 0.0, 0.0, 0.0)]


# --- space that no sensor has seen ------------------------------------------------------------------------------------


def blind(limits: MonitorLimits = LIMITS) -> CollisionMonitor:
    made = monitor(limits=limits)
    made.ignores_unseen = False
    return made


def test_space_that_no_sensor_has_seen_is_not_entered() -> None:
    """The corners reach 0.403 m, and a cell more is assumed to be free: from the front that is 0.05 to 0.16 m."""
    verdict = judge(blind(), 0.7, 0.1)
    assert verdict.kind == "unseen" and verdict.place is not None and 0.0 < verdict.share < 1.0
    assert 0.05 < verdict.place.x < 0.16 and 0.0 < verdict.place.y < 0.01
    assert verdict.distance == pytest.approx(math.hypot(verdict.place.x, verdict.place.y))
    assert stopping(verdict.twist.vx) < 0.16
    made = blind()
    made.ignores_unseen = True
    assert judge(made, 0.7, 0.1).kind == ""


def test_a_monitor_minds_unseen_space_unless_it_is_told_otherwise() -> None:
    made = CollisionMonitor(LIMITS)
    made.move(Odometry(10**9, Pose2D(0.0, 0.0, 0.0), Twist2D(0.0, 0.0, 0.0)))
    assert judge(made, 0.7).kind == "unseen"


def test_space_that_a_laser_sees_may_be_entered() -> None:
    """A fan of 2 rad that meets nothing."""
    made, bearings = blind(), np.linspace(-1.0, 1.0, 101)
    nothing = np.zeros(101)
    seen = RangeScan(10**9, np.zeros((101, 2)), bearings, nothing, nothing, np.full(101, math.inf), 0.05, 4.0)
    assert made.look("laser", seen)
    assert judge(made, 0.7).share == 1.0
    assert judge(made, -0.7).kind == "unseen"


@pytest.mark.parametrize(("steps", "kind"), [(98, ""), (104, "unseen")])
def test_seen_space_counts_for_5_m_of_way(steps: int, kind: str) -> None:
    """The robot goes 5 cm to and fro; then it turns into the room that was free at its start."""
    made = blind()
    for k in range(steps):
        x, y = 3.0 + 0.05 * (k % 2) * math.cos(2.5), -1.0 + 0.05 * (k % 2) * math.sin(2.5)
        made.move(Odometry(round((1.05 + 0.05 * k) * 1e9), Pose2D(x, y, 2.5), Twist2D(0.0, 0.0, 0.0)))
    assert judge(made, 0.0, 9.0, time=made._stamps[-1]).kind == kind


def slide(made: CollisionMonitor, first: float) -> None:
    """Odometry that slides 0.3 m ahead in steps of 1 cm, and back, for 0.6 s."""
    for k in range(61):
        along = 0.01 * (k if k < 31 else 60 - k)
        x, y = 3.0 + along * math.cos(2.5), -1.0 + along * math.sin(2.5)
        made.move(Odometry(round((first + 0.01 * k) * 1e9), Pose2D(x, y, 2.5), Twist2D(0.0, 0.0, 0.0)))


def test_a_robot_that_slides_into_unseen_space_does_not_make_it_known() -> None:
    made = blind()
    before = judge(made, 0.7)
    slide(made, 1.05)
    assert before.kind == "unseen" and judge(made, 0.7, time=1.7).share == before.share


def test_a_robot_that_drives_makes_its_way_known() -> None:
    made = blind()
    before = judge(made, 0.7)
    judge(made, 0.0)
    slide(made, 1.05)
    assert judge(made, 0.7, time=1.7).share > before.share + 0.2


def test_a_stop_is_free_whatever_is_in_the_way() -> None:
    made = monitor((0.3, 0.1))
    assert judge(made, 0.0) == Verdict(Twist2D(0.0, 0.0, 0.0))
    moving = monitor((0.5, 0.1), limits=with_robot(LIMITS, motor_lag=0.4), twist=(0.5, 0.0))
    assert judge(moving, 0.0, speed=0.5).kind == "obstacle", "a robot that still moves is followed to standstill"


# --- directions of a laser --------------------------------------------------------------------------------------------


def test_directions_are_counted_from_the_lasers_own_place() -> None:
    """Two readings of 0.35 m, 1.9 degrees apart, from a laser at (0.25, -0.1); from the base their distances differ."""
    made = monitor(limits=replace(LIMITS, sigma=0.0001))
    bearings, nothing = np.radians([50.0, 51.9]), np.zeros(2)
    origins = np.tile((0.25, -0.1), (2, 1))
    made.look("laser", RangeScan(10**9, origins, bearings, nothing, nothing, np.full(2, 0.35), 0.05, 4.0))
    place = judge(made, 0.7).place
    x = 0.25 + 0.175 * (math.cos(bearings[0]) + math.cos(bearings[1]))
    y = -0.1 + 0.175 * (math.sin(bearings[0]) + math.sin(bearings[1]))
    assert place is not None and (place.x, place.y) == pytest.approx((x, y))


def test_directions_are_counted_from_where_the_last_beam_began() -> None:
    """In 0.1 s the robot comes 0.5 m nearer; both echoes are 0.4 m before it then, at 19 and 21 degrees."""
    made = CollisionMonitor(replace(LIMITS, sigma=0.0001))
    made.ignores_unseen = True
    for time, x in ((1.0, -0.5), (1.1, 0.0)):
        made.move(Odometry(round(time * 1e9), Pose2D(x, 0.0, 0.0), Twist2D(0.0, 0.0, 0.0)))
    (x0, y0), (x1, y1) = ((0.4 * math.cos(b), 0.4 * math.sin(b)) for b in np.radians([19.0, 21.0]))
    bearings = np.array([math.atan2(y0, 0.5 + x0), math.atan2(y1, x1)])
    ranges = np.array([math.hypot(0.5 + x0, y0), 0.4])
    made.look(
        "laser", RangeScan(10**9, np.zeros((2, 2)), bearings, np.zeros(2), np.array([0.0, 0.1]), ranges, 0.05, 4.0)
    )
    place = judge(made, 0.7, time=1.1).place
    assert place is not None and (place.x, place.y) == pytest.approx((0.5 * (x0 + x1), 0.5 * (y0 + y1)))

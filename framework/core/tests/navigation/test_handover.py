"""Hand-over: engaged by an obstacle in the corridor, released after a delay."""

from __future__ import annotations

import math

import numpy as np
import pytest
from navloom.geometry.footprints import rectangle
from navloom.messages import HandOver, OccupancyGrid, Pose2D, RangeScan, Twist2D
from navloom.navigation.echo_memory import EchoMemory
from navloom.navigation.handover import HandOverRule, own_turn, own_way

BASE = Pose2D(0.0, 0.0, 0.0)
WAY = np.array([(0.0, 0.0), (1.0, 0.0), (2.0, 0.0)])


def straight(base: Pose2D, x: float, y: float) -> np.ndarray:
    return np.array([(base.x, base.y), (x, y)])


def scan(bearing: float, distance: float, half_angle: float = 0.0) -> RangeScan:
    one = np.ones(1)
    return RangeScan(
        0, np.zeros((1, 2)), one * bearing, one * half_angle, one * 0.0, one * distance, range_min=0.1, range_max=4.0
    )


def test_an_echo_in_the_corridor_is_measured_from_the_robot() -> None:
    memory = EchoMemory(keep=0.5, spread=0.0)
    memory.add(scan(math.atan2(0.3, 1.2), math.hypot(0.3, 1.2)), BASE, 0.0)
    assert memory.nearest(BASE, straight(BASE, 2.0, 0.0), 0.4, 0.0) == pytest.approx(math.hypot(0.3, 1.2))
    assert memory.nearest(BASE, straight(BASE, 2.0, 0.0), 0.29, 0.0) == math.inf


def test_the_corridor_ends_half_a_width_past_the_target() -> None:
    memory = EchoMemory(keep=0.5, spread=0.0)
    memory.add(scan(0.0, 2.3), BASE, 0.0)
    assert memory.nearest(BASE, straight(BASE, 2.0, 0.0), 0.4, 0.0) == pytest.approx(2.3)
    assert memory.nearest(BASE, straight(BASE, 1.8, 0.0), 0.4, 0.0) == math.inf


def test_an_echo_is_remembered_where_it_was_in_the_map() -> None:
    memory = EchoMemory(keep=0.5, spread=0.0)
    memory.add(scan(0.0, 1.0), Pose2D(1.0, 2.0, math.pi / 2), 0.0)
    assert memory.nearest(Pose2D(1.0, 2.5, 0.0), straight(Pose2D(1.0, 2.5, 0.0), 1.0, 4.0), 0.1, 0.4) == pytest.approx(
        0.5
    )
    assert memory.nearest(Pose2D(1.0, 2.5, 0.0), straight(Pose2D(1.0, 2.5, 0.0), 1.0, 4.0), 0.1, 0.6) == math.inf


def test_a_cone_counts_its_arc_up_to_the_spread() -> None:
    wide = EchoMemory(keep=0.5, spread=1.0)
    wide.add(scan(math.radians(30.0), 2.0, math.radians(15.0)), BASE, 0.0)
    assert wide.nearest(BASE, straight(BASE, 2.0, 0.0), 0.6, 0.0) == pytest.approx(2.0)
    axis = EchoMemory(keep=0.5, spread=0.0)
    axis.add(scan(math.radians(30.0), 2.0, math.radians(15.0)), BASE, 0.0)
    assert axis.nearest(BASE, straight(BASE, 2.0, 0.0), 0.6, 0.0) == math.inf


def test_no_echo_blocks_nothing() -> None:
    rule = HandOverRule("when_blocked", release=0.5)
    assert not rule.step(0.0, [scan(0.0, math.inf)], BASE, WAY, 0.5).engaged


def test_it_engages_at_once_and_releases_after_the_delay() -> None:
    rule = HandOverRule("when_blocked", release=0.5, keep=0.1)
    assert rule.step(0.0, [scan(0.0, 1.5)], BASE, WAY, 0.5).engaged
    engaged = {step: rule.step(step / 20, [], BASE, WAY, 0.5).engaged for step in range(1, 14)}
    # The echo counts until 0.1 s, and half a second after that the controller drives again.
    assert engaged[11] and not engaged[12]


@pytest.mark.parametrize(("mode", "engaged"), [("always", True), ("never", False)])
def test_a_fixed_mode_is_fixed(mode: str, engaged: bool) -> None:
    rule = HandOverRule(mode, release=0.5)  # type: ignore[arg-type]
    assert rule.step(0.0, [scan(0.0, 1.0)], BASE, WAY, 0.5).engaged is engaged
    assert rule.step(9.0, [], BASE, WAY, 0.5).engaged is engaged


def test_the_memory_overwrites_its_oldest_echoes() -> None:
    memory = EchoMemory(keep=9.0, spread=0.0, capacity=2)
    for distance in (1.0, 1.5, 1.8):
        memory.add(scan(0.0, distance), BASE, 0.0)
    assert memory.nearest(BASE, straight(BASE, 2.0, 0.0), 0.4, 0.0) == pytest.approx(1.5)


def test_the_strip_follows_the_bend_of_the_way() -> None:
    bend = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)])
    memory = EchoMemory(keep=0.5, spread=0.0)
    memory.add(scan(math.radians(60.0), 0.8), BASE, 0.0)
    # (0.4, 0.69) is 0.6 m from the bent way, but only 0.21 m from the straight line to its end.
    assert memory.nearest(BASE, bend, 0.35, 0.0) == math.inf
    assert memory.nearest(BASE, straight(BASE, 1.0, 1.0), 0.35, 0.0) == pytest.approx(0.8)


def test_obstacles_behind_the_robot_do_not_count() -> None:
    memory = EchoMemory(keep=0.5, spread=0.0)
    memory.add(scan(math.pi, 0.2), BASE, 0.0)
    assert memory.nearest(BASE, WAY, 0.5, 0.0) == math.inf


def test_an_obstacle_on_the_robots_own_arc_engages_too() -> None:
    """The trajectory ahead is free; the robot turns left, where there is an obstacle."""
    echo = scan(math.radians(30.0), 0.6)  # at (0.52, 0.3), 0.18 m beside the arc
    own = own_way(BASE, Twist2D(0.5, 0.0, 0.5), 1.2)
    assert not HandOverRule("when_blocked", release=0.5).step(0.0, [echo], BASE, WAY, 0.25).engaged
    seen = HandOverRule("when_blocked", release=0.5).step(0.0, [echo], BASE, WAY, 0.25, own)
    assert seen.engaged and seen.nearest == pytest.approx(0.6)
    narrower = HandOverRule("when_blocked", release=0.5, margin=0.1)
    assert not narrower.step(0.0, [echo], BASE, WAY, 0.25, own).engaged


def test_the_noise_of_a_laser_is_averaged_before_it_counts() -> None:
    """One of seven beams at a wall 0.42 m beside the way is 7 cm too short; their mean is 1 cm too short."""
    ranges = np.full(7, 0.42)
    ranges[3] -= 0.07
    bearings = math.pi / 2 + np.linspace(-0.003, 0.003, 7)
    for half_angle, is_blocked in ((0.0, False), (0.26, True)):
        halves = np.full(7, half_angle)
        heard = RangeScan(0, np.zeros((7, 2)), bearings, halves, np.zeros(7), ranges, 0.1, 4.0)
        memory = EchoMemory(keep=0.5, spread=0.0)
        memory.add(heard, BASE, 0.0)
        assert math.isfinite(memory.nearest(BASE, WAY, 0.4, 0.0)) is is_blocked


def test_the_robots_own_way_is_an_arc_of_the_commanded_curvature() -> None:
    """At 0.5 m/s and 0.5 rad/s, radius 1 m: after 1 s, 0.5 m along, it is at (sin 0.5, 1 - cos 0.5)."""
    assert own_way(BASE, Twist2D(0.5, 0.0, 0.5), 5.0)[-1] == pytest.approx((math.sin(0.5), 1.0 - math.cos(0.5)))
    assert own_way(BASE, Twist2D(0.2, 0.0, 2.0), 5.0)[-1] == pytest.approx((0.1, 0.1))  # a quarter turn at most
    assert len(own_way(BASE, Twist2D(0.0, 0.0, 1.0), 5.0)) == 0


SQUARE = rectangle(0.5, 0.5)


def turning(twist: Twist2D, point: tuple[float, float] | None, grid: OccupancyGrid | None = None) -> HandOver:
    """The first decision of a rule for a square robot that turns with one echo, m, base frame, beside it."""
    rule = HandOverRule("when_blocked", release=0.5, footprint=SQUARE)
    scans = [] if point is None else [scan(math.atan2(point[1], point[0]), math.hypot(*point))]
    return rule.step(0.0, scans, BASE, WAY, 0.05, turn=own_turn(twist, SQUARE), grid=grid)


def test_a_turn_on_the_spot_is_looked_along_for_90_degrees_or_one_second() -> None:
    poses = own_turn(Twist2D(0.0, 0.0, 4.0), SQUARE)
    assert poses[-1] == pytest.approx([0.0, 0.0, math.pi / 2]) and np.abs(poses[:, :2]).max() == 0.0
    assert own_turn(Twist2D(0.0, 0.0, -0.5), SQUARE)[-1, 2] == pytest.approx(-0.5)
    assert np.diff(poses[:, 2]).max() * math.hypot(0.25, 0.25) <= 0.02


def test_a_way_back_is_an_arc() -> None:
    x, y, heading = own_turn(Twist2D(-0.2, 0.0, 0.4), SQUARE)[-1]
    assert (x, y, heading) == pytest.approx((-0.5 * math.sin(0.4), -0.5 * (1 - math.cos(0.4)), 0.4))


def test_a_command_forward_is_no_turn_unless_its_centre_lies_under_the_robot() -> None:
    assert len(own_turn(Twist2D(0.3, 0.0, 1.0), SQUARE)) == 0 and len(own_turn(Twist2D(0.2, 0.0, 1.0), SQUARE)) > 1
    assert len(own_turn(Twist2D(0.0, 0.0, 0.0), SQUARE)) == 0


def test_it_engages_for_an_echo_that_a_corner_sweeps_and_not_for_one_beyond_its_circle() -> None:
    assert turning(Twist2D(0.0, 0.0, 1.0), (-0.1, -0.3)).engaged  # the rear right corner comes along at 0.354 m
    assert not turning(Twist2D(0.0, 0.0, 1.0), (-0.1, -0.36)).engaged
    behind = turning(Twist2D(-0.2, 0.0, 0.0), (-0.4, 0.0))
    assert behind.engaged and behind.nearest == pytest.approx(0.4)
    assert not turning(Twist2D(-0.2, 0.0, 0.0), (0.4, 0.2)).engaged


def test_it_engages_for_a_mapped_wall_that_a_corner_sweeps() -> None:
    cells = np.zeros((40, 40), np.int8)
    cells[:10] = 100
    near, far = (OccupancyGrid(cells, 0.05, Pose2D(-1.0, y, 0.0)) for y in (-0.8, -0.9))  # surfaces at -0.3 and -0.4
    assert turning(Twist2D(0.0, 0.0, 1.0), None, near).engaged
    assert not turning(Twist2D(0.0, 0.0, 1.0), None, far).engaged


LONG = np.array([(0.9, 0.25), (-0.3, 0.15), (-0.3, -0.35), (0.9, -0.25)])
"""A long footprint, wider on its right; its farthest corner is hypot(0.9, 0.25) = 0.934 m from the base."""


@pytest.mark.parametrize(
    ("v", "w", "end"),
    [
        (-0.3, 0.0, (-0.3, 0.0, 0.0)),  # straight back for 1 s
        (0.0, -4.0, (0.0, 0.0, -math.pi / 2)),  # a quarter turn to the right
        (-0.2, -4.0, (-0.05, 0.05, -math.pi / 2)),  # a quarter of a circle of 5 cm
        (0.2, 4.0, (0.05, 0.05, math.pi / 2)),
        (-0.25, 0.5, (-0.5 * math.sin(0.5), -0.5 * (1.0 - math.cos(0.5)), 0.5)),
    ],
)
def test_the_poses_of_a_turn_lie_on_its_arc(v: float, w: float, end: tuple[float, float, float]) -> None:
    poses = own_turn(Twist2D(v, 0.0, w), LONG)
    assert poses[0] == pytest.approx((0.0, 0.0, 0.0)) and poses[-1] == pytest.approx(end)
    turned = poses[:, 2]
    if w != 0.0:
        assert poses[:, 0] == pytest.approx(v / w * np.sin(turned))
        assert poses[:, 1] == pytest.approx(v / w * (1.0 - np.cos(turned)))


@pytest.mark.parametrize(
    ("v", "w", "poses"),
    [
        (0.0, 1.0, 48),  # 0.934 m of a corner's way in steps of at most 2 cm: 47 of them
        (0.0, -1.0, 48),
        (-0.3, 0.0, 16),
        (-0.3, 0.5, 40),  # 0.3 + 0.467 m
    ],
)
def test_no_corner_moves_more_than_2_cm_between_two_poses_of_a_turn(v: float, w: float, poses: int) -> None:
    assert len(own_turn(Twist2D(v, 0.0, w), LONG)) == poses


@pytest.mark.parametrize(("v", "turns"), [(0.35, True), (0.351, False)])
@pytest.mark.parametrize("w", [1.0, -1.0])
def test_a_turn_has_its_centre_under_the_wider_side(v: float, turns: bool, w: float) -> None:
    assert (len(own_turn(Twist2D(v, 0.0, w), LONG)) > 0) is turns


def test_without_a_footprint_no_turn_is_looked_along() -> None:
    assert own_turn(Twist2D(0.0, 0.0, 1.0), np.empty((0, 2))).shape == (0, 3)
    assert own_turn(Twist2D(0.3, 0.0, 0.0), LONG).shape == (0, 3)
    assert own_way(BASE, Twist2D(-0.3, 0.0, 0.0), 1.0).shape == (0, 2)


def long_turn(point: tuple[float, float], base: Pose2D = BASE, twist: Twist2D = Twist2D(0.0, 0.0, 0.5)) -> HandOver:  # noqa: B008
    """A long robot turns left by 0.5 rad at a place of the map; the echo is in the base frame."""
    rule = HandOverRule("when_blocked", release=0.5, footprint=LONG)
    seen = scan(math.atan2(point[1], point[0]), math.hypot(*point))
    ahead = np.array([(base.x, base.y), (base.x + 0.01, base.y)])
    return rule.step(0.0, [seen], base, ahead, 0.01, turn=own_turn(twist, LONG))


@pytest.mark.parametrize("base", [BASE, Pose2D(3.0, -2.0, 1.1)])
def test_the_front_of_a_long_robot_sweeps_to_its_left(base: Pose2D) -> None:
    """At 0.5 rad its left front corner is at (0.67, 0.651); the point (0.68, 0.55) is then 5 cm within."""
    swept = long_turn((0.68, 0.55), base)
    assert swept.engaged and swept.nearest == pytest.approx(math.hypot(0.68, 0.55))
    assert not long_turn((0.68, 0.72), base).engaged, "beyond the corner's circle at that angle"
    assert not long_turn((0.68, -0.4), base).engaged, "on the other side"
    assert not long_turn((0.68, 0.55), base, Twist2D(0.0, 0.0, -0.5)).engaged


def test_what_is_under_the_robot_already_is_no_reason_unless_it_comes_nearer() -> None:
    assert not long_turn(
        (0.5, -0.2)
    ).engaged  # 8 cm within the right edge, which comes nearer until the point is outside
    assert long_turn((0.5, 0.2)).engaged


def test_a_reset_forgets_echoes_and_engagement() -> None:
    rule = HandOverRule("when_blocked", release=0.5, keep=9.0)
    assert rule.step(0.0, [scan(0.0, 1.5)], BASE, WAY, 0.5).engaged
    rule.reset()
    assert not rule.engaged and not rule.step(0.1, [], BASE, WAY, 0.5).engaged
    always = HandOverRule("always", release=0.5)
    always.reset()
    assert always.engaged

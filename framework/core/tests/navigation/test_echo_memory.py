"""The hand-over's memory of echoes and its strips, by places and distances that are worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from navloom.messages import Pose2D, RangeScan, Twist2D
from navloom.navigation.echo_memory import EchoMemory
from navloom.navigation.handover import NOWHERE, HandOverRule, own_way
from numpy.typing import NDArray

Floats = NDArray[np.float64]

RISING = math.atan2(0.6, 0.8)
"""A direction of cosine 0.8 and sine 0.6."""
NORTH = 0.5 * math.pi
BASE = Pose2D(1.3, -0.7, RISING)


def scan(
    bearings: list[float],
    ranges: list[float],
    halves: list[float] | None = None,
    origin: tuple[float, float] = (0.0, 0.0),
) -> RangeScan:
    n = len(ranges)
    return RangeScan(
        0, np.tile(np.array([origin]), (n, 1)), np.array(bearings), np.array(halves or [0.0] * n), np.zeros(n),
        np.array(ranges), 0.1, 4.0,
    )  # fmt: skip


def memory(*scans: RangeScan, spread: float = 0.0, base: Pose2D = BASE, capacity: int = 64) -> EchoMemory:
    made = EchoMemory(0.5, spread, capacity)
    for one in scans:
        made.add(one, base, 2.0)
    return made


def holds(made: EchoMemory, x: float, y: float, time: float = 2.0) -> bool:
    """Whether an echo is within 1 mm of a place: seen from 5 m away, on a way of 4 mm through it."""
    way = np.array([(x - 0.002, y), (x + 0.002, y)])
    distance = made.nearest(Pose2D(x - 3.0, y + 4.0, 1.0), way, 0.001, time)
    return math.isclose(distance, 5.0, abs_tol=0.003)


# --- places of echoes -------------------------------------------------------------------------------------------------


def test_an_echo_is_where_its_beam_ended_from_the_sensors_own_place() -> None:
    """From (0.3, 0.1) in a base at (1.3, -0.7), turned to (0.8, 0.6), to the left: (0.3, 1.5) in the base."""
    made = memory(scan([NORTH], [1.4], origin=(0.3, 0.1)))
    assert holds(made, 1.3 + 0.8 * 0.3 - 0.6 * 1.5, -0.7 + 0.6 * 0.3 + 0.8 * 1.5)


def arc_place(angle: float) -> tuple[float, float]:
    """Place of a reading of 1.5 m from (0.3, 0.1), m, map frame."""
    x, y = 1.3 + 0.8 * 0.3 - 0.6 * 0.1, -0.7 + 0.6 * 0.3 + 0.8 * 0.1
    return x + 1.5 * math.cos(RISING + angle), y + 1.5 * math.sin(RISING + angle)


@pytest.mark.parametrize(("spread", "half", "ends"), [(0.5, 0.3, 0.15), (1.0, 0.3, 0.3), (1.0, 0.015, 0.015)])
def test_the_ends_of_the_counted_arc_are_remembered_too(spread: float, half: float, ends: float) -> None:
    made = memory(scan([0.4], [1.5], [half], (0.3, 0.1)), spread=spread)
    for angle in (0.4 - ends, 0.4, 0.4 + ends):
        assert holds(made, *arc_place(angle))
    assert not holds(made, *arc_place(0.4 + 2.0 * ends)) and not holds(made, *arc_place(0.4 - 0.5 * ends))


@pytest.mark.parametrize(("half", "spread"), [(0.0, 1.0), (0.3, 0.0)], ids=["laser", "axis"])
def test_a_beam_without_an_arc_is_one_place(half: float, spread: float) -> None:
    """Room for two: the older one is still there."""
    made = memory(scan([0.0], [1.5], [half]), scan([1.0], [1.5], [half]), spread=spread, capacity=2)
    assert holds(made, 1.3 + 1.2, -0.7 + 0.9)


@pytest.mark.parametrize(("reading", "is_echo"), [(3.99, True), (4.0, False), (math.inf, False)])
def test_a_reading_of_range_max_is_no_echo(reading: float, is_echo: bool) -> None:
    made = memory(scan([0.0, 1.0], [reading, 1.5], [0.1, 0.1]))
    assert holds(made, 1.3 + 0.8 * 3.99, -0.7 + 0.6 * 3.99) is is_echo
    assert holds(made, 1.3 + 1.5 * math.cos(RISING + 1.0), -0.7 + 1.5 * math.sin(RISING + 1.0)), "the next one is"


POST = scan([0.3], [1.5])
"""A laser's echo, at the end of the arc on which a sonar of 0.3 rad hears it."""


@pytest.mark.parametrize(
    ("reading", "half", "is_explained"),
    [
        (1.5, 0.3, True),
        (1.59, 0.3, True),
        (1.41, 0.3, True),
        (1.61, 0.3, False),  # something behind the post
        (1.39, 0.3, False),  # something before it that the laser does not see
        (1.5, 0.24, True),  # the post is 0.09 m beside the cone
        (1.5, 0.22, False),
        (0.1, 0.3, False),  # the sonar is blind there, and the post is farther
    ],
)
def test_a_sonars_echo_that_a_laser_explains_adds_nothing(reading: float, half: float, is_explained: bool) -> None:
    made = memory(POST, scan([0.0], [reading], [half]), spread=1.0)
    x, y = 1.3 + 0.8 * reading, -0.7 + 0.6 * reading
    assert holds(made, x, y) is not is_explained


@pytest.mark.parametrize(("distance", "is_explained"), [(0.05, True), (0.15, True), (0.25, False)])
def test_a_reading_of_range_min_is_explained_by_a_nearer_point(distance: float, is_explained: bool) -> None:
    made = memory(scan([0.0], [distance]), scan([0.0], [0.1], [0.3]), spread=1.0)
    assert made.near(BASE, 9.0, 2.0).shape[0] == (1 if is_explained else 4)


def test_neither_a_sonar_nor_a_laser_point_that_is_too_old_explains() -> None:
    twice = memory(scan([0.0], [1.5], [0.3]), scan([0.0], [1.5], [0.3]), spread=1.0)
    assert len(twice.near(BASE, 9.0, 2.0)) == 6
    made = memory(POST, spread=1.0)
    made.add(scan([0.0], [1.5], [0.3]), BASE, 2.51)
    assert len(made.near(BASE, 9.0, 2.51)) == 3


def test_the_oldest_are_overwritten_one_by_one() -> None:
    ranges = (1.0, 1.5, 2.0, 2.5, 3.0)
    made = memory(*(scan([-RISING], [r]) for r in ranges), capacity=3)
    assert [holds(made, 1.3 + r, -0.7) for r in ranges] == [False, False, True, True, True]


def test_nothing_is_left_after_clear() -> None:
    made = memory(scan([-RISING], [1.0]), scan([-RISING], [1.5]))
    made.clear()
    assert not holds(made, 2.3, -0.7) and not holds(made, 2.8, -0.7)
    made.add(scan([-RISING], [2.0]), BASE, 2.0)
    assert holds(made, 3.3, -0.7) and not holds(made, 2.8, -0.7)


def test_an_echo_counts_for_as_long_as_it_is_kept() -> None:
    made = memory(scan([-RISING], [1.0]))
    assert holds(made, 2.3, -0.7, time=2.5)
    assert not holds(made, 2.3, -0.7, time=2.51)
    made.add(scan([-RISING], [1.5]), BASE, 2.4)
    assert holds(made, 2.8, -0.7, time=2.9) and not holds(made, 2.3, -0.7, time=2.9)


# --- noise of a laser -------------------------------------------------------------------------------------------------


def smoothed(ranges: list[float], half: float = 0.0) -> list[float]:
    """Readings that are remembered, m: one beam in each of some directions 0.02 rad apart."""
    bearings = [0.02 * k - RISING for k in range(len(ranges))]
    made = memory(scan(bearings, ranges, [half] * len(ranges)))
    places = made._points[: len(ranges), :2] - (1.3, -0.7)
    return [float(r) for r in np.hypot(places[:, 0], places[:, 1])]


def test_a_lasers_reading_is_the_mean_of_seven() -> None:
    ranges = [1.0, 1.01, 1.03, 1.02, 1.05, 1.04, 1.0, 1.06, 1.09]
    assert smoothed(ranges) == pytest.approx(
        [
            (1.0 + 1.01 + 1.03 + 1.02) / 4,
            (1.0 + 1.01 + 1.03 + 1.02 + 1.05) / 5,
            (1.0 + 1.01 + 1.03 + 1.02 + 1.05 + 1.04) / 6,
            (1.0 + 1.01 + 1.03 + 1.02 + 1.05 + 1.04 + 1.0) / 7,
            (1.01 + 1.03 + 1.02 + 1.05 + 1.04 + 1.0 + 1.06) / 7,
            (1.03 + 1.02 + 1.05 + 1.04 + 1.0 + 1.06 + 1.09) / 7,
            (1.02 + 1.05 + 1.04 + 1.0 + 1.06 + 1.09) / 6,
            (1.05 + 1.04 + 1.0 + 1.06 + 1.09) / 5,
            (1.04 + 1.0 + 1.06 + 1.09) / 4,
        ]
    )


def test_neighbours_more_than_10_cm_away_do_not_count() -> None:
    assert smoothed([0.5, 0.6, 0.71]) == pytest.approx([0.55, 0.55, 0.71])
    assert smoothed([0.0625, 0.1625, 3.0])[:2] == pytest.approx([0.1125, 0.1125]), "just 10 cm do"


@pytest.mark.parametrize(("half", "first"), [(0.0199, 1.02), (0.02, 1.0)])
def test_a_wider_beam_is_a_sonars_and_taken_as_it_is(half: float, first: float) -> None:
    assert smoothed([1.0, 1.04], half)[0] == pytest.approx(first)


# --- the nearest in a strip -------------------------------------------------------------------------------------------


def at(*places: tuple[float, float]) -> EchoMemory:
    """A memory of echoes in places of the map."""
    return memory(*(scan([math.atan2(y, x)], [math.hypot(x, y)], [0.1]) for x, y in places), base=Pose2D(0.0, 0.0, 0.0))


def nearest(made: EchoMemory, way: list[tuple[float, float]], half_width: float, base: tuple[float, float]) -> float:
    return made.nearest(Pose2D(*base, 0.3), np.array(way), half_width, 2.0)


BEND = [(-0.5, -1.0), (-1.5, -1.0), (-1.5, -2.5), (0.5, -2.5)]
"""West, south and east."""


@pytest.mark.parametrize(
    ("place", "is_within"),
    [
        ((-1.0, -0.71), True),
        ((-1.0, -0.69), False),
        ((-1.0, -1.29), True),
        ((-1.0, -1.31), False),
        ((-0.51, -1.1), True),
        ((-0.49, -1.1), False),  # behind the first segment
        ((-1.79, -1.0), True),
        ((-1.81, -1.0), False),
        ((-1.7, -0.8), True),  # 0.283 m from the corner
        ((-1.72, -0.78), False),  # 0.311 m
        ((-1.79, -1.9), True),
        ((-1.21, -1.9), True),
        ((-1.19, -1.9), False),
        ((-1.7, -2.7), True),
        ((-1.72, -2.72), False),
        ((0.0, -2.21), True),
        ((0.0, -2.19), False),
        ((0.0, -2.79), True),
        ((0.0, -2.81), False),
        ((0.79, -2.5), True),
        ((0.81, -2.5), False),
        ((0.7, -2.7), True),
        ((0.72, -2.72), False),
    ],
)
def test_the_strip_is_all_that_is_nearer_to_the_way_than_half_its_width(
    place: tuple[float, float], is_within: bool
) -> None:
    assert math.isfinite(nearest(at(place), BEND, 0.3, (-0.5, -1.0))) is is_within


def test_an_echo_at_half_the_width_is_outside() -> None:
    """Places without rounding."""
    base = (0.0, 0.0)
    assert nearest(at((0.0, 0.25)), [(0.0, 0.0), (0.0, 0.0), (1.0, 0.0)], 0.25, base) == math.inf
    assert nearest(at((1.25, 0.0)), [(0.0, 0.0), (1.0, 0.0)], 0.25, base) == math.inf


def test_the_nearest_to_the_base_counts_wherever_the_way_begins() -> None:
    """From (-0.3, -1.4): 0.806 m to the first, 1.204 m to the second, 1.432 m to the third."""
    places = [(-1.0, -1.0), (-1.5, -1.5), (-1.5, -2.2)]
    for order in ([0, 1, 2], [2, 1, 0], [1, 0, 2]):
        made = at(*(places[k] for k in order))
        assert nearest(made, BEND, 0.3, (-0.3, -1.4)) == pytest.approx(math.hypot(0.7, 0.4))
        assert nearest(made, BEND[1:], 0.2, (-0.3, -1.4)) == pytest.approx(math.hypot(1.2, 0.1))
        assert nearest(made, BEND, 0.3, (-3.0, -2.2)) == pytest.approx(1.5)


def test_a_way_may_lead_back_to_the_base() -> None:
    """The base is at its end; the echo is 0.1 m from its first point."""
    assert nearest(at((-0.6, -1.0)), BEND, 0.3, (0.5, -2.5)) == pytest.approx(math.hypot(1.1, 1.5))


def test_rounding_loses_no_echo_and_takes_no_farther_one() -> None:
    """A fifth of a nanometre before the end of the strip, and behind another echo."""
    way = [(0.0, 0.0), (0.75, 0.0)]
    assert nearest(at((1.0 - 2e-10, 0.0)), way, 0.25, (0.0, 0.0)) == 1.0 - 2e-10
    assert nearest(at((0.5 + 1e-10, 0.0), (0.5, 0.0)), way, 0.25, (0.0, 0.0)) == 0.5


def test_a_way_whose_first_points_are_the_same_begins_there() -> None:
    """Nothing is behind a segment of no length."""
    way = [(0.0, 0.0), (0.0, 0.0), (1.0, 0.0)]
    assert nearest(at((-0.1, 0.0)), way, 0.2, (0.0, 0.0)) == pytest.approx(0.1)
    assert nearest(at((-0.1, 0.0)), way[1:], 0.2, (0.0, 0.0)) == math.inf


def test_a_point_or_nothing_is_no_way() -> None:
    assert nearest(at((0.1, 0.0)), [(0.0, 0.0)], 0.5, (0.0, 0.0)) == math.inf


# --- the rule ---------------------------------------------------------------------------------------------------------

AHEAD = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)])
START = Pose2D(0.0, 0.0, 0.0)


def echo(x: float, y: float) -> RangeScan:
    return scan([math.atan2(y, x)], [math.hypot(x, y)], [0.1])


def test_it_releases_a_delay_after_the_last_echo_again_and_again() -> None:
    rule = HandOverRule("when_blocked", release=0.4, keep=0.1, spread=0.0)
    for start in (1.0, 3.0):
        assert rule.step(start, [echo(0.7, 0.0)], START, AHEAD, 0.3).engaged
        assert rule.step(start + 0.3, [echo(0.7, 0.1)], START, AHEAD, 0.3).engaged
        assert rule.step(start + 0.5, [], START, AHEAD, 0.3).engaged
        assert rule.step(start + 0.69, [], START, AHEAD, 0.3).engaged
        assert not rule.step(start + 0.71, [], START, AHEAD, 0.3).engaged


def test_it_releases_at_the_delay() -> None:
    rule = HandOverRule("when_blocked", release=0.5, keep=0.1, spread=0.0)
    rule.step(1.0, [echo(0.7, 0.0)], START, AHEAD, 0.3)
    assert not rule.step(1.5, [], START, AHEAD, 0.3).engaged


def test_it_stays_engaged_while_the_straight_line_to_the_target_is_blocked() -> None:
    """(0.5, 0.5) is on the line to (1, 1), and 0.5 m beside the way round the corner."""
    rule = HandOverRule("when_blocked", release=0.4, keep=0.1, spread=0.0)
    assert not rule.step(0.0, [echo(0.5, 0.5)], START, AHEAD, 0.3).engaged
    assert rule.step(1.0, [echo(0.7, 0.0)], START, AHEAD, 0.3).engaged
    seen = rule.step(2.0, [echo(0.5, 0.5)], START, AHEAD, 0.3)
    assert seen.engaged and seen.nearest == math.inf
    assert rule.step(2.39, [], START, AHEAD, 0.3).engaged
    assert not rule.step(2.41, [], START, AHEAD, 0.3).engaged


def test_the_nearest_of_trajectory_and_own_way_is_told() -> None:
    own = np.array([(0.0, 0.0), (0.0, 1.0)])
    for places, distance in (([(0.7, 0.0), (0.0, 0.6)], 0.6), ([(0.5, 0.0), (0.0, 0.6)], 0.5), ([(0.0, 0.6)], 0.6)):
        rule = HandOverRule("when_blocked", release=0.4, spread=0.0)
        assert rule.step(0.0, [echo(*place) for place in places], START, AHEAD, 0.3, own).nearest == pytest.approx(
            distance
        )


def test_its_own_way_is_looked_at_without_the_margin_and_the_trajectory_with_it() -> None:
    own = np.array([(0.0, 0.0), (0.0, 1.0)])
    rule = HandOverRule("when_blocked", release=0.4, spread=0.0, margin=0.1)
    assert rule.step(0.0, [echo(-0.21, 0.6)], START, AHEAD, 0.3, own).nearest == math.inf
    assert rule.step(0.0, [echo(-0.19, 0.6)], START, AHEAD, 0.3, own).nearest == pytest.approx(math.hypot(0.19, 0.6))
    rule.reset()
    assert rule.step(0.0, [echo(0.6, -0.29)], START, AHEAD, 0.3, own).nearest == pytest.approx(math.hypot(0.6, 0.29))


def test_a_robot_that_does_not_drive_has_no_own_way() -> None:
    rule = HandOverRule("when_blocked", release=0.4, spread=0.0)
    assert rule.step(0.0, [echo(0.1, 0.6)], START, AHEAD, 0.3, NOWHERE).nearest == math.inf
    assert rule.step(0.0, [], START, AHEAD, 0.3).nearest == math.inf


@pytest.mark.parametrize("mode", ["when_blocked", "always"])
def test_reset_forgets_echoes_and_engagement(mode: str) -> None:
    rule = HandOverRule(mode, release=0.4, spread=0.0)  # type: ignore[arg-type]
    rule.step(1.0, [echo(0.7, 0.0)], START, AHEAD, 0.3)
    assert rule.engaged
    rule.reset()
    assert rule.engaged is (mode == "always")
    assert rule.step(1.1, [], START, AHEAD, 0.3).nearest == math.inf


def test_half_of_a_sonars_arc_counts_for_half_a_second_by_default() -> None:
    """An arc of 0.4 rad to each side of straight ahead, 1 m away: its counted ends are 0.2 m aside, not 0.39 m."""
    rule = HandOverRule("when_blocked", release=0.1)
    arc = scan([0.0], [1.0], [0.4])
    left = np.array([(0.0, math.sin(0.2)), (2.0, math.sin(0.2))])
    assert math.isfinite(rule.step(0.0, [arc], START, left, 0.01).nearest)
    assert math.isfinite(rule.step(0.5, [], START, left, 0.01).nearest)
    assert rule.step(0.51, [], START, left, 0.01).nearest == math.inf
    assert rule.margin == 0.0


# --- the robot's own way ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("turn", [0.4, -0.4])
def test_the_own_way_is_an_arc_from_the_robot(turn: float) -> None:
    """0.5 m in 1 s on a circle of 1.25 m: six points 0.1 m apart, in a map where the robot is turned."""
    way = own_way(BASE, Twist2D(0.5, 0.0, turn), 5.0)
    angles = np.linspace(0.0, turn, 6)
    x, y = 0.5 / turn * np.sin(angles), 0.5 / turn * (1.0 - np.cos(angles))
    assert way == pytest.approx(np.stack([1.3 + 0.8 * x - 0.6 * y, -0.7 + 0.6 * x + 0.8 * y], axis=1))


@pytest.mark.parametrize(
    ("twist", "reach", "length", "points"),
    [
        ((0.5, 0.0), 0.33, 0.33, 5),  # its reach: four steps of at most 0.1 m
        ((0.73, 0.0), 5.0, 0.73, 9),  # one second
        ((0.05, 0.0), 5.0, 0.05, 2),
        ((0.1, 0.0), 5.0, 0.1, 2),
        ((0.2, 0.0), 5.0, 0.2, 3),
    ],
)
def test_the_own_way_ends_after_a_second_or_its_reach(
    twist: tuple[float, float], reach: float, length: float, points: int
) -> None:
    way = own_way(START, Twist2D(twist[0], 0.0, twist[1]), reach)
    assert way == pytest.approx(np.stack([np.linspace(0.0, length, points), np.zeros(points)], axis=1))


@pytest.mark.parametrize("turn", [2.0, -2.0])
def test_the_own_way_ends_after_a_quarter_turn(turn: float) -> None:
    """At 0.4 m/s and 2 rad/s a circle of 0.2 m: 0.314 m, in four steps."""
    way = own_way(START, Twist2D(0.4, 0.0, turn), 5.0)
    assert len(way) == 5
    assert way[-1] == pytest.approx((0.2, math.copysign(0.2, turn)))
    assert way[2] == pytest.approx(
        (0.2 * math.sin(math.pi / 4), math.copysign(0.2 * (1 - math.cos(math.pi / 4)), turn))
    )


def test_a_turn_of_less_than_a_quarter_is_not_cut() -> None:
    """1.5 rad in a second is less than a quarter turn, 1.5708 rad."""
    assert own_way(START, Twist2D(0.4, 0.0, 1.5), 5.0)[-1] == pytest.approx(
        (0.4 / 1.5 * math.sin(1.5), 0.4 / 1.5 * (1.0 - math.cos(1.5)))
    )


# --- echoes near a pose -----------------------------------------------------------------------------------------------


def test_echoes_near_a_pose_are_in_its_frame_oldest_first() -> None:
    """Seen from the base at 0.9 m ahead and 1.1 m to the left; from 0.5 m farther on, turned left: (1.1, 0.5) and
    (0, -0.4)."""
    made = memory(scan([NORTH, 0.0], [1.1, 0.9]))
    there = Pose2D(1.3 + 0.5 * 0.8, -0.7 + 0.5 * 0.6, RISING + NORTH)
    found = made.near(there, 9.0, 2.0)
    assert found == pytest.approx(np.array([(1.1, 0.5), (0.0, -0.4)]), abs=1e-9)


@pytest.mark.parametrize(("reach", "count"), [(0.39, 0), (0.41, 1), (1.2, 1), (1.21, 2)])
def test_echoes_near_a_pose_are_within_reach(reach: float, count: int) -> None:
    """0.4 m and hypot(1.1, 0.5) = 1.208 m away."""
    made = memory(scan([NORTH, 0.0], [1.1, 0.9]))
    assert len(made.near(Pose2D(1.3 + 0.5 * 0.8, -0.7 + 0.5 * 0.6, 0.3), reach, 2.0)) == count


def test_echoes_near_a_pose_count_for_as_long_as_others() -> None:
    made = memory(scan([0.0], [0.9]))
    made.add(scan([NORTH], [1.1]), BASE, 2.3)
    assert [len(made.near(BASE, 9.0, time)) for time in (2.5, 2.51, 2.8, 2.81)] == [2, 1, 1, 0]
    assert made.near(BASE, 9.0, 2.51)[0] == pytest.approx((0.0, 1.1), abs=1e-9)
    made.clear()
    assert made.near(BASE, 9.0, 2.3).shape == (0, 2)

"""Echoes of the monitor: where beams end, which readings make a surface, and which points of a sonar's arc count."""

from __future__ import annotations

import math

import numpy as np
import pytest
from navloom.navigation.monitor_echoes import (
    arc_points,
    covered,
    directions,
    nearest_surfaces,
    out_of_view,
    to_odometry,
)
from numpy.typing import NDArray

Floats = NDArray[np.float64]

EAST, NORTH = 0.0, 0.5 * math.pi
RISING = math.atan2(0.6, 0.8)
"""A direction of cosine 0.8 and sine 0.6."""

# --- lasers -----------------------------------------------------------------------------------------------------------


def test_each_beam_begins_at_its_own_origin_and_pose() -> None:
    """The first beam looks north of a base that looks east, the second along the axis of a base that is turned."""
    poses = np.array([(1.3, -0.7, EAST), (2.1, 0.4, RISING), (0.0, 0.0, 0.0), (-0.2, -0.3, NORTH)])
    origins = np.array([(0.25, -0.15), (0.3, 0.1), (0.0, 0.0), (0.05, 0.45)])
    points = np.full((4, 2), 7.0)
    to_odometry(poses, origins, np.array([NORTH, EAST, 0.1, -RISING]), np.array([1.7, 0.9, 4.0, 1.5]), 4.0, points)
    # (0.25, 1.55) in the first base; (1.2, 0.1) in the second; (1.25, -0.45) in the last, which is turned by 90°.
    assert points[0] == pytest.approx((1.55, 0.85))
    assert points[1] == pytest.approx((2.1 + 0.8 * 1.2 - 0.6 * 0.1, 0.4 + 0.6 * 1.2 + 0.8 * 0.1))
    assert points[3] == pytest.approx((0.25, 0.95))
    assert np.isnan(points[2]).all(), "a reading of range_max is no echo"


def test_a_reading_that_is_no_number_is_no_echo() -> None:
    points = np.zeros((1, 2))
    to_odometry(np.zeros((1, 3)), np.zeros((1, 2)), np.zeros(1), np.array([math.nan]), 4.0, points)
    assert np.isnan(points).all()


EYE = (0.5, -0.25)
"""Place of the sensor, m."""


def polar(distance: float, bearing_deg: float) -> tuple[float, float]:
    """A place seen from the sensor, m."""
    angle = math.radians(bearing_deg)
    return EYE[0] + distance * math.cos(angle), EYE[1] + distance * math.sin(angle)


def surfaces(points: list[tuple[float, float]], agreement: float = 0.1, bins: int = 36) -> Floats:
    """Surfaces in 36 directions of 10 degrees; the first begins at -180 degrees."""
    found = np.full((bins, 2), math.nan)
    count = nearest_surfaces(np.array(points).reshape(-1, 2), *EYE, bins, agreement, found)
    assert np.isnan(found[count:]).all()
    return found[:count]


def test_a_surface_is_the_mean_of_the_readings_that_agree() -> None:
    near, far = polar(1.5, 43.0), polar(1.56, 47.0)
    mean = ((near[0] + far[0]) / 2, (near[1] + far[1]) / 2)
    assert surfaces([far, near]) == pytest.approx(np.array([mean]))


def test_one_reading_alone_is_no_surface() -> None:
    assert len(surfaces([polar(1.5, 43.0), polar(1.8, 44.0), polar(1.5, -43.0), (math.nan, math.nan)])) == 0
    assert len(surfaces([])) == 0


def test_readings_of_neighbouring_directions_agree_and_of_the_next_ones_do_not() -> None:
    """Each of the two directions has the mean of both."""
    first, second = polar(1.5, 45.0), polar(1.5, 55.0)
    mean = ((first[0] + second[0]) / 2, (first[1] + second[1]) / 2)
    assert surfaces([first, second]) == pytest.approx(np.array([mean, mean]))
    assert len(surfaces([polar(1.5, 45.0), polar(1.5, 65.0)])) == 0


@pytest.mark.parametrize(("first", "second"), [(179.0, -179.0), (-179.0, 179.0), (180.0, 175.0), (180.0, -175.0)])
def test_directions_close_at_180_degrees(first: float, second: float) -> None:
    a, b = polar(1.5, first), polar(1.5, second)
    assert surfaces([a, b])[0] == pytest.approx(((a[0] + b[0]) / 2, (a[1] + b[1]) / 2))


def test_straight_behind_belongs_to_the_first_direction() -> None:
    """-180 to -170 degrees: readings at -175 and, two directions on, at -155 do not agree; at -165 they do."""
    behind = (EYE[0] - 1.5, EYE[1])
    assert len(surfaces([behind, polar(1.5, -155.0)])) == 0
    assert len(surfaces([behind, polar(1.5, -165.0)])) == 2
    assert len(surfaces([behind, polar(1.5, 165.0)])) == 0


def test_surfaces_come_in_order_of_direction_from_behind_to_the_left() -> None:
    pairs = [polar(d, b) for b, d in ((172.0, 1.0), (-172.0, 2.0), (5.0, 3.0), (-95.0, 1.2)) for d in (d, d)]
    wanted = [polar(2.0, -172.0), polar(1.2, -95.0), polar(3.0, 5.0), polar(1.0, 172.0)]
    # Behind, the directions beside 180 degrees are neighbours: there the nearer of the two counts for both.
    wanted[0] = polar(1.0, 172.0)
    assert surfaces(pairs) == pytest.approx(np.array(wanted))


def test_the_nearest_reading_that_another_one_agrees_with_begins_the_surface() -> None:
    """0.7 m stands alone; 1.2 and 1.3 agree, and 1.35 is farther than 0.1 m behind 1.2."""
    points = [polar(d, 45.0) for d in (1.35, 1.3, 0.7, 1.2)]
    assert surfaces(points) == pytest.approx(np.array([polar(1.25, 45.0)]), abs=1e-9)


@pytest.mark.parametrize("aside", [-20.0, 20.0])
def test_a_reading_two_directions_aside_begins_no_surface(aside: float) -> None:
    """From 1.0 m on, 1.05 and 1.09 would agree; from 1.05 m on, 1.14 does too."""
    points = [polar(1.0, 45.0 + aside), *(polar(d, 45.0) for d in (1.05, 1.09, 1.14))]
    assert surfaces(points) == pytest.approx(np.array([polar((1.05 + 1.09 + 1.14) / 3, 45.0)]))


@pytest.mark.parametrize(("agreement", "count"), [(0.25, 1), (0.2499, 0)])
def test_readings_agree_up_to_and_with_the_limit(agreement: float, count: int) -> None:
    """Straight ahead, where distances are exact."""
    assert len(surfaces([(EYE[0] + 1.0, EYE[1]), (EYE[0] + 1.25, EYE[1])], agreement)) == count


def test_two_readings_of_the_same_distance_agree_though_a_nearer_one_was_tried() -> None:
    """0.5 m alone, and then 1.0 m twice: the search goes on beyond 0.5 m, and not beyond 1.0 m."""
    points = [(EYE[0] + d, EYE[1] + 0.0) for d in (1.0, 0.5, 1.0)]
    assert surfaces(points, 0.0) == pytest.approx(np.array([(EYE[0] + 1.0, EYE[1])]))


def test_a_reading_at_the_sensor_itself_counts() -> None:
    assert len(surfaces([EYE, EYE])) == 1


def test_twelve_readings_a_direction_count_and_no_older_one() -> None:
    """The newest twelve hold 1.0 m once: it stands alone; the thirteenth would agree with it."""
    points = [polar(2.0, 45.0)] * 11 + [polar(1.0, 45.0)] * 2
    assert surfaces(points) == pytest.approx(np.array([polar(2.0, 45.0)]))
    assert surfaces(points[1:]) == pytest.approx(np.array([polar(1.0, 45.0)]))


def test_a_sensor_sees_every_direction_once() -> None:
    points = [polar(1.5, 5.0 + 10.0 * k) for k in range(36)]
    assert surfaces(points * 2) == pytest.approx(surfaces(points))
    assert len(surfaces(points)) == 36


@pytest.mark.parametrize(
    ("bearings", "count"),
    [
        ([], 360), ([0.3], 360), ([0.3, 0.31], 628), ([0.31, 0.3], 628), ([0.0, 0.1, 0.2], 180), ([0.0, 1e-4], 1440),
        ([0.0, 0.005, 0.01, 0.9], 1257),
    ],
)  # fmt: skip
def test_a_laser_has_a_direction_for_each_beam(bearings: list[float], count: int) -> None:
    assert directions(np.array(bearings)) == count


def held(bearings: list[float], *places: tuple[float, float]) -> list[int]:
    """Which of the places at (distance, bearing in degrees) from the laser of a base that heads 0.3 rad stay."""
    points = [(*polar(d, b + math.degrees(0.3)), 0.001 * k) for k, (d, b) in enumerate(places)]
    kept = out_of_view(np.array(points).reshape(-1, 3), (*EYE, 0.3), covered(np.array(bearings), 36))
    found = [round(1000 * beyond) for beyond in kept[:, 2]]
    assert kept.tolist() == [list(points[k]) for k in found]
    return found


def test_what_a_beam_or_its_neighbours_cover_is_not_held() -> None:
    """A beam at 5 degrees covers -10 to 20 degrees, one at -175 degrees 170 to -160."""
    places = [(1.0, b) for b in (-11.0, -9.0, 19.0, 21.0, 169.0, 171.0, 179.0, -179.0, -161.0, -159.0)]
    assert held([math.radians(5.0), math.radians(-175.0)], *places) == [0, 3, 4, 9]


def test_the_nearest_in_each_direction_is_held_nearest_first() -> None:
    assert held([math.pi], (1.2, 5.0), (1.1, 6.0), (0.4, 55.0), (0.7, -5.0), (1.3, 7.0)) == [2, 3, 1]
    assert held([math.pi]) == []


def test_only_what_is_nearer_than_1_5_m_is_held() -> None:
    assert held([math.pi], (1.499, 5.0), (1.501, 25.0), (1.7, 45.0)) == [0]


# --- sonars -----------------------------------------------------------------------------------------------------------

HALF = 0.25
"""Half angle of a sonar's cone, rad."""
MAX = 4.0


def arcs(
    bearings: list[float],
    ranges: list[float],
    before: list[float] | None = None,
    origins: list[tuple[float, float]] | None = None,
    base: tuple[float, float, float] = (0.0, 0.0, 0.0),
    moved: float = 0.0,
    agreement: float = 0.125,
    halves: list[float] | None = None,
    rows: int = 512,
) -> Floats:
    """Points of a ring of sonars; they are given once before the call with NaN."""
    found = np.full((rows + 3, 2), math.nan)
    count = arc_points(
        np.array(base), np.array(origins or [(0.0, 0.0)] * len(ranges)), np.array(bearings),
        np.array(halves or [HALF] * len(ranges)), np.array(ranges),
        np.array(before or [math.nan] * len(ranges)), moved, np.array([MAX, agreement]), found[:rows],
    )  # fmt: skip
    assert np.isnan(found[count:]).all()
    return found[:count]


def test_an_arc_has_points_from_one_edge_of_the_cone_to_the_other_at_most_5_cm_apart() -> None:
    """An arc of 2 · 0.25 rad · 1.0 m = 0.5 m: eleven steps, twelve points."""
    points = arcs([0.3], [1.0], before=[1.0])
    angles = np.linspace(0.3 - HALF, 0.3 + HALF, 12)
    assert points == pytest.approx(np.stack([np.cos(angles), np.sin(angles)], axis=1))


@pytest.mark.parametrize(("half", "distance", "count"), [(0.25, 1.01, 13), (0.2, 1.74, 16), (0.0, 1.0, 2)])
def test_a_longer_arc_has_more_points(half: float, distance: float, count: int) -> None:
    assert len(arcs([0.3], [distance], before=[distance], halves=[half])) == count


def test_the_points_lie_in_the_odometry_frame_about_the_sonars_own_origin() -> None:
    """A cone of no width north of a sonar at (0.3, 0.1); the base is turned so that cos = 0.8, sin = 0.6."""
    points = arcs([NORTH], [1.4], before=[1.4], origins=[(0.3, 0.1)], base=(2.1, -0.4, RISING), halves=[0.0])
    x, y = 2.1 + 0.8 * 0.3 - 0.6 * 1.5, -0.4 + 0.6 * 0.3 + 0.8 * 1.5
    assert points == pytest.approx(np.array([(x, y), (x, y)]))


@pytest.mark.parametrize(
    ("now", "before", "moved", "counts"),
    [
        (1.0, 1.125, 0.0, True),
        (1.0, 0.875, 0.0, True),
        (1.0, 1.126, 0.0, False),
        (1.0, 0.874, 0.0, False),
        (1.0, 1.375, 0.25, True),  # the robot may have come 0.25 m nearer
        (1.0, 1.376, 0.25, False),
        (1.0, math.nan, 9.0, False),
        (1.0, math.inf, 9.0, False),
        (3.99, 3.99, 0.0, True),
        (4.0, 4.0, 0.0, False),  # a reading of range_max is no echo
        (math.inf, math.inf, 0.0, False),
        (math.nan, 1.0, 9.0, False),
    ],
)
def test_an_echo_counts_if_the_reading_before_agrees(now: float, before: float, moved: float, counts: bool) -> None:
    assert (len(arcs([0.3], [now], before=[before], moved=moved)) > 0) is counts


@pytest.mark.parametrize("order", [1, -1], ids=["next", "previous"])
@pytest.mark.parametrize(
    ("other", "gap", "counts"),
    [
        (1.125, 0.5, True),  # cones that touch overlap
        (1.126, 0.5, False),
        (0.875, 0.5, True),
        (0.874, 0.5, False),
        (1.0, 0.501, False),
        (4.0, 0.25, False),
        (math.inf, 0.25, False),
    ],
)
def test_an_echo_counts_if_a_neighbour_with_an_overlapping_cone_agrees(
    order: int, other: float, gap: float, counts: bool
) -> None:
    """Of a far beam at -2 rad, one at 0 with the reading of 1 m, one at the gap, each once first and once last."""
    points = arcs([-2.0, 0.0, gap][::order], [MAX, 1.0, other][::order])
    own = [
        x for x, y in points if math.isclose(math.hypot(x, y), 1.0, abs_tol=1e-9) and abs(math.atan2(y, x)) <= 0.2501
    ]
    assert (len(own) > 0) is counts


def test_the_width_of_both_cones_counts_for_their_overlap() -> None:
    assert len(arcs([0.0, 0.5], [1.0, 1.0], halves=[0.25, 0.3]))
    assert not len(arcs([0.0, 0.5], [1.0, 1.0], halves=[0.25, 0.2]))


def test_neighbours_agree_across_180_degrees() -> None:
    """-3.1 and 3.1 rad are 0.083 rad apart; -2.8 and 3.0 rad 0.483 rad, and -2.8 and 2.9 rad 0.583."""
    assert len(arcs([-3.1, 3.1], [1.0, 1.0]))
    assert len(arcs([-2.8, 3.0], [1.0, 1.0]))
    assert not len(arcs([-2.8, 2.9], [1.0, 1.0]))
    assert not len(arcs([0.0, math.pi], [1.0, 1.0]))


def test_the_angle_between_beams_is_the_smaller_of_two() -> None:
    """3.5 rad are 2.783 rad the other way round; 2.5 rad are 2.5 rad."""
    for gap, half, counts in ((3.5, 1.395, True), (3.5, 1.385, False), (2.5, 1.255, True), (2.5, 1.245, False)):
        for first, second in ((-gap / 2, gap / 2), (gap / 2, -gap / 2)):
            both = 2 * (math.ceil(2.0 * half / 0.05) + 2)
            assert len(arcs([first, second], [1.0, 1.0], halves=[half] * 2)) == (both if counts else 0)


def test_a_neighbour_without_an_echo_agrees_with_nothing() -> None:
    """A reading of range_max is none, however near."""
    assert not len(arcs([0.0, 0.1], [MAX - 0.0625, MAX]))


def test_only_the_beams_before_and_after_it_are_neighbours() -> None:
    assert not len(arcs([0.0, 2.0, 0.1], [1.0, MAX, 1.0]))
    assert not len(arcs([0.0, 2.0, 4.0, 0.1], [1.0, MAX, MAX, 1.0])), "the first and the last are none"


def test_what_a_beam_beside_it_reads_through_is_free() -> None:
    """The second cone, from 0.25 to 0.75 rad, reads 2 m: of the arc from -0.25 to 0.25 rad nothing else goes."""
    angles = np.linspace(-0.25, 0.25, 12)
    points = arcs([0.0, 0.375], [1.0, 2.0], before=[1.0, MAX])
    assert points == pytest.approx(np.stack([np.cos(angles), np.sin(angles)], axis=1)[angles < 0.125])


@pytest.mark.parametrize(("reading", "count"), [(1.125, 12), (1.1251, 0), (MAX, 0), (0.5, 12)])
def test_a_beam_reads_through_what_is_nearer_by_more_than_the_agreement(reading: float, count: int) -> None:
    """The second beam covers all of the first; what it reads itself is not confirmed, or its arc is counted off."""
    points = arcs([0.0, 0.0], [1.0, reading], before=[1.0, MAX], halves=[0.25, 0.3])
    assert sum(math.isclose(math.hypot(x, y), 1.0, abs_tol=1e-9) for x, y in points) == count


def test_a_beam_reads_through_from_its_own_origin() -> None:
    """A point at (1, 0) is 0.5 m before a sonar at (1, -0.5) that looks north, and not in the cone of one that looks
    south; a sonar at (0.6, 0.3) sees it in the direction (0.8, -0.6), 0.5 m away.
    """
    here = {"before": [1.0, MAX], "halves": [0.0, 0.01]}
    for origin, bearing, reading, is_free in (
        ((1.0, -0.5), NORTH, 0.7, True),
        ((1.0, -0.5), -NORTH, 0.7, False),
        ((0.0, 0.0), -0.01, 2.0, True),  # just at the edge of its cone
        ((0.0, 0.0), -0.011, 2.0, False),
        ((1.0, -0.5), NORTH, 0.6, False),
        ((0.6, 0.3), -RISING, 0.7, True),
        ((0.6, 0.3), RISING, 0.7, False),
        ((0.6, 0.3), -RISING, 0.6, False),
    ):
        points = arcs([0.0, bearing], [1.0, reading], origins=[(0.0, 0.0), origin], **here)  # type: ignore[arg-type]
        assert (len(points) == 0) is is_free, (origin, bearing, reading)


def test_a_beam_behind_reads_through_across_180_degrees() -> None:
    """The point straight behind is seen at 180 degrees, and the axes of both beams at -3.1 rad."""
    points = arcs([-3.1, -3.1], [1.0, 2.0], before=[1.0, MAX], halves=[0.0, 0.1])
    assert len(points) == 0
    behind = arcs([math.pi, -3.1], [1.0, 2.0], before=[1.0, MAX], halves=[0.0, 0.1])
    assert len(behind) == 0


def test_points_beyond_the_last_row_are_dropped() -> None:
    assert len(arcs([0.3], [1.0], before=[1.0], rows=5)) == 5

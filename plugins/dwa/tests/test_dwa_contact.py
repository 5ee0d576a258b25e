"""Contact along arcs: numbers that can be checked by hand, and brute force over positions of the footprint."""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from navloom_avoidance.clearance import footprint_edges, outside_distance
from navloom_dwa.contact import annulus, cosine_until, disc_contact, enlarged_corners, first_contacts, polygon_contact
from navloom_dwa.objective import arc_pose

SQUARE = np.array([[0.4, 0.4], [-0.4, 0.4], [-0.4, -0.4], [0.4, -0.4]])
EDGES = footprint_edges(SQUARE)
JACKAL = footprint_edges(np.array([[0.21, 0.165], [-0.21, 0.165], [-0.21, -0.165], [0.21, -0.165]]))
WEDGE = footprint_edges(np.array([[0.5, 0.0], [-0.2, 0.3], [-0.3, -0.1], [0.1, -0.35]]))


def test_straight_ahead_it_is_the_way_to_the_front_over_the_speed():
    """A point at 1.4 m, the front at 0.4 m, 0.5 m/s: 2 s; with a margin of 0.1 m 1.8 s."""
    assert polygon_contact(1.4, 0.3, EDGES, 0.0, 0.5, 0.0) == pytest.approx(2.0)
    assert polygon_contact(1.4, 0.3, EDGES, 0.1, 0.5, 0.0) == pytest.approx(1.8)
    assert polygon_contact(-1.4, 0.3, EDGES, 0.0, -0.5, 0.0) == pytest.approx(2.0)


def test_straight_past_a_point_beside_or_behind_there_is_none():
    assert polygon_contact(1.4, 0.41, EDGES, 0.0, 0.5, 0.0) == math.inf
    assert polygon_contact(-1.4, 0.3, EDGES, 0.0, 0.5, 0.0) == math.inf


def test_a_corner_swings_into_a_point_on_the_left():
    """The corner, 0.4 sqrt(2) m out at 45 deg, meets (0, 0.5) where its side does: cos t = 0.8, 36.87 deg to 53.13."""
    turn = polygon_contact(0.0, 0.5, EDGES, 0.0, 0.0, 1.0)
    assert turn == pytest.approx(math.acos(0.8))
    assert polygon_contact(0.0, 0.5, EDGES, 0.0, 0.0, 0.5) == pytest.approx(2.0 * math.acos(0.8))
    assert polygon_contact(0.0, 0.57, EDGES, 0.0, 0.0, 1.0) == math.inf  # beyond the corners at 0.566 m


def test_on_an_arc_round_a_point_beside_the_robot_nothing_is_met():
    """Centre of rotation (0, 1): the point is there and keeps its place in the robot's frame."""
    assert polygon_contact(0.0, 1.0, EDGES, 0.0, 0.5, 0.5) == math.inf


def test_on_an_arc_of_1_m_the_front_meets_a_point_a_quarter_turn_on():
    """Point on the base's own circle, 90 deg ahead. The front side is met where sin(a) = 0.4: 23.58 deg sooner."""
    found = polygon_contact(1.0, 1.0, EDGES, 0.0, 0.5, 0.5)
    assert found == pytest.approx((0.5 * math.pi - math.asin(0.4)) / 0.5)


def test_a_contact_beyond_the_largest_turn_is_left_out():
    """The corner meets (0, 0.5) after acos(0.8), 36.87 deg: within a turn of 37 deg, not of 36; 180 leave out none."""
    for turn, found in ((37.0, math.acos(0.8)), (36.0, math.inf), (180.0, math.acos(0.8))):
        limit = cosine_until(math.radians(turn))
        assert polygon_contact(0.0, 0.5, EDGES, 0.0, 0.0, 1.0, limit) == pytest.approx(found)
        assert polygon_contact(0.0, -0.5, EDGES, 0.0, 0.0, -1.0, limit) == pytest.approx(found)


def test_a_robot_that_turns_the_other_way_meets_the_mirrored_point():
    assert polygon_contact(0.9, 0.7, WEDGE, 0.02, 0.5, 0.4) != math.inf
    mirrored = np.array([[n[0], -n[1], n[2]] for n in WEDGE])
    assert polygon_contact(0.9, -0.7, mirrored, 0.02, 0.5, -0.4) == pytest.approx(
        polygon_contact(0.9, 0.7, WEDGE, 0.02, 0.5, 0.4)
    )


def test_a_disc_straight_ahead_and_on_an_arc():
    """Straight: 2 - 0.5 m at 1 m/s. Arc of 1 m: a quarter turn less the angle of a chord of 0.5 m, 2 asin(0.25)."""
    assert disc_contact(2.0, 0.0, 0.5, 1.0, 0.0) == pytest.approx(1.5)
    assert disc_contact(2.0, 0.3, 0.5, 1.0, 0.0) == pytest.approx(2.0 - 0.4)
    assert disc_contact(1.0, 1.0, 0.5, 1.0, 1.0) == pytest.approx(0.5 * math.pi - 2.0 * math.asin(0.25))
    assert disc_contact(-2.0, 0.0, 0.5, 1.0, 0.0) == math.inf
    assert disc_contact(2.0, 0.6, 0.5, 1.0, 0.0) == math.inf
    assert disc_contact(0.0, 0.6, 0.5, 0.0, 1.0) == math.inf
    assert disc_contact(0.3, 0.3, 0.5, 1.0, 0.0) == 0.0


speeds = st.tuples(st.floats(-1.5, 2.0), st.floats(-2.0, 2.0)).filter(lambda s: abs(s[0]) + abs(s[1]) > 0.2)
places = st.tuples(st.floats(-2.5, 2.5), st.floats(-2.5, 2.5))
BRUTE = 4000


def brute_force(x, y, v, w, distance_at, span):
    """First time within the span at which the distance is not positive, and how little it can have missed by."""
    for k in range(BRUTE + 1):
        px, py, turn = arc_pose(v, w, span * k / BRUTE)
        c, s = math.cos(turn), math.sin(turn)
        if distance_at((x - px) * c + (y - py) * s, (y - py) * c - (x - px) * s) <= 0.0:
            return span * k / BRUTE
    return math.inf


def agrees(exact, brute, v, w, span, distance_at, place):
    """Whether the exact time is that of brute force within a step, or the two differ by a touch of 2 mm only."""
    step = span / BRUTE
    if exact <= span and brute < math.inf:
        return abs(exact - brute) <= 1.5 * step or is_grazing(v, w, min(exact, brute), distance_at, place)
    if exact > span and brute == math.inf:
        return True
    return is_grazing(v, w, min(exact, brute), distance_at, place)


def is_grazing(v, w, time, distance_at, place):
    px, py, turn = arc_pose(v, w, time)
    c, s = math.cos(turn), math.sin(turn)
    dx, dy = place[0] - px, place[1] - py
    return abs(distance_at(dx * c + dy * s, dy * c - dx * s)) < 2.0e-3


@settings(max_examples=60)
@given(places, speeds, st.sampled_from([EDGES, JACKAL, WEDGE]), st.floats(0.0, 0.1))
def test_polygon_contact_is_that_of_brute_force(place, speed, edges, margin):
    (x, y), (v, w) = place, speed
    if outside_distance(edges, x, y) <= margin + 1.0e-3:
        return
    span = min(4.0, 6.0 / abs(w)) if w else 4.0

    def distance_at(bx, by):
        return outside_distance(edges, bx, by) - margin

    brute = brute_force(x, y, v, w, distance_at, span)
    assert agrees(polygon_contact(x, y, edges, margin, v, w), brute, v, w, span, distance_at, place)


@settings(max_examples=60)
@given(places, speeds, st.floats(0.1, 0.6))
def test_disc_contact_is_that_of_brute_force(place, speed, radius):
    (x, y), (v, w) = place, speed
    if math.hypot(x, y) <= radius + 1.0e-3:
        return
    span = min(4.0, 6.0 / abs(w)) if w else 4.0

    def distance_at(bx, by):
        return math.hypot(bx, by) - radius

    brute = brute_force(x, y, v, w, distance_at, span)
    assert agrees(disc_contact(x, y, radius, v, w), brute, v, w, span, distance_at, place)


def test_the_annulus_contains_everything_that_the_square_sweeps():
    """About (0, 1): nearest side at 0.6 m, farthest corner at hypot(0.4, 1.4) m."""
    near, far = annulus(SQUARE, EDGES, 0.0, 1.0)
    assert near == pytest.approx(0.6**2)
    assert far == pytest.approx(0.4**2 + 1.4**2)


def test_a_square_with_a_margin_is_a_greater_square_and_a_sharp_corner_moves_out_by_more():
    """Sides at 0.5 m. An equilateral triangle's corner moves out by twice the margin."""
    assert np.abs(enlarged_corners(EDGES, 0.1)) == pytest.approx(0.5)
    corners = np.array([[math.cos(a), math.sin(a)] for a in (0.0, 2.0 * math.pi / 3.0, 4.0 * math.pi / 3.0)])
    found = enlarged_corners(footprint_edges(corners), 0.1)
    assert np.hypot(found[:, 0], found[:, 1]) == pytest.approx(1.2)


@settings(max_examples=80)
@example([(1.0, 0.25), (1.0, 0.0)], True)  # the disc is met before the side that the points are sorted by
@given(st.lists(places, min_size=1, max_size=12), st.booleans())
def test_first_contacts_is_the_least_over_all_points(points, is_disc):
    """The rejections by annulus and by distance change nothing."""
    radius = 0.4 * math.sqrt(2.0)
    kept = [p for p in points if max(abs(p[0]), abs(p[1])) > 0.46]
    kept.sort(key=lambda p: outside_distance(EDGES, *p))
    gaps = np.array([outside_distance(EDGES, *p) for p in kept])
    obstacles = np.array([[*p, 0.05] for p in kept]).reshape(-1, 3)
    arcs = np.array([[math.cos(a), math.sin(a) / radius, 0.0, 1.0] for a in np.linspace(-1.57, 1.57, 9)])
    times = np.zeros(9)
    first_contacts(obstacles, gaps, enlarged_corners(EDGES, 0.05), EDGES, radius, is_disc, 0.05, arcs, 3.0, times)
    for arc, time in zip(arcs, times, strict=True):
        v, w = arc[0], arc[1]
        each = [
            disc_contact(x, y, radius + m, v, w) if is_disc else polygon_contact(x, y, EDGES, m, v, w)
            for x, y, m in obstacles
        ]
        least = min(each, default=math.inf)
        assert time == pytest.approx(least if least < 3.0 else math.inf)

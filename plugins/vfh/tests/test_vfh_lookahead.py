"""VFH*: projected places, the A* search, and that one step ahead is VFH+."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from navloom_vfh.costs import cheapest, primary_cost, projected_cost
from navloom_vfh.lookahead import COST, DEPTH, DIRECTION, ROOT, X, Y, candidates, deepest, look_ahead, projected_place

SECTORS, STEP, RADIUS, REACH, THRESHOLD, WIDEST = 72, 0.5, 0.45, 1.2, 0.3, 16
FIRST, LATER, DISCOUNT = (5.0, 2.0, 2.0), (5.0, 1.0, 1.0), 0.8
HERE = (0.0, 0.0, 0.0)


def openings(cells, place, target, circle=0.0):
    """Candidates at a place, as a new array."""
    directions = np.empty(3 * (SECTORS // 2 + 1))
    count = candidates(
        cells, place, target, circle, RADIUS, REACH, RADIUS, THRESHOLD, 3.0, WIDEST, np.empty(SECTORS),
        np.empty(SECTORS), np.empty((SECTORS // 2 + 1, 2), np.int64), directions,
    )  # fmt: skip
    return directions[:count]


def search(cells, target, depth, roots=None, circle=0.0, previous=0.0, limit=3000):
    nodes = np.zeros((limit, 10))
    roots = openings(cells, HERE, target, circle) if roots is None else np.asarray(roots, float)
    end, count, expanded = look_ahead(
        cells, roots, target, previous, FIRST, LATER, DISCOUNT, depth, STEP, circle, RADIUS, REACH, RADIUS, THRESHOLD,
        3.0, SECTORS, WIDEST, nodes,
    )  # fmt: skip
    return nodes[:count], end, expanded


def cells_of(*points):
    return np.array([[x, y, 15.0] for x, y in points]).reshape(-1, 3)


def u_of_cells(depth):
    """A dead end 2 m wide, 1 m ahead of the robot, of a given depth and open towards it; one cell every 0.1 m."""
    rows = [(x, side) for x in np.arange(1.0, 1.0 + depth, 0.1) for side in (-1.0, 1.0)]
    return cells_of(*rows, *((1.0 + depth, y) for y in np.arange(-1.0, 1.05, 0.1)))


def test_a_stopped_robot_turns_in_place_and_goes_straight():
    assert projected_place(HERE, math.radians(90.0), 0.5, 0.0) == pytest.approx((0.0, 0.5, math.radians(90.0)))


def test_a_quarter_circle_and_then_straight():
    """Radius 1 m to the left by 90 deg ends in (1, 1); 2 m less pi / 2 are left to go."""
    x, y, theta = projected_place(HERE, math.radians(90.0), 2.0, 1.0)
    assert (x, y, theta) == pytest.approx((1.0, 3.0 - 0.5 * math.pi, math.radians(90.0)))


def test_a_step_too_short_for_the_turn_ends_on_the_circle():
    """pi / 4 m on a circle of 1 m to the right: 45 deg of the 90."""
    x, y, theta = projected_place(HERE, math.radians(-90.0), 0.25 * math.pi, 1.0)
    s = math.sqrt(0.5)
    assert (x, y, theta) == pytest.approx((s, s - 1.0, math.radians(-45.0)))


@given(st.floats(-3.1, 3.1), st.floats(0.0, 2.0), st.floats(-3.1, 3.1))
def test_a_step_is_as_long_as_it_says(direction, circle, heading):
    """The straight distance never exceeds it, and is it where the robot need not turn."""
    x, y, _ = projected_place((1.0, 2.0, heading), direction, 0.5, circle)
    assert math.hypot(x - 1.0, y - 2.0) <= 0.5 + 1e-9
    x, y, _ = projected_place((1.0, 2.0, heading), heading, 0.5, circle)
    assert math.hypot(x - 1.0, y - 2.0) == pytest.approx(0.5)


Roots = st.lists(st.floats(-3.1, 3.1), min_size=1, max_size=8)


@settings(max_examples=60, deadline=None)
@given(Roots, st.floats(-3.1, 3.1), st.floats(-3.1, 3.1), st.floats(0.0, 1.0))
def test_one_step_ahead_is_vfh_plus(roots, bearing, previous, circle):
    target = (4.0 * math.cos(bearing), 4.0 * math.sin(bearing))
    nodes, end, expanded = search(cells_of((1.0, 0.3)), target, 1, roots, circle, previous)
    bearing = math.atan2(target[1], target[0])
    assert int(nodes[end, ROOT]) == cheapest(np.array(roots), len(roots), bearing, 0.0, previous, FIRST)
    assert expanded == 0


def cheapest_way(cells, target, depth, circle, previous):
    """Lowest cost over every path of the tree, without A*, and the number of paths."""
    best, ways = math.inf, 0

    def go_on(place, before, spent, i):
        nonlocal best, ways
        bearing = math.atan2(target[1] - place[1], target[0] - place[0])
        for c in openings(cells, place, target, circle):
            after = projected_place(place, c, STEP, circle)
            if i == 0:
                cost = primary_cost(c, bearing, place[2], before, FIRST)
            else:
                effective = math.atan2(after[1] - place[1], after[0] - place[0])
                cost = projected_cost(c, effective, bearing, place[2], before, LATER, DISCOUNT, i)
            if i == depth - 1 or math.dist(place[:2], target) <= STEP:
                best, ways = min(best, spent + cost), ways + 1
            else:
                go_on(after, c, spent + cost, i + 1)

    go_on(HERE, previous, 0.0, 0)
    return best, ways


@settings(max_examples=25, deadline=None)
@given(
    st.lists(st.tuples(st.floats(-0.5, 2.5), st.floats(-1.5, 1.5)), min_size=1, max_size=8),
    st.floats(-1.0, 1.0),
    st.sampled_from([0.0, 0.3]),
    st.sampled_from([2, 3]),
)
def test_a_star_finds_the_cheapest_of_all_ways(points, bearing, circle, depth):
    target = (3.0 * math.cos(bearing), 3.0 * math.sin(bearing))
    cells = cells_of(*points)
    best, ways = cheapest_way(cells, target, depth, circle, 0.0)
    nodes, end, _ = search(cells, target, depth, circle=circle)
    if ways:
        assert nodes[end, COST] == pytest.approx(best, abs=1e-9)
    else:
        assert end < 0 or nodes[end, DEPTH] < depth - 1


def test_a_dead_end_is_not_entered_when_its_end_is_seen():
    """On a turning circle of 0.4 m there is no way back out of it; straight ahead is the cheaper first step."""
    chosen = []
    for depth in (1, 5):
        nodes, end, _ = search(u_of_cells(1.5), (6.0, 0.0), depth, roots=[0.0, -1.2], circle=0.4)
        chosen.append(nodes[int(nodes[end, ROOT]), DIRECTION])
        assert int(nodes[end, DEPTH]) == depth - 1
    assert chosen == [0.0, -1.2]


def test_the_deepest_path_is_taken_where_none_is_complete():
    """Of two nodes of depth 1 the cheaper one; a cell all round each 0.8 m from the end of the first step closes it."""
    nodes = np.zeros((4, 10))
    nodes[:, DEPTH], nodes[:, COST] = (0, 1, 1, 0), (1.0, 5.0, 4.0, 0.5)
    assert deepest(nodes, 4) == 2
    ring = np.radians(np.arange(0.0, 360.0, 3.0))
    closed = cells_of(*np.column_stack((0.5 + 0.8 * np.cos(ring), 0.8 * np.sin(ring))))
    nodes, end, expanded = search(closed, (6.0, 0.0), 3, roots=[0.0])
    assert (end, expanded, len(nodes)) == (0, 1, 1)


def test_the_search_does_not_look_beyond_the_target():
    """The target is 0.8 m off: the second step begins within a step of it, and is the last."""
    nodes, end, _ = search(cells_of((2.5, 0.0)), (0.8, 0.0), 6)
    assert int(nodes[end, DEPTH]) == 1
    assert (nodes[end, X], nodes[end, Y]) == pytest.approx((1.0, 0.0))


def test_a_full_tree_gives_the_best_so_far():
    nodes, end, _ = search(u_of_cells(1.5), (6.0, 0.0), 12, limit=120)
    assert len(nodes) <= 120
    assert 0 <= int(nodes[end, ROOT]) < len(nodes)
    assert int(nodes[end, DEPTH]) < 11


def test_without_candidates_there_is_no_way():
    assert search(cells_of((1.0, 0.0)), (4.0, 0.0), 3, roots=[])[1] == -1


def test_a_sector_at_the_threshold_is_free_whatever_was_in_the_work_array():
    """A cell of full certainty half the reach away: 1 - 0.5^2 = 0.75."""
    density, blocked = np.empty(72), np.ones(72)
    slots, directions = np.empty((37, 2), np.int64), np.empty(111)
    count = candidates(
        np.array([[0.5, 0.0, 15.0]]), (0.0, 0.0, 0.0), (5.0, 0.0), 0.0, 0.4, 1.0, math.inf, 0.75, 3.0, 18, density,
        blocked, slots, directions,
    )  # fmt: skip
    assert (count, directions[0]) == (1, 0.0)

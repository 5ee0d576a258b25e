"""The memory of laser points, and the obstacles that the arcs use."""

import math

import numpy as np
import pytest
from navloom_avoidance.clearance import footprint_edges
from navloom_avoidance.points import is_superseded, nearest_beam, obstacles_in_base, remember

EDGES = footprint_edges(np.array([[0.4, 0.4], [-0.4, 0.4], [-0.4, -0.4], [0.4, -0.4]]))
BEARINGS = np.linspace(-1.0, 1.0, 21)
ORIGINS = np.zeros((21, 2))


def axes_of(bearings):
    return np.column_stack((np.cos(bearings), np.sin(bearings)))


class Memory:
    """A memory with the usual settings: 5 s, 4 m, squares of 3 cm."""

    def __init__(self):
        self.points, self.count = np.zeros((200, 3)), 0

    def scan(self, ranges, time=0.0, pose=(0.0, 0.0, 0.0), bearings=BEARINGS):
        self.count = remember(
            self.points, self.count, pose, ORIGINS, bearings, ranges, 8.0, time, 5.0, 4.0, 0.03, EDGES
        )
        return self.points[: self.count]


def only(beam, distance, others=math.inf):
    ranges = np.full(21, others)
    ranges[beam] = distance
    return ranges


def test_the_nearest_beam_is_found_between_the_ends_and_beyond_them():
    bearings = np.array([-1.0, 0.0, 0.4, 2.0])
    assert [nearest_beam(bearings, b) for b in (-2.0, -0.6, -0.4, 0.3, 1.1, 1.3, 3.0)] == [0, 0, 1, 2, 2, 3, 3]


def test_points_are_kept_where_they_were_seen_exactly():
    """Beam 10 is straight ahead: 1.234 m from (2, 1), looking along y."""
    found = Memory().scan(only(10, 1.234), pose=(2.0, 1.0, 0.5 * math.pi))
    np.testing.assert_allclose(found, [[2.0, 2.234, 0.0]], atol=1e-12)


def test_far_points_and_beams_without_an_echo_are_not_kept():
    assert len(Memory().scan(only(10, 4.5))) == 0
    assert len(Memory().scan(only(10, math.inf))) == 0


def test_a_point_that_a_beam_passes_is_forgotten():
    memory = Memory()
    memory.scan(only(10, 1.0))
    assert len(memory.scan(only(10, math.inf), time=0.1)) == 0


def test_a_new_point_replaces_the_old_one():
    memory = Memory()
    memory.scan(only(10, 1.0))
    found = memory.scan(only(10, 1.03), time=0.1)
    np.testing.assert_allclose(found, [[1.03, 0.0, 0.1]], atol=1e-12)


def test_a_point_hidden_by_a_nearer_one_is_kept():
    memory = Memory()
    memory.scan(only(10, 2.0))
    assert sorted(memory.scan(only(10, 1.0), time=0.1)[:, 0]) == pytest.approx([1.0, 2.0])


def test_a_point_out_of_view_is_kept_until_it_is_too_old():
    memory = Memory()
    memory.scan(only(10, 1.0))
    behind = (0.0, 0.0, math.pi)
    assert len(memory.scan(only(10, math.inf), time=4.9, pose=behind)) == 1
    assert len(memory.scan(only(10, math.inf), time=5.1, pose=behind)) == 0


def test_beams_that_pass_beside_a_point_do_not_forget_it():
    """At 2 m the beams are 0.2 m apart: a leg midway between two is 0.1 m from either."""
    origin = np.zeros((21, 2))
    x, y = 2.0 * math.cos(0.05), 2.0 * math.sin(0.05)
    assert not is_superseded(x, y, origin, BEARINGS, axes_of(BEARINGS), np.full(21, np.inf), 8.0)
    assert is_superseded(2.0, 0.04, origin, BEARINGS, axes_of(BEARINGS), np.full(21, np.inf), 8.0)
    assert not is_superseded(2.0, 0.04, origin, BEARINGS, axes_of(BEARINGS), np.full(21, 1.0), 8.0)
    assert not is_superseded(-2.0, 0.0, origin, BEARINGS, axes_of(BEARINGS), np.full(21, np.inf), 8.0)


def test_bearings_of_a_whole_turn_are_understood():
    """A laser with bearings from 0 to 2 pi sees an obstacle on its right at 3 pi / 2."""
    bearings = np.linspace(0.0, 2.0 * math.pi - 0.1, 63)
    ranges = np.full(63, np.inf)
    assert is_superseded(0.01, -1.0, np.zeros((63, 2)), bearings, axes_of(bearings), ranges, 8.0)


def test_points_deep_under_the_robot_are_forgotten():
    memory = Memory()
    memory.scan(only(10, 1.0))
    assert len(memory.scan(np.full(21, 0.0), time=0.1, pose=(0.9, 0.0, 0.0))) == 0
    memory.scan(only(10, 1.0))
    assert len(memory.scan(np.full(21, 0.0), time=0.1, pose=(0.58, 0.0, 0.0))) == 1


def test_of_older_points_in_one_square_one_is_kept():
    memory = Memory()
    memory.points[:4] = [[-2.0, 0.0, 0.0], [-2.005, 0.005, 0.0], [-2.01, 0.01, 0.0], [-2.1, 0.0, 0.0]]
    memory.count = 4
    assert len(memory.scan(np.full(21, math.inf), time=0.1)) == 2


def test_a_full_memory_drops_the_rest():
    memory = Memory()
    memory.points = np.zeros((5, 3))
    assert len(memory.scan(np.full(21, 1.0))) == 5


def test_obstacles_come_nearest_first_with_their_margins():
    obstacles, gaps = np.zeros((50, 3)), np.zeros(50)
    points = np.array([[2.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    cells = np.array([[-0.6, 0.0, 3.0], [1.5, 0.0, 3.0], [1.5, 0.1, 2.0], [0.9, 0.0, 2.0]])
    n = obstacles_in_base(points, cells, 0.95, (0.0, 0.0, 0.0), EDGES, (0.05, 0.12), 4.0, obstacles, gaps)
    np.testing.assert_allclose(gaps[:n], [0.2, 0.5, 0.6, 1.1, 1.6])
    np.testing.assert_allclose(obstacles[:n, 2], [0.12, 0.12, 0.05, 0.12, 0.05])
    np.testing.assert_allclose(obstacles[0, :2], [-0.6, 0.0])


def test_a_point_nearer_than_its_margin_has_its_distance_as_margin():
    obstacles, gaps = np.zeros((50, 3)), np.zeros(50)
    points = np.array([[0.43, 0.0, 0.0]])
    n = obstacles_in_base(points, np.zeros((0, 3)), 0.95, (0.0, 0.0, 0.0), EDGES, (0.05, 0.12), 4.0, obstacles, gaps)
    assert n == 1
    assert obstacles[0, 2] == pytest.approx(0.03, abs=2e-6)
    assert obstacles[0, 2] < gaps[0]

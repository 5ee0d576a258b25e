"""The memory of a laser's echo points."""

import math

import numpy as np
from navloom_avoidance.beams import Beams
from navloom_avoidance.clearance import footprint_edges
from navloom_avoidance.points import EchoMemory, points_in_base

EDGES = footprint_edges(np.array([[0.4, 0.4], [-0.4, 0.4], [-0.4, -0.4], [0.4, -0.4]]))
BEARINGS = np.linspace(-1.0, 1.0, 21)
ORIGIN = (0.0, 0.0, 0.0)


def beams(ranges, half_angles=0.0, bearings=BEARINGS):
    n = len(bearings)
    limits, sensors = np.tile([0.1, 8.0], (n, 1)), np.zeros(n, np.int64)
    return Beams.fixed(np.zeros((n, 2)), bearings, np.full(n, half_angles), np.asarray(ranges), limits, sensors)


def only(beam, distance):
    ranges = np.full(21, math.inf)
    ranges[beam] = distance
    return ranges


def test_an_echo_is_kept_where_it_was_seen():
    """Beam 10 is straight ahead: 1.234 m from (2, 1), looking along y."""
    memory = EchoMemory(EDGES, 5.0, 4.0)
    assert memory.enter(beams(only(10, 1.234)), (2.0, 1.0, 0.5 * math.pi), 3.0) is None
    np.testing.assert_allclose(memory.points, [[2.0, 2.234, 3.0]], atol=1e-12)


def test_a_point_is_forgotten_when_a_beam_passes_it_and_kept_when_none_looks():
    memory = EchoMemory(EDGES, 5.0, 4.0)
    memory.enter(beams(only(10, 1.0)), ORIGIN, 0.0)
    memory.enter(beams(np.full(21, math.inf)), (0.0, 0.0, math.pi), 0.1)
    assert len(memory.points) == 1
    memory.enter(beams(np.full(21, math.inf)), ORIGIN, 0.2)
    assert len(memory.points) == 0


def test_a_point_out_of_sight_is_forgotten_after_its_time():
    memory = EchoMemory(EDGES, 5.0, 4.0)
    memory.enter(beams(only(10, 1.0)), ORIGIN, 0.0)
    memory.enter(beams(np.full(21, math.inf)), (0.0, 0.0, math.pi), 5.1)
    assert len(memory.points) == 0


def test_the_beams_of_sonars_are_returned_and_give_no_points():
    memory = EchoMemory(EDGES, 5.0, 4.0)
    rest = memory.enter(beams(only(10, 1.0), half_angles=0.2), ORIGIN, 0.0)
    assert rest is not None
    assert rest.ranges.size == 21
    assert len(memory.points) == 0


def test_the_beam_spacing_does_not_depend_on_the_order_of_the_beams():
    memory = EchoMemory(EDGES, 5.0, 4.0)
    memory.enter(beams(np.full(21, math.inf), bearings=BEARINGS[::-1].copy()), ORIGIN, 0.0)
    assert math.isclose(memory.beam_spacing, 0.1)


def test_one_point_of_a_square_is_given_in_the_base_frame():
    """(0.99, 2.01) seen from (1, 1), looking along y, is 1.01 m ahead; the second is in its square."""
    points, cells = np.array([[0.99, 2.01, 0.0], [0.98, 2.02, 0.0], [9.0, 9.0, 0.0]]), np.zeros((5, 3))
    count = points_in_base(points, (1.0, 1.0, 0.5 * math.pi), 3.0, 0.05, 15.0, cells)
    np.testing.assert_allclose(cells[:count], [[1.01, 0.01, 15.0]], atol=1e-12)

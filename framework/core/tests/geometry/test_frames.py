import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from navloom.geometry.frames import compose, inverse, transform

MOTIONS = st.tuples(st.floats(-100, 100), st.floats(-100, 100), st.floats(-10, 10)).map(np.array)


def test_a_point_ahead_of_a_base_that_faces_up_lies_above_it() -> None:
    assert np.allclose(transform((1.0, 2.0, math.pi / 2), (3.0, 1.0)), (0.0, 5.0))


def test_a_sensor_on_the_base_is_placed_in_the_map() -> None:
    assert np.allclose(compose((1.0, 2.0, math.pi / 2), (3.0, 1.0, math.pi)), (0.0, 5.0, -math.pi / 2))


def test_many_motions_move_many_points() -> None:
    poses = np.array([(0.0, 0.0, 0.0), (1.0, 0.0, math.pi)])
    points = np.array([(1.0, 0.0), (0.0, 2.0), (0.0, 0.0)])
    moved = transform(poses, points)
    assert moved.shape == (2, 3, 2)
    assert np.allclose(moved[1], [(0.0, 0.0), (1.0, -2.0), (1.0, 0.0)])


@given(MOTIONS, MOTIONS)
def test_composing_is_moving_twice(base_to_map: np.ndarray, laser_to_base: np.ndarray) -> None:
    points = np.array([(0.3, -0.7), (2.0, 5.0)])
    twice = transform(base_to_map, transform(laser_to_base, points))
    assert np.allclose(transform(compose(base_to_map, laser_to_base), points), twice, atol=1e-9)


@given(MOTIONS)
def test_the_inverse_undoes_a_motion(base_to_map: np.ndarray) -> None:
    x, y, heading = compose(base_to_map, inverse(base_to_map))
    assert math.hypot(x, y) < 1e-9
    assert min(abs(heading), math.tau - abs(heading)) < 1e-9

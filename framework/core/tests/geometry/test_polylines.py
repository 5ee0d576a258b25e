import math

import numpy as np
import pytest
from navloom.geometry.polylines import Polyline, hausdorff_distance


def line(*points: tuple[float, float]) -> np.ndarray:
    return np.array(points, dtype=np.float64)


def test_points_along_a_line_are_where_its_corners_put_them() -> None:
    corner = Polyline(line((0, 0), (3, 0), (3, 0), (3, 4)))
    assert corner.length == 7.0 and corner.along.tolist() == [0.0, 3.0, 3.0, 7.0]
    places = corner.at(np.array([-1.0, 1.5, 3.0, 5.0, 9.0]))
    assert places.tolist() == [[0.0, 0.0], [1.5, 0.0], [3.0, 0.0], [3.0, 2.0], [3.0, 4.0]]
    assert Polyline(line((1, 2))).at(np.array([0.0, 1.0])).tolist() == [[1.0, 2.0]] * 2


def test_parallel_lines_are_as_far_apart_as_they_are() -> None:
    assert hausdorff_distance(line((0, 0), (10, 0)), line((0, 0.3), (10, 0.3))) == pytest.approx(0.3)


def test_the_farther_side_counts_whichever_polyline_it_is_of() -> None:
    # The short line is near everywhere; the end (10, 0) of the long one is 6 m from (4, 0).
    short, long = line((0, 0), (4, 0)), line((0, 0), (10, 0))
    assert hausdorff_distance(short, long) == hausdorff_distance(long, short) == pytest.approx(6.0)


def test_corners_do_not_matter_where_they_change_nothing() -> None:
    assert hausdorff_distance(line((0, 0), (1, 0), (1, 0), (7, 0)), line((0, 0), (7, 0))) == pytest.approx(0.0)


def test_a_roof_is_as_far_from_its_floor_as_it_is_high() -> None:
    roof, floor = line((0, 0), (2, 2), (4, 0)), line((0, 0), (4, 0))
    assert hausdorff_distance(floor, roof) == pytest.approx(2.0)


def test_single_points_are_as_far_as_points_are() -> None:
    assert hausdorff_distance(line((0, 0)), line((3, 4))) == pytest.approx(5.0)
    assert hausdorff_distance(line((0, 0)), line((0, 1), (0, 1))) == pytest.approx(1.0)


def test_a_quarter_circle_against_its_chord() -> None:
    # The arc of radius 1 is farthest from its chord in the middle: 1 - cos 45°.
    angles = np.linspace(0.0, 0.5 * math.pi, 200)
    arc = np.column_stack([np.cos(angles), np.sin(angles)])
    assert hausdorff_distance(arc, arc[[0, -1]]) == pytest.approx(1.0 - math.sqrt(0.5), abs=1e-4)

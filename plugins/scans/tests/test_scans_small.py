"""Small matrices, with the same rounding on every processor."""

import numpy as np
import pytest
from navloom_scans import small


@pytest.mark.parametrize("size", [2, 3])
@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e6])
def test_the_axes_are_those_of_lapack(size, scale):
    rng = np.random.default_rng(size)
    for _ in range(50):
        root = rng.standard_normal((size, size)) * np.geomspace(1.0, 1e-3, size)
        matrix = scale * root @ root.T
        values, ways = small.axes(matrix)
        assert values == pytest.approx(np.linalg.eigvalsh(matrix), rel=1e-9, abs=1e-14 * scale)
        assert ways @ ways.T == pytest.approx(np.eye(size), abs=1e-12)
        assert (ways * values) @ ways.T == pytest.approx(matrix, abs=1e-14 * scale * size)


@pytest.mark.parametrize("matrix", [np.zeros((3, 3)), np.eye(2), np.diag([3.0, -1.0, 2.0]), np.ones((3, 3))])
def test_axes_of_matrices_with_equal_or_no_values(matrix):
    values, ways = small.axes(matrix)
    assert (np.diff(values) >= 0.0).all()
    assert (ways * values) @ ways.T == pytest.approx(matrix, abs=1e-14)

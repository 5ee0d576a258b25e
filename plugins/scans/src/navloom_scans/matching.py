"""Fits a pose to beams in a distance field and to a prediction: robust Gauss-Newton on x, y and heading.

The cost is sum(rho(r_i)) / variance + (pose - predicted)' information (pose - predicted). r_i is the signed distance of
end point i to the wall on which it is seen. rho is that of Geman and McClure, solved by reweighting with the weight
1 / (1 + (r / scale)²)². The prediction determines what the beams cannot, such as the position along a bare corridor.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from navloom_scans.field import distance_field, sample

__all__ = ["fit_pose", "misfit_of", "solve", "warm_up"]

Floats = NDArray[np.float64]

_SMALL_STEP = 1e-4
"""Step below which iterations end, m and rad."""
_STEEP = 0.5
"""Least gradient of the field at the point where a beam enters a wall; at a plane face it is 1."""


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _misfit(values, frame, x, y, dx, dy, walk):  # type: ignore[no-untyped-def]
    """Signed distance from an end point x, y, m, to the wall seen by a beam of direction dx, dy, and its gradient.

    A beam sees the front face of a wall. If the field rises along the beam, the end point lies behind the middle of a
    wall. The front face, where the beam entered the wall, is then searched backwards along the beam.

    Returns:
        Distance, m; gradient along x and y; and whether there is such a wall.
    """
    distance, gx, gy, known = sample(values, frame, x, y)
    if not known or gx * dx + gy * dy <= 0.0:
        return distance, gx, gy, known
    last, was_in, back = distance, distance <= 0.0, 0.0
    while back < walk:
        back += frame[4]
        distance, gx, gy, known = sample(values, frame, x - back * dx, y - back * dy)
        if not known:
            break
        if was_in and distance > 0.0:
            length = math.hypot(gx, gy)
            facing = gx * dx + gy * dy
            if length < _STEEP or facing >= 0.0:
                break
            depth = back - frame[4] * distance / (distance - last)
            return depth * facing / length, gx / length, gy / length, True
        last, was_in = distance, distance <= 0.0
    return 0.0, 0.0, 0.0, False


@njit(cache=True, nogil=True, error_model="numpy")
def solve(matrix, right, solution):  # type: ignore[no-untyped-def]
    """Solve a symmetric positive definite system of three equations by Cholesky's method.

    Args:
        matrix: (3, 3). right: (3,). solution: (3,) filled.

    Returns:
        False if the matrix is not positive definite; the solution is then unchanged.
    """
    if not matrix[0, 0] > 0.0:
        return False
    l00 = math.sqrt(matrix[0, 0])
    l10, l20 = matrix[1, 0] / l00, matrix[2, 0] / l00
    d1 = matrix[1, 1] - l10 * l10
    # Written so that NaN ends it too.
    if not d1 > 0.0:
        return False
    l11 = math.sqrt(d1)
    l21 = (matrix[2, 1] - l20 * l10) / l11
    d2 = matrix[2, 2] - l20 * l20 - l21 * l21
    if not d2 > 0.0:
        return False
    l22 = math.sqrt(d2)
    y0 = right[0] / l00
    y1 = (right[1] - l10 * y0) / l11
    y2 = (right[2] - l20 * y0 - l21 * y1) / l22
    solution[2] = y2 / l22
    solution[1] = (y1 - l21 * solution[2]) / l11
    solution[0] = (y0 - l10 * solution[1] - l20 * solution[2]) / l00
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def _accumulate(values, frame, beams, pose, variance, scale, gate, walk, matrix, right):  # type: ignore[no-untyped-def]
    """Add J'WJ and -J'Wr of the beams at a pose to a matrix and a right side; returns how many are within the gate."""
    c, s, inliers, steepness = math.cos(pose[2]), math.sin(pose[2]), 0, 1.0 / (scale * scale)
    h00, h10, h11, h20, h21, h22, g0, g1, g2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(beams.shape[0]):
        rx, ry = c * beams[i, 0] - s * beams[i, 1], s * beams[i, 0] + c * beams[i, 1]
        dx, dy = c * beams[i, 2] - s * beams[i, 3], s * beams[i, 2] + c * beams[i, 3]
        r, gx, gy, known = _misfit(values, frame, pose[0] + rx, pose[1] + ry, dx, dy, walk)
        if not known:
            continue
        if abs(r) < gate:
            inliers += 1
        ratio = 1.0 + steepness * r * r
        weight = 1.0 / (variance * ratio * ratio)
        turn = gy * rx - gx * ry
        h00, h10, h11 = h00 + weight * gx * gx, h10 + weight * gx * gy, h11 + weight * gy * gy
        h20, h21, h22 = h20 + weight * turn * gx, h21 + weight * turn * gy, h22 + weight * turn * turn
        g0, g1, g2 = g0 - weight * r * gx, g1 - weight * r * gy, g2 - weight * r * turn
    matrix[0, 0], matrix[1, 1], matrix[2, 2] = matrix[0, 0] + h00, matrix[1, 1] + h11, matrix[2, 2] + h22
    matrix[1, 0], matrix[2, 0], matrix[2, 1] = matrix[1, 0] + h10, matrix[2, 0] + h20, matrix[2, 1] + h21
    matrix[0, 1], matrix[0, 2], matrix[1, 2] = matrix[1, 0], matrix[2, 0], matrix[2, 1]
    right[0], right[1], right[2] = right[0] + g0, right[1] + g1, right[2] + g2
    return inliers


@njit(cache=True, nogil=True, error_model="numpy")
def fit_pose(values, frame, beams, predicted, information, options, iterations, pose, fused):  # type: ignore[no-untyped-def]
    """Pose of least cost near the predicted one.

    Args:
        values, frame: Attributes of a `DistanceField`.
        beams: (n, 4) end point x, y, m, and unit direction of each beam, base frame.
        predicted: (3,) x, y, m, heading, rad, map frame: where the search starts.
        information: (3, 3) inverse covariance of the prediction, 1/m², 1/(m rad), 1/rad².
        options: (5,) variance of a distance, m²; first and last robust scale, m, halved in each step; largest distance
            of an inlier, m; longest search for the front of a wall, m.
        iterations: Largest number of steps.
        pose: (3,) filled: x, y, m, heading, rad, not wrapped, map frame.
        fused: (3, 3) filled: inverse covariance of the pose.

    Returns:
        Number of inliers in the last step; 0 if a step has no solution.
    """
    scale, inliers = options[1], 0
    right, step = np.empty(3), np.empty(3)
    pose[:] = predicted
    for _ in range(iterations):
        for i in range(3):
            right[i] = 0.0
            for k in range(3):
                fused[i, k] = information[i, k]
                right[i] -= information[i, k] * (pose[k] - predicted[k])
        inliers = _accumulate(values, frame, beams, pose, options[0], scale, options[3], options[4], fused, right)
        if not solve(fused, right, step):
            return 0
        for i in range(3):
            pose[i] += step[i]
        is_small = max(abs(step[0]), abs(step[1]), abs(step[2])) < _SMALL_STEP
        # A small step counts only at the last scale.
        if is_small and scale <= options[2]:
            break
        # From wide to narrow: at first far walls must attract, at the end outliers must not.
        scale = max(options[2], 0.5 * scale)
    return inliers


@njit(cache=True, nogil=True, error_model="numpy")
def misfit_of(values, frame, beams, pose, scale, walk):  # type: ignore[no-untyped-def]
    """Sum of rho(r_i) of the beams at a pose, m², see the module; a beam without a wall counts as one far off.

    Args:
        values, frame, beams, pose: As for `fit_pose`.
        scale: Robust scale, m. walk: Longest search for the front of a wall, m.
    """
    c, s, total, square = math.cos(pose[2]), math.sin(pose[2]), 0.0, scale * scale
    for i in range(beams.shape[0]):
        x, y = pose[0] + c * beams[i, 0] - s * beams[i, 1], pose[1] + s * beams[i, 0] + c * beams[i, 1]
        dx, dy = c * beams[i, 2] - s * beams[i, 3], s * beams[i, 2] + c * beams[i, 3]
        r, _, _, known = _misfit(values, frame, x, y, dx, dy, walk)
        total += square * r * r / (square + r * r) if known else square
    return total


def warm_up() -> None:
    """Compile the kernels for the array types that the tracker passes."""
    field = distance_field(np.eye(3, dtype=np.bool_), 0.1, (0.0, 0.0, 0.0), 1.0)
    beams = np.array([[0.1, 0.1, 1.0, 0.0]])
    options = np.array([1.0, 0.1, 0.1, 0.1, 0.1])
    fit_pose(field.values, field.frame, beams, np.zeros(3), np.eye(3), options, 1, np.empty(3), np.empty((3, 3)))
    misfit_of(field.values, field.frame, beams, np.zeros(3), 0.1, 0.1)

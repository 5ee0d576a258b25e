"""Products, inverses and axes of 3 x 3 matrices, with the same rounding on every processor.

numpy's come from OpenBLAS, whose kernels round differently with and without AVX-512: the traces of one run would differ
between two computers.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["axes", "inverse", "propagated", "sandwich", "warm_up"]

Floats = NDArray[np.float64]

_SWEEPS = 8
"""Sweeps of Jacobi's rotations: they converge quadratically, and 3 x 3 matrices need five at most."""


def propagated(
    covariance: Floats, frame: tuple[float, float], step: tuple[float, float], noise: tuple[float, float, float]
) -> Floats:
    """Covariance (3, 3) of a pose after a step: F P F' + R diag(noise) R'.

    Args:
        covariance: (3, 3) P of x, y, heading.
        frame: Cosine and sine of the heading before the step, which make R.
        step: x, y, m, in the frame of that pose; the derivative by the heading makes F.
        noise: Variances along, across and of the heading.
    """
    found: Floats = _propagated(covariance, *frame, *step, noise)
    return found


def inverse(matrix: Floats) -> Floats:
    """Inverse of a (3, 3) matrix; not finite if it is singular."""
    found: Floats = _inverse(matrix)
    return found


def sandwich(a: Floats, matrix: Floats) -> Floats:
    """The product a m a' of two (3, 3) matrices."""
    found: Floats = _sandwich(a, matrix)
    return found


def axes(matrix: Floats) -> tuple[Floats, Floats]:
    """Eigenvalues, (n,) ascending, and eigenvectors, (n, n) columns, of a symmetric (n, n) matrix."""
    values, ways = _axes(np.array(matrix, dtype=np.float64))
    order = np.argsort(values, kind="stable")
    return values[order], ways[:, order]


@njit(cache=True, nogil=True, error_model="numpy")
def _axes(m):  # type: ignore[no-untyped-def]
    """Jacobi's rotations (Golub and Van Loan, Matrix Computations, 8.5), in place."""
    ways = np.eye(len(m))
    for _ in range(_SWEEPS):
        for p in range(len(m)):
            for q in range(p + 1, len(m)):
                if m[p, q] == 0.0:
                    continue
                half = 0.5 * (m[q, q] - m[p, p])
                t = math.copysign(1.0, half) * m[p, q] / (abs(half) + math.hypot(half, m[p, q]))
                c = 1.0 / math.sqrt(1.0 + t * t)
                s = t * c
                for i in range(len(m)):
                    m[i, p], m[i, q] = c * m[i, p] - s * m[i, q], s * m[i, p] + c * m[i, q]
                    ways[i, p], ways[i, q] = c * ways[i, p] - s * ways[i, q], s * ways[i, p] + c * ways[i, q]
                for i in range(len(m)):
                    m[p, i], m[q, i] = c * m[p, i] - s * m[q, i], s * m[p, i] + c * m[q, i]
    return np.diag(m).copy(), ways


@njit(cache=True, nogil=True, error_model="numpy")
def _sandwich(a, m):  # type: ignore[no-untyped-def]
    left, found = np.zeros((3, 3)), np.zeros((3, 3))
    for i in range(3):
        for k in range(3):
            left[i, k] = a[i, 0] * m[0, k] + a[i, 1] * m[1, k] + a[i, 2] * m[2, k]
    for i in range(3):
        for k in range(3):
            found[i, k] = left[i, 0] * a[k, 0] + left[i, 1] * a[k, 1] + left[i, 2] * a[k, 2]
    return found


@njit(cache=True, nogil=True, error_model="numpy")
def _propagated(covariance, c, s, x, y, noise):  # type: ignore[no-untyped-def]
    moved, axes, variances = np.eye(3), np.eye(3), np.zeros((3, 3))
    moved[0, 2], moved[1, 2] = -s * x - c * y, c * x - s * y
    axes[0, 0], axes[0, 1], axes[1, 0], axes[1, 1] = c, -s, s, c
    variances[0, 0], variances[1, 1], variances[2, 2] = noise
    return _sandwich(moved, covariance) + _sandwich(axes, variances)


@njit(cache=True, nogil=True, error_model="numpy")
def _inverse(m):  # type: ignore[no-untyped-def]
    found = np.empty((3, 3))
    for i in range(3):
        for k in range(3):  # cofactor of row k, column i: with cyclic indices the sign is right
            r, s, t, u = (k + 1) % 3, (k + 2) % 3, (i + 1) % 3, (i + 2) % 3
            found[i, k] = m[r, t] * m[s, u] - m[r, u] * m[s, t]
    return found / (m[0, 0] * found[0, 0] + m[0, 1] * found[1, 0] + m[0, 2] * found[2, 0])


def warm_up() -> None:
    """Compile the functions."""
    covariance = propagated(np.eye(3), (1.0, 0.0), (0.0, 0.0), (1.0, 1.0, 1.0))
    axes(inverse(sandwich(np.eye(3), covariance)))

"""Constant-velocity Kalman filters of many bodies at once, and their assignment to what a scan shows.

The motion is the discretised white-noise acceleration model of Bar-Shalom, Li and Kirubarajan, "Estimation with
applications to tracking and navigation" (2001), section 6.2.2; the state is x, y, vx, vy.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

__all__ = ["assign", "measure", "predict", "rest"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SLACK = 0.15
"""Standard deviation that is added to a track's place for the gate, m: a body at rest may begin to move."""
GATE = 11.8
"""Largest squared Mahalanobis distance of a body from its track: 0.3 % of the true ones are beyond (chi², 2)."""
FARTHEST = 1.0
"""Largest distance of a body from the prediction, m, however unsure that is: beyond, it is another body."""
NEVER = 1e6
"""Cost of a pair that is not allowed; larger than any sum of allowed ones."""


def predict(means: Floats, covariances: Floats, time: float, acceleration: float) -> tuple[Floats, Floats]:
    """States (n, 4) and covariances (n, 4, 4) after a time, s; `acceleration`: standard deviation of it, m/s²."""
    step = np.eye(4)
    step[0, 2] = step[1, 3] = time
    strength = acceleration**2 * np.array([[time**4 / 4.0, time**3 / 2.0], [time**3 / 2.0, time**2]])
    noise = np.zeros((4, 4))
    noise[0::2, 0::2] = noise[1::2, 1::2] = strength
    return means @ step.T, step @ covariances @ step.T + noise


def measure(means: Floats, covariances: Floats, places: Floats, sigmas: Floats) -> tuple[Floats, Floats]:
    """States and covariances after positions (n, 2), m, were measured with standard deviations (n,), m."""
    return _update(means, covariances, places, sigmas, slice(0, 2))


def rest(means: Floats, covariances: Floats, sigma: float) -> tuple[Floats, Floats]:
    """States and covariances after a speed of 0 was measured, with this standard deviation, m/s."""
    return _update(means, covariances, np.zeros((len(means), 2)), np.full(len(means), sigma), slice(2, 4))


def _update(means: Floats, covariances: Floats, values: Floats, sigmas: Floats, part: slice) -> tuple[Floats, Floats]:
    innovation = covariances[:, part, part] + sigmas[:, None, None] ** 2 * np.eye(2)
    gain = covariances[:, :, part] @ np.linalg.inv(innovation)
    means = means + (gain @ (values - means[:, part])[:, :, None])[:, :, 0]
    covariances = covariances - gain @ covariances[:, part, :]
    return means, 0.5 * (covariances + covariances.transpose(0, 2, 1))


def assign(means: Floats, covariances: Floats, places: Floats, sigmas: Floats) -> tuple[Ints, Ints]:
    """Global nearest neighbour: rows of tracks and of bodies that belong together, within the gate.

    The cost of a pair is its negative log likelihood; an unassigned track costs as much as one at the gate.
    """
    if not len(means) or not len(places):
        return np.empty(0, np.int64), np.empty(0, np.int64)
    away = places[None] - means[:, None, :2]
    innovation = covariances[:, None, :2, :2] + ((sigmas**2 + SLACK**2)[:, None, None] * np.eye(2))[None]
    a, b, c = innovation[..., 0, 0], innovation[..., 0, 1], innovation[..., 1, 1]
    determinant = a * c - b * b
    x, y = away[..., 0], away[..., 1]
    distance = (c * x * x - 2.0 * b * x * y + a * y * y) / determinant
    allowed = (distance < GATE) & (x * x + y * y < FARTHEST**2)
    cost = np.where(allowed, distance + np.log(determinant), NEVER)
    rows, columns = linear_sum_assignment(cost)
    kept = allowed[rows, columns]
    return rows[kept], columns[kept]

"""Constant-velocity Kalman filters of many bodies at once, and their assignment to what a scan shows.

The motion is the discretised white-noise acceleration model of Bar-Shalom, Li and Kirubarajan, "Estimation with
applications to tracking and navigation" (2001), section 6.2.2; the state is x, y, vx, vy. Two of them, of a body that
goes on and of one that turns or brakes, are mixed as in its section 11.6.6 (interacting multiple models).
"""

from __future__ import annotations

import numpy as np
from navloom.geometry.frames import transform
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

__all__ = ["assign", "combined", "common_turn", "measure", "mixed", "moved", "predict", "rest"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SLACK = 0.15
"""Standard deviation that is added to a track's place for the gate, m: a body at rest may begin to move."""
GATE = 11.8
"""Largest squared Mahalanobis distance of a body from its track: 0.3 % of the true ones are beyond (chi², 2)."""
FARTHEST = 1.0
"""Largest distance of a body from the prediction, m, however unsure that is: beyond, it is another body."""
STEADY_FOR, TURNS_FOR = 3.0, 0.2
"""Mean time for which a body goes on as it went, and for which it turns, s."""
TURN_STEPS, OUTLIER = 3, 1.5
"""Steps of the fit of a common turn, and distance from where a body counts less, in standard deviations."""
NEVER = 1e6
"""Cost of a pair that is not allowed; larger than any sum of allowed ones."""


def predict(means: Floats, covariances: Floats, time: float, acceleration: float | Floats) -> tuple[Floats, Floats]:
    """States (..., 4) and covariances (..., 4, 4) after a time, s; `acceleration`: standard deviation of it, m/s²."""
    step, shape = np.eye(4), np.zeros((4, 4))
    step[0, 2] = step[1, 3] = time
    shape[0::2, 0::2] = shape[1::2, 1::2] = [[time**4 / 4.0, time**3 / 2.0], [time**3 / 2.0, time**2]]
    noise = np.asarray(acceleration)[..., None, None] ** 2 * shape
    return means @ step.T, step @ covariances @ step.T + noise


def measure(means: Floats, covariances: Floats, places: Floats, errors: Floats) -> tuple[Floats, Floats, Floats]:
    """States and covariances after positions (..., 2), m, were measured with covariances (..., 2, 2), m².

    Returns:
        (..., 4), (..., 4, 4), and the logarithm of the likelihood of each position, (...).
    """
    return _update(means, covariances, places, errors, slice(0, 2))


def rest(means: Floats, covariances: Floats, sigma: float) -> tuple[Floats, Floats]:
    """States and covariances after a speed of 0 was measured, with this standard deviation, m/s."""
    return _update(means, covariances, np.zeros(2), sigma**2 * np.eye(2), slice(2, 4))[:2]


def _update(
    means: Floats, covariances: Floats, values: Floats, errors: Floats, part: slice
) -> tuple[Floats, Floats, Floats]:
    innovation, off = covariances[..., part, part] + errors, values - means[..., part]
    a, b, c = innovation[..., 0, 0], innovation[..., 0, 1], innovation[..., 1, 1]
    determinant = a * c - b * b
    inverse = np.stack([c, -b, -b, a], -1).reshape(innovation.shape) / determinant[..., None, None]
    gain = covariances[..., :, part] @ inverse
    means = means + (gain @ off[..., None])[..., 0]
    covariances = covariances - gain @ covariances[..., part, :]
    distance = (off[..., None, :] @ inverse @ off[..., None])[..., 0, 0]
    return means, 0.5 * (covariances + np.swapaxes(covariances, -1, -2)), -0.5 * (distance + np.log(determinant))


def assign(means: Floats, covariances: Floats, places: Floats, errors: Floats) -> tuple[Ints, Ints]:
    """Global nearest neighbour: rows of tracks and of bodies, with covariances (n, 2, 2), m², that belong together.

    The cost of a pair is its negative log likelihood; an unassigned track costs as much as one at the gate.
    """
    if not len(means) or not len(places):
        return np.empty(0, np.int64), np.empty(0, np.int64)
    away = places[None] - means[:, None, :2]
    innovation = covariances[:, None, :2, :2] + (errors + SLACK**2 * np.eye(2))[None]
    a, b, c = innovation[..., 0, 0], innovation[..., 0, 1], innovation[..., 1, 1]
    determinant = a * c - b * b
    x, y = away[..., 0], away[..., 1]
    distance = (c * x * x - 2.0 * b * x * y + a * y * y) / determinant
    allowed = (distance < GATE) & (x * x + y * y < FARTHEST**2)
    cost = np.where(allowed, distance + np.log(determinant), NEVER)
    rows, columns = linear_sum_assignment(cost)
    kept = allowed[rows, columns]
    return rows[kept], columns[kept]


def moved(means: Floats, covariances: Floats, motion: Floats) -> tuple[Floats, Floats]:
    """States (n, 4) and covariances (n, 4, 4) in another frame.

    Args:
        means, covariances: x, y, m, vx, vy, m/s.
        motion: (3,) pose of their frame in the other one, m, rad.
    """
    turn = np.kron(np.eye(2), transform((0.0, 0.0, motion[2]), np.eye(2)).T)
    found = means @ turn.T
    found[:, :2] += motion[:2]
    return found, turn @ covariances @ turn.T


def common_turn(
    means: Floats, covariances: Floats, places: Floats, errors: Floats, eye: tuple[float, float], sigma: float
) -> float:
    """Angle about a sensor, rad, by which all that it measured must be turned to lie where it is expected.

    Bodies that turn or brake by themselves are outliers: beyond OUTLIER they count in proportion to 1 / distance (Huber
    1964), so that most bodies decide.

    Args:
        means, covariances: (n, 4) and (n, 4, 4) states of the bodies as expected now.
        places, errors: (n, 2) m, and (n, 2, 2) m², as measured.
        eye: Place of the sensor, m.
        sigma: Standard deviation of the angle, rad, before anything is seen.
    """
    (tx, ty), (ox, oy) = (eye[1] - places[:, 1], places[:, 0] - eye[0]), (means[:, :2] - places).T
    innovation = covariances[:, :2, :2] + errors
    a, b, c = innovation[:, 0, 0], innovation[:, 0, 1], innovation[:, 1, 1]
    determinant, angle = a * c - b * b, 0.0
    told = (c * tx * tx - 2.0 * b * tx * ty + a * ty * ty) / determinant
    wanted = (c * tx * ox - b * (tx * oy + ty * ox) + a * ty * oy) / determinant
    for _ in range(TURN_STEPS):
        x, y = ox - angle * tx, oy - angle * ty
        far = np.sqrt((c * x * x - 2.0 * b * x * y + a * y * y) / determinant)
        share = np.minimum(1.0, OUTLIER / np.maximum(far, 1e-9))
        angle = float((share * wanted).sum() / ((share * told).sum() + 1.0 / sigma**2))
    return angle


def mixed(chances: Floats, means: Floats, covariances: Floats, time: float) -> tuple[Floats, Floats, Floats]:
    """What each model begins a step with: IMM, step 1. Chances (n, 2) then, states (n, 2, 4), and covariances.

    Args:
        chances: (n, 2) of the models, that goes on and that turns. means, covariances: Their states.
        time: Since the last step, s.
    """
    turns, ends = 1.0 - np.exp(-time / STEADY_FOR), 1.0 - np.exp(-time / TURNS_FOR)
    from_to = chances[:, :, None] * np.array([[1.0 - turns, turns], [ends, 1.0 - ends]])
    after = np.maximum(from_to.sum(axis=1), 1e-9)
    share = (from_to / after[:, None]).transpose(0, 2, 1)  # of each model, whence
    begun = share @ means
    apart = means[:, None] - begun[:, :, None]
    spread = covariances[:, None] + apart[..., :, None] * apart[..., None, :]
    return after / after.sum(axis=1, keepdims=True), begun, (share[..., None, None] * spread).sum(axis=2)


def combined(chances: Floats, means: Floats, covariances: Floats) -> tuple[Floats, Floats]:
    """State (n, 4) and covariance (n, 4, 4) of both models together: IMM, step 5."""
    mean = (chances[:, None] @ means)[:, 0]
    apart = means - mean[:, None]
    spread = covariances + apart[..., :, None] * apart[..., None, :]
    return mean, (chances[..., None, None] * spread).sum(axis=1)

"""Two models of motion, mixed: one that goes on, and one that turns."""

from __future__ import annotations

import numpy as np
import pytest
from navloom_people_tracker.kalman import combined, measure, mixed, predict


def test_two_states_together_are_as_unsure_as_they_are_apart() -> None:
    """Halves at 0 and 2 m, each exact: the mean is 1 m and the variance 1 m²."""
    means = np.zeros((1, 2, 4))
    means[0, 1, 0] = 2.0
    mean, covariance = combined(np.array([[0.5, 0.5]]), means, np.zeros((1, 2, 4, 4)))
    assert mean[0].tolist() == [1.0, 0.0, 0.0, 0.0] and covariance[0, 0, 0] == 1.0


def test_chances_drift_to_how_long_each_lasts() -> None:
    """A body goes on for 3 s and turns for 0.2 s: after long, 3 / 3.2 of the chance is that it goes on."""
    chances, means, covariances = np.array([[0.1, 0.9]]), np.zeros((1, 2, 4)), np.zeros((1, 2, 4, 4))
    for _ in range(400):
        chances, means, covariances = mixed(chances, means, covariances, 0.01)
    assert chances[0, 0] == pytest.approx(3.0 / 3.2, abs=0.01)


def test_a_jump_makes_it_likely_that_a_body_turns() -> None:
    covariances = np.tile(1e-4 * np.eye(4), (1, 2, 1, 1))
    means, covariances = predict(np.zeros((1, 2, 4)), covariances, 0.1, np.array([1.0, 10.0]))
    _, _, likelihoods = measure(means, covariances, np.array([[[0.15, 0.0]]]), 4e-4 * np.eye(2))
    assert likelihoods[0, 1] > likelihoods[0, 0] + 3.0

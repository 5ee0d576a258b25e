"""KLD sample size and low-variance resampling."""

import math

import numpy as np
import pytest
from navloom_mcl.sampling import bins_of, kld_size, resampled, sample_size


@pytest.mark.parametrize(
    ("bins", "expected"),
    # 2 bins: 10 (1 - 2/9 + 0.4714 x 2.326)³ = 10 x 1.8743³ = 65.8. 11 bins: 100 (1 - 0.0222 + 0.1491 x 2.326)³ =
    # 100 x 1.3245³ = 232.4, where the exact quantile is 23.21 / 0.1 = 232.1. 101 bins: 1000 x 1.1075³ = 1358.3.
    [(0, 1), (1, 1), (2, 66), (11, 233), (101, 1359)],
)
def test_the_number_of_particles_grows_with_the_bins(bins, expected):
    assert kld_size(bins, 0.05, 2.326) == expected


def test_a_belief_in_one_bin_needs_the_least_and_a_wide_one_more():
    stream, weights = np.random.default_rng(0), np.full(5000, 1 / 5000)
    narrow = np.full((5000, 3), 0.1)
    wide = stream.uniform((0.0, 0.0, 0.0), (10.0, 10.0, 1.0), (5000, 3))
    sizes = []
    for particles in (narrow, wide):
        _, which = bins_of(particles, 0.5, 8)
        sizes.append(sample_size(weights, which, 0.3, 100, 10_000, 0.05, 2.326))
    # 20 x 20 x 2 bins, of which 8 in 10 lie in the first sector of 45 degrees: 799 / 0.1 x about 1.13.
    assert sizes[0] == 100
    assert 8000 < sizes[1] <= 10_000


def test_the_limit_holds():
    _, which = bins_of(np.random.default_rng(0).uniform(0.0, 50.0, (5000, 3)), 0.5, 8)
    assert sample_size(np.full(5000, 1 / 5000), which, 0.3, 100, 700, 0.05, 2.326) == 700


def test_each_particle_is_drawn_as_often_as_its_weight_says():
    weights = np.array([0.5, 0.25, 0.0, 0.2, 0.05])
    for first in (0.0, 0.3, 0.99):
        counts = np.bincount(resampled(weights, first, 40), minlength=5)
        # 40 times the weight, up to one more or less.
        assert counts.sum() == 40
        assert np.abs(counts - 40 * weights).max() <= 1.0
        assert counts[2] == 0


def test_a_bin_holds_a_square_and_a_sector():
    particles = np.array([[0.1, 0.1, 0.1], [0.4, 0.4, 0.7], [0.6, 0.1, 0.1], [0.1, -0.1, 0.1], [0.1, 0.1, -0.1]])
    bins, which = bins_of(particles, 0.5, 8)
    assert which[0] == which[1]
    assert len(set(which.tolist())) == len(bins) == 4
    assert bins[which].tolist() == [[0, 0, 0], [0, 0, 0], [1, 0, 0], [0, -1, 0], [0, 0, 7]]


def test_far_places_have_bins_of_their_own():
    bins, _ = bins_of(np.array([[1e5, 0.0, 0.0], [-1e5, 0.0, 0.0], [1e12, 0.0, math.pi]]), 0.5, 8)
    assert len(bins) == 3

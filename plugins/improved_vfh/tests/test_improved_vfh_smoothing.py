"""Less noise in the ranges of a laser."""

import math

import numpy as np
import pytest
from navloom_improved_vfh.smoothing import smoothed


def test_a_reading_is_averaged_with_the_two_on_either_side():
    """1.00 + 0.05 + 0.00 - 0.05 + 0.00 + ...: the middle one of five is their mean."""
    ranges = np.array([1.02, 1.0, 0.95, 1.0, 1.03])
    assert smoothed(ranges, 8.0, 0.1)[2] == pytest.approx(1.0)


def test_another_surface_and_no_echo_are_left_out():
    ranges = np.array([3.0, 1.0, 1.04, math.inf, 3.0])
    assert smoothed(ranges, 8.0, 0.1).tolist() == pytest.approx([3.0, 1.02, 1.02, math.inf, 3.0])


def test_a_wall_of_noisy_readings_comes_nearer_by_less_than_half():
    rng = np.random.default_rng(1)
    ranges = 1.0 + 0.03 * rng.standard_normal(361)
    assert 1.0 - smoothed(ranges, 8.0, 0.1).min() < 0.55 * (1.0 - ranges.min())

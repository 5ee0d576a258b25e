"""Smoothing of the ranges of a laser."""

import math

import numpy as np
import pytest
from navloom_avoidance.beams import Beams
from navloom_avoidance.robot import Robot
from navloom_avoidance.smoothing import smoothed
from navloom_improved_vfh.avoidance import Avoidance
from navloom_improved_vfh.params import ImprovedVfhParams


def test_a_reading_is_averaged_with_the_two_on_either_side():
    """1.00 + 0.05 + 0.00 - 0.05 + 0.00 + ...: the middle one of five is their mean."""
    ranges = np.array([1.02, 1.0, 0.95, 1.0, 1.03])
    assert smoothed(ranges, 8.0, 0.1)[2] == pytest.approx(1.0)


def test_another_surface_and_no_echo_are_left_out():
    ranges = np.array([3.0, 1.0, 1.04, math.inf, 3.0])
    assert smoothed(ranges, 8.0, 0.1).tolist() == pytest.approx([3.0, 1.02, 1.02, math.inf, 3.0])


def test_the_noise_of_a_wall_falls_to_less_than_half():
    """One over the root of five is 0.45."""
    ranges = 1.0 + 0.03 * np.random.default_rng(1).standard_normal(3610)
    assert smoothed(ranges, 8.0, 0.1).std() < 0.5 * ranges.std()


@pytest.mark.parametrize(
    ("half_angle", "margin", "radius", "cells"), [(0.0, 0.06, 0.43, (67, 0.05)), (0.26, 0.12, 0.45, (33, 0.1))]
)
def test_a_laser_needs_less_margin_and_smaller_cells_than_a_cone(half_angle, margin, radius, cells):
    square = np.array([[0.4, 0.4], [-0.4, 0.4], [-0.4, -0.4], [0.4, -0.4]])
    method = Avoidance(ImprovedVfhParams(), Robot(square, 0.5, 0.4, 0.5, 1.0), 0.05)
    limits, sensors = np.tile([0.3, 4.0], (2, 1)), np.zeros(2, np.int64)
    method.sense(Beams(np.zeros((2, 2)), np.zeros(2), np.full(2, half_angle), np.ones(2), limits, sensors), (0, 0, 0))
    assert (method.arc_margin, method.radius) == (margin, pytest.approx(radius))
    assert (len(method.grid), method.cell) == cells  # 3.3 m wide

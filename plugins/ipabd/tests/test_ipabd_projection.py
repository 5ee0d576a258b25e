"""Equation (1) and the rigid pitch, with numbers worked by hand."""

from __future__ import annotations

import numpy as np
import pytest
from navloom_ipabd.projection import paper_points, project, rigid_pitch_points


def test_eq_1_at_beta_40_and_alpha_30() -> None:
    # R = 2, α = 30°, β = 40°: paper's x = 2 cos30 cos40 = 1.32683 (to the right), y = 2 cos30 sin40 = 1.11334, z = 1
    points = paper_points(np.array([[2.0]]), np.radians([30.0]), np.radians([-50.0]))
    assert points[0, 0] == pytest.approx([1.113341, -1.326828, 1.0], abs=1e-6)


def test_rigid_pitch_at_the_same_beam() -> None:
    # b = -50°: R cos b = 1.285575; forward 1.285575 cos30 = 1.113341, left 2 sin(-50°) = -1.532089, up 0.642788
    points = rigid_pitch_points(np.array([[2.0]]), np.radians([30.0]), np.radians([-50.0]))
    assert points[0, 0] == pytest.approx([1.113341, -1.532089, 0.642788], abs=1e-6)


def test_eq_1_overstates_height_1_56_times_at_beta_40() -> None:
    args = (np.array([[3.0]]), np.radians([12.0]), np.radians([-50.0]))
    ratio = paper_points(*args)[0, 0, 2] / rigid_pitch_points(*args)[0, 0, 2]
    assert ratio == pytest.approx(1.5557, abs=1e-4)  # 1 / cos 50°


def test_both_agree_straight_ahead_and_differ_elsewhere() -> None:
    ranges, pitches = np.full((1, 2), 4.0), np.radians([20.0])
    bearings = np.radians([0.0, 30.0])
    gap = np.abs(paper_points(ranges, pitches, bearings) - rigid_pitch_points(ranges, pitches, bearings))[0]
    assert gap[0] == pytest.approx([0.0, 0.0, 0.0], abs=1e-12)
    assert gap[1, 2] == pytest.approx(4.0 * np.sin(np.radians(20.0)) * (1.0 - np.cos(np.radians(30.0))))


def test_each_frame_of_a_rigid_pitch_is_planar_and_of_eq_1_is_not() -> None:
    rng = np.random.default_rng(4)
    args = (rng.uniform(1.0, 9.0, (1, 101)), np.radians([15.0]), np.radians(np.arange(-50.0, 51.0)))
    normal = np.array([-np.sin(np.radians(15.0)), 0.0, np.cos(np.radians(15.0))])
    assert np.abs(rigid_pitch_points(*args)[0] @ normal).max() < 1e-12
    assert np.abs(paper_points(*args)[0] @ normal).max() > 0.1


def test_the_floor_is_first_seen_at_4_572_m(make_image) -> None:
    slant = 0.4 / np.sin(np.radians(5.0))
    assert slant == pytest.approx(4.589, abs=1e-3)
    points = project(make_image([slant], pitches_deg=[-5.0], bearings_deg=[0.0]))
    assert points[0, 0] == pytest.approx([4.572, 0.0, 0.0], abs=1e-3)


def test_the_mount_is_added(make_image) -> None:
    points = project(make_image([1.0], bearings_deg=[90.0], mount=(0.2, -0.1, 0.5)))
    assert points[0, 0] == pytest.approx([0.2, 0.9, 0.5])

"""Echoes as points, poses along a track, and cells at places, with numbers that can be checked by hand."""

import math

import numpy as np
import pytest
from navloom import OccupancyGrid, Pose2D, PoseTrack, RangeScan, Sweep
from navloom.geometry.cells import cells_at, has_cells, places_of
from navloom.geometry.echoes import poses_at, scan_points, scan_points_in_map, sweep_points, sweep_points_in_map

AT_REST = PoseTrack(np.array([0, 10**10]), np.array([[1.0, 2.0, 0.5 * math.pi]] * 2))


def scan(ranges, bearings, offsets=0.0):
    count = len(ranges)
    origins = np.full((count, 2), (0.2, 0.0))
    like = np.ones(count)
    return RangeScan(0, origins, np.array(bearings), 0.0 * like, offsets * like, np.array(ranges), 0.1, 9.0)


def test_beams_without_an_echo_are_left_out():
    points = scan_points(scan([1.0, np.inf, 2.0], [0.0, 0.3, 0.5 * math.pi]))
    np.testing.assert_allclose(points, [[1.2, 0.0], [0.2, 2.0]], atol=1e-12)


def test_each_beam_starts_where_the_robot_was_when_it_was_taken():
    track = PoseTrack(np.array([0, 10**9]), np.array([[0.0, 0.0, 0.0], [4.0, 0.0, 0.0]]))
    np.testing.assert_allclose(scan_points_in_map(scan([1.0], [0.0], offsets=0.5), track), [[3.2, 0.0]])
    np.testing.assert_allclose(scan_points_in_map(scan([np.inf], [0.0]), track), np.empty((0, 2)))


@pytest.mark.parametrize(
    ("geometry", "left", "up"), [("paper", 2.0 * 0.8 * 0.6, 2.0 * 0.6), ("rigid_pitch", 2.0 * 0.6, 2.0 * 0.8 * 0.6)]
)
def test_a_sweep_follows_the_equation_of_its_geometry(geometry, left, up):
    angle = math.asin(0.6)  # cosine 0.8
    ranges = np.array([[2.0, np.inf]])
    sweep = Sweep(
        0, 1, ranges, np.array([angle]), np.zeros(1), np.array([angle, 0.0]), geometry, 0.1, 0.0, 0.4, 0.1, 9.0
    )
    forward = 0.1 + 2.0 * 0.8 * 0.8
    np.testing.assert_allclose(sweep_points_in_map(sweep, AT_REST), [[1.0 - left, 2.0 + forward, 0.4 + up]])
    (echo, none), other = sweep_points(sweep)[0], {"paper": "rigid_pitch", "rigid_pitch": "paper"}[geometry]
    np.testing.assert_allclose(echo, [forward, left, 0.4 + up])
    assert np.isnan(none).all()
    assert not np.allclose(sweep_points(sweep, other)[0, 0], echo)


def test_between_two_poses_the_heading_turns_the_short_way_and_the_ends_are_kept():
    track = PoseTrack(np.array([0, 100]) + 10**18, np.array([[0.0, 0.0, 3.0], [2.0, 0.0, -3.0]]))
    poses = poses_at(track, np.array([-5, 50, 200]) + 10**18)
    np.testing.assert_allclose(poses[:, 0], [0.0, 1.0, 2.0])
    np.testing.assert_allclose(np.abs(poses[:, 2]), [3.0, math.pi, 3.0])
    with pytest.raises(ValueError, match="no pose"):
        poses_at(PoseTrack(np.empty(0, np.int64), np.empty((0, 3))), np.array([0]))


def test_cells_and_places_of_a_turned_grid():
    grid = OccupancyGrid(np.zeros((2, 3), np.int8), 0.5, Pose2D(1.0, 1.0, 0.5 * math.pi))  # its x axis is the map's y
    cells = cells_at(grid, [(0.9, 2.3), (0.2, 1.1), (1.1, 1.1)])
    assert cells.tolist() == [[0, 2], [1, 0], [-1, 0]]
    assert has_cells(grid, cells).tolist() == [True, True, False]
    np.testing.assert_allclose(places_of(grid, [(1, 0)]), [[0.25, 1.25]])

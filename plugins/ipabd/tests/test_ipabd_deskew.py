"""Continuous sweeps: the robot drives and turns while the laser pitches."""

from __future__ import annotations

import math

import numpy as np
import pytest
from navloom_ipabd.mapping import MapSettings, outline
from navloom_ipabd.pressure_numpy import points_in_reference, union
from navloom_ipabd.rules import Filters
from navloom_ipabd.track import frame_motion, poses_at

WALL = {"wall": ((-30.0, 30.0), (6.0, 6.4), (0.0, 2.4))}
MOUNT = (0.25, 0.0, 0.4)
STAMP_NS = 7_000_000_000
TRACK_TIMES = 0.05 * np.arange(27)  # 0 .. 1.3 s covers the sweep's 1.237 s


def driven(times: np.ndarray, speed: float = 0.5, rate_deg: float = 25.0) -> np.ndarray:
    """Poses on an arc from (0, 0, 80°): v = 0.5 m/s, ω = 25°/s, the limits of the paper's robot."""
    rate, heading = math.radians(rate_deg), math.radians(80.0)
    headings = heading + rate * times
    x = speed / rate * (np.sin(headings) - math.sin(heading))
    y = -speed / rate * (np.cos(headings) - math.cos(heading))
    return np.column_stack([x, y, headings])


@pytest.fixture(scope="module", params=["paper", "rigid_pitch"])
def driving_sweep(request, make_sweep):
    poses = driven(0.0133 * np.arange(94))
    return make_sweep(WALL, geometry=request.param, poses=poses, mount=MOUNT)


def motion_of(image, deskew: bool):
    stamps = STAMP_NS + np.round(TRACK_TIMES * 1e9).astype(np.int64)
    track = driven(TRACK_TIMES)
    return frame_motion(STAMP_NS, image.frame_times, MOUNT[:2], stamps, track, slack=0.0, deskew=deskew)


def wall_errors(image, deskew: bool) -> np.ndarray:
    """Distances of the ends of the segments from the wall's face y = 6, m."""
    segments = outline(image, motion_of(image, deskew), MapSettings()).segments
    return np.abs(segments[:, 1::2] - 6.0).ravel()


def test_a_deskewed_wall_is_straight_to_a_centimetre(driving_sweep) -> None:
    assert wall_errors(driving_sweep.image, deskew=True).max() < 0.01


def test_without_deskewing_the_wall_is_not_straight(driving_sweep) -> None:
    assert wall_errors(driving_sweep.image, deskew=False).max() > 0.5


def test_every_pixel_of_the_wall_comes_back(driving_sweep) -> None:
    image = driving_sweep.image
    motion = motion_of(image, deskew=True)
    _, y, heading = motion.reference
    points = points_in_reference(image, motion)[driving_sweep.hits == 0][:, :2] + MOUNT[:2]
    in_map_y = y + math.sin(heading) * points[:, 0] + math.cos(heading) * points[:, 1]
    assert np.abs(in_map_y - 6.0).max() < 0.002  # the rest is the interpolation of the track


def test_the_reference_is_the_pose_at_the_last_frame(driving_sweep) -> None:
    end = driven(np.array([93 * 0.0133]))[0]
    assert motion_of(driving_sweep.image, deskew=True).reference == pytest.approx(tuple(end), abs=1e-3)


def test_standing_sweeps_need_no_deskewing(paper_sweep) -> None:
    stamps, track = np.array([STAMP_NS]), np.array([[1.0, 2.0, 0.5]])
    times = paper_sweep.image.frame_times
    motion = frame_motion(STAMP_NS, times, MOUNT[:2], stamps, track, slack=2.0)
    assert motion.is_still
    assert motion.reference == (1.0, 2.0, 0.5)


def test_headings_are_interpolated_the_short_way_round() -> None:
    track = np.array([[0.0, 0.0, math.radians(179.0)], [2.0, 4.0, math.radians(-179.0)]])
    pose = poses_at(np.array([0.5]), np.array([0.0, 1.0]), track, slack=0.0)[0]
    assert pose[:2] == pytest.approx([1.0, 2.0])
    assert abs(math.degrees(pose[2])) == pytest.approx(180.0)


def test_union_of_a_moving_sweep_is_deskewed(driving_sweep) -> None:
    image = driving_sweep.image
    raw, moved = union(image, Filters()), union(image, Filters(), motion_of(image, deskew=True))
    assert raw.shape == moved.shape
    assert np.abs(raw - moved).max() > 0.5

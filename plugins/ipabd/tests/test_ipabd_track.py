"""Requirements on a track of poses, checked for short and for long tracks."""

import numpy as np
import pytest
from navloom_ipabd.errors import TrackError
from navloom_ipabd.track import FrameMotion, check_track, poses_at


@pytest.mark.parametrize("count", [3, 50])
def test_stamps_that_do_not_rise_are_refused(count):
    stamps = np.linspace(-1.0, 1.0, count)
    stamps[1] = stamps[2]
    with pytest.raises(TrackError, match="stamps that do not rise"):
        check_track(0.0, 0.0, stamps, np.zeros((count, 3)), 0.2)


@pytest.mark.parametrize("count", [3, 50])
@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_a_pose_that_is_not_finite_is_refused(count, wrong):
    poses = np.zeros((count, 3))
    poses[-1, 2] = wrong
    with pytest.raises(TrackError, match="poses that are not finite"):
        check_track(0.0, 0.0, np.linspace(-1.0, 1.0, count), poses, 0.2)


@pytest.mark.parametrize("count", [1, 3, 50])
def test_a_track_that_covers_the_scan_passes(count):
    check_track(0.0, 0.0, np.linspace(-0.1, 0.1, count), np.zeros((count, 3)), 0.2)


@pytest.mark.parametrize(
    ("shift", "turn", "is_still"), [(0.9e-6, 0.9e-7, True), (1.2e-6, 0.0, False), (0.0, 1.2e-7, False)]
)
def test_a_micrometre_and_a_ten_millionth_of_a_radian_are_rounding(shift, turn, is_still):
    motion = FrameMotion(np.array([[0.0, shift]]), np.array([turn]), (0.0, 0.0, 0.0))
    assert motion.is_still is is_still


def test_poses_are_interpolated_between_their_neighbours_in_any_order():
    """x = 0, 1, 4, 9 m at 0, 1, 2, 3 s: 2.5 m at 1.5 s, 6.5 m at 2.5 s, 0.5 m at 0.5 s."""
    poses = np.column_stack([[0.0, 1.0, 4.0, 9.0], np.zeros(4), np.zeros(4)])
    found = poses_at(np.array([1.5, 2.5, 0.5, 3.0]), np.arange(4.0), poses, 0.0)
    assert found[:, 0].tolist() == [2.5, 6.5, 0.5, 9.0]
    assert poses_at(np.array([1.5, -0.1]), np.arange(4.0), poses, 0.2)[:, 0].tolist() == [2.5, 0.0]

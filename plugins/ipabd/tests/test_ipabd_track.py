"""Requirements on a track of poses, checked for short and for long tracks."""

import numpy as np
import pytest
from navloom_ipabd.errors import TrackError
from navloom_ipabd.track import FrameMotion, check_track


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

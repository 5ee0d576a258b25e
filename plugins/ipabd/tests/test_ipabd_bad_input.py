"""Data that cannot be mapped is refused with a typed error: place, value and expectation."""

from __future__ import annotations

import math

import numpy as np
import pytest
from navloom_ipabd.errors import DataError, SettingError, SweepError, TrackError
from navloom_ipabd.rules import Filters
from navloom_ipabd.sweep import SweepImage
from navloom_ipabd.track import frame_motion, poses_at

NAN = math.nan


@pytest.mark.parametrize(
    ("place", "given", "changes"),
    [
        ("sweep.ranges[1, 2]", "nan", {"ranges": [[1.0, 2.0, 3.0], [1.0, 2.0, NAN]]}),
        ("sweep.ranges[0, 1]", "-0.5", {"ranges": [[1.0, -0.5, 3.0], [1.0, 2.0, 3.0]]}),
        ("sweep.ranges[1, 0]", "-inf", {"ranges": [[1.0, 2.0, 3.0], [-math.inf, 2.0, 3.0]]}),
        ("sweep.ranges", "shape (0, 3)", {"ranges": np.zeros((0, 3))}),
        ("sweep.ranges", "shape (2, 0)", {"ranges": np.zeros((2, 0))}),
        ("sweep.ranges", "shape (6,)", {"ranges": np.ones(6)}),
        ("sweep.ranges", "list", {"ranges": [[1.0], [1.0, 2.0]]}),
        ("sweep.pitches", "shape (3,)", {"pitches": np.zeros(3)}),
        ("sweep.pitches[1]", "nan", {"pitches": np.array([0.0, NAN])}),
        ("sweep.pitches", "1.6 rad", {"pitches": np.array([0.0, 1.6])}),
        ("sweep.frame_times", "shape (1,)", {"frame_times": np.zeros(1)}),
        ("sweep.frame_times[0]", "inf", {"frame_times": np.array([math.inf, 0.0])}),
        ("sweep.bearings", "shape (2, 3)", {"bearings": np.zeros((2, 3))}),
        ("sweep.bearings", "bearings that do not rise", {"bearings": np.array([0.0, 0.2, 0.1])}),
        ("sweep.range_min, range_max", "5, 2", {"range_min": 5.0, "range_max": 2.0}),
        ("sweep.mount", "(0.0, nan, 0.4)", {"mount": (0.0, NAN, 0.4)}),
        ("sweep.geometry", "'fisheye'", {"geometry": "fisheye"}),
    ],
)
def test_bad_sweeps(place: str, given: str, changes: dict) -> None:
    good: dict = {
        "ranges": np.ones((2, 3)),
        "pitches": np.zeros(2),
        "frame_times": np.zeros(2),
        "bearings": np.array([0.0, 0.1, 0.2]),
        "mount": (0.0, 0.0, 0.4),
        "range_min": 0.0,
        "range_max": 80.0,
    }
    SweepImage(**good)
    with pytest.raises(SweepError) as caught:
        SweepImage(**(good | changes))
    assert (caught.value.place, caught.value.given) == (place, given)
    assert str(caught.value) == f"{place}: got {given}, expected {caught.value.expected}"
    assert isinstance(caught.value, ValueError)


def track_error(stamps: list[float], poses: list[list[float]], slack: float = 0.1) -> TrackError:
    with pytest.raises(TrackError) as caught:
        poses_at(np.array([0.0, 1.0]), np.array(stamps), np.array(poses).reshape(-1, 3), slack)
    return caught.value


def test_bad_tracks() -> None:
    still = [0.0, 0.0, 0.0]
    assert track_error([], []).given == "0 stamps and poses of shape (0, 3)"
    assert track_error([0.0, 1.0], [still]).place == "track"
    assert track_error([0.5, 0.5, 1.0], [still] * 3).given.startswith("stamps that do not rise")
    assert track_error([0.0, 1.0], [still, [NAN, 0.0, 0.0]]).given.endswith("not finite")
    late = track_error([0.0, 0.8], [still] * 2)
    assert late.given == "a track from 0.000 to 0.800 s after the stamp"
    assert late.expected == "one that covers 0.000 to 1.000 s, within 0.1 s"


def test_a_track_may_miss_the_ends_by_the_slack() -> None:
    poses = np.array([[0.0, 0.0, 0.0], [8.0, 0.0, 0.0]])
    got = poses_at(np.array([0.0, 0.5, 1.0]), np.array([0.1, 0.9]), poses, 0.1 + 1e-9)
    assert got[:, 0] == pytest.approx([0.0, 4.0, 8.0])


def test_stamps_keep_their_nanoseconds() -> None:
    stamp = 1_700_000_000_000_000_001  # a float64 of this is wrong by 128 ns and more
    poses = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    stamps = np.array([stamp, stamp + 1000])
    motion = frame_motion(stamp, np.array([250e-9]), (0.0, 0.0), stamps, poses, slack=0.0)
    assert motion.reference[0] == pytest.approx(0.25, abs=1e-9)


@pytest.mark.parametrize(
    "changes",
    [{"z_limit": 0.05}, {"floor_tolerance": -0.1}, {"order": "after"}, {"min_range": -1.0}, {"z_limit": NAN}],
)
def test_bad_filters(changes: dict) -> None:
    with pytest.raises(SettingError) as caught:
        Filters(**changes)
    assert isinstance(caught.value, DataError)

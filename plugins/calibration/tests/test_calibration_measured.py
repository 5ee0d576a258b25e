"""How late a laser is and how its mount is turned, from drives whose truth is known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from calibration_drives import PLACE, STRAIGHT, recorded
from navloom_calibration.measured import measure


@pytest.mark.parametrize("late", [0.0, 0.12])
def test_late_scans_are_measured_within_10_ms_whatever_the_track_width_of_the_odometry(late: float) -> None:
    scans, way = recorded(40.0, late=late, scale=1.1)
    found = measure(scans, way, PLACE)
    assert found.offset is not None
    assert found.offset.offset.value == pytest.approx(-late, abs=0.01)
    assert found.offset.offset.low < -late < found.offset.offset.high
    assert 1.0 / found.offset.scale.value == pytest.approx(1.1, abs=0.01)
    assert found.offset.scale.low < 1.0 / 1.1 < found.offset.scale.high
    assert ("those of the measurement" in found.meaning) == (late == 0.0)


def test_a_stamp_at_the_end_of_the_sweep_is_told_as_such() -> None:
    scans, way = recorded(40.0, late=0.09, sweep=0.09)
    found = measure(scans, way, PLACE)
    assert found.offset is not None and found.offset.offset.value == pytest.approx(-0.09, abs=0.01)
    assert "the duration of its sweep, 0.090 s: the driver stamps the end" in found.meaning


def test_beams_with_times_of_their_own_are_not_late() -> None:
    scans, way = recorded(40.0, sweep=0.09)
    found = measure(scans, way, PLACE)
    assert found.offset is not None and found.offset.offset.value == pytest.approx(0.0, abs=0.01)


def test_beams_whose_times_the_driver_did_not_reverse_are_told_and_do_not_mislead() -> None:
    scans, way = recorded(40.0, late=0.12, sweep=0.09)
    wrong = [scan._replace(time_offsets=scan.time_offsets[::-1].copy()) for scan in scans]
    found = measure(wrong, way, PLACE)
    assert found.offset is not None and found.offset.offset.value == pytest.approx(-0.12, abs=0.01)
    assert found.order == -1.0 and "its beams seem to be in the other order" in found.meaning


@pytest.mark.parametrize("yaw_deg", [0.0, -3.0])
def test_the_yaw_of_the_mount_is_measured_on_straight_ways(yaw_deg: float) -> None:
    scans, way = recorded(40.0, late=0.05, yaw=math.radians(yaw_deg))
    found = measure(scans, way, PLACE)
    assert found.yaw is not None
    assert math.degrees(found.yaw.yaw.value) == pytest.approx(yaw_deg, abs=0.7)
    assert math.degrees(found.yaw.yaw.half) < 1.0


def test_a_straight_drive_does_not_show_the_offset_but_the_mount() -> None:
    scans, way = recorded(40.0, STRAIGHT, late=0.12, yaw=math.radians(2.0))
    found = measure(scans, way, PLACE)
    assert found.offset is None and found.why_no_offset == "not observable: drive a turn"
    assert found.yaw is not None and math.degrees(found.yaw.yaw.value) == pytest.approx(2.0, abs=0.7)


def test_turns_on_the_spot_do_not_show_the_mount() -> None:
    scans, way = recorded(30.0, ((0.0, 0.8, 2.0), (0.0, -0.8, 2.0)))
    found = measure(scans, way, PLACE)
    assert found.offset is not None and found.yaw is None and "drive straight" in found.why_no_yaw


def test_a_short_drive_is_refused_with_its_length() -> None:
    scans, way = recorded(5.0)
    found = measure(scans, way, PLACE)
    assert found.offset is None and found.why_no_offset.startswith("35 scans in 3.4 s")


def test_odometry_of_another_drive_does_not_agree() -> None:
    scans, _ = recorded(40.0)
    _, other = recorded(40.0, ((0.1, 0.5, 1.1), (0.1, -0.7, 0.7)))
    found = measure(scans, other, PLACE)
    assert found.offset is None and "do not turn alike" in found.why_no_offset


def test_scans_beyond_the_odometry_are_left_out() -> None:
    scans, way = recorded(40.0)
    late = [scan._replace(stamp=scan.stamp + 1000.0) for scan in scans[:200]]
    found = measure(scans + late, way, PLACE)
    assert found.offset is not None and np.all(found.track.stamps < 40.0)


def test_late_odometry_is_told_as_such() -> None:
    scans, way = recorded(40.0, late=-0.3)
    found = measure(scans, way, PLACE)
    assert found.offset is not None and found.offset.offset.value == pytest.approx(0.3, abs=0.01)
    assert found.meaning == "odometry is stamped late: correct that, since time_offset is at most 0.2 s"


def test_steps_and_gaps_of_the_odometry_do_not_count() -> None:
    scans, way = recorded(40.0, late=0.12)
    poses, kept = way.poses.copy(), np.ones(len(way.stamps), dtype=bool)
    for at, jump in ((200, 0.5), (400, -0.4), (600, 0.3)):
        poses[at:, 2] += jump
        kept[at + 60 : at + 80] = False  # 1 s
    found = measure(scans, type(way)(way.stamps[kept], poses[kept]), PLACE)
    assert found.offset is not None and found.offset.offset.value == pytest.approx(-0.12, abs=0.01)

"""The velocity that leads from the pose at a late scan to the newest pose."""

from __future__ import annotations

import math

import numpy as np
import pytest
from navloom_scans.beams import beam_points
from navloom_scans.poses import relative
from navloom_scans.trail import OdometryTrail

TICK_NS = 50_000_000
NEWEST = np.array([9.0, 0.0, 9.0])


def driven() -> tuple[OdometryTrail, list[np.ndarray]]:
    """Ten ticks of a drive that turns faster and faster."""
    trail, poses = OdometryTrail(0.5, 0.05), []
    for tick in range(10):
        poses.append(np.array([0.02 * tick, 0.001 * tick**2, math.remainder(3.0 + 0.01 * tick**2, math.tau)]))
        trail.add(tick * TICK_NS, poses[-1])
    return trail, poses


def test_a_beam_of_a_late_scan_ends_where_the_pose_of_its_time_sees_it() -> None:
    trail, poses = driven()
    velocity = trail.velocity_since(3 * TICK_NS, NEWEST)
    rows, one = np.empty((1, 4)), np.ones(1)
    place = np.array([[0.2, 0.0]])
    motion = np.append(velocity, -6 * 0.05)
    assert beam_points(place, 0.0 * one, 0.0 * one, 0.0 * one, 2.0 * one, np.array([0.0, 9.0, 1.0]), motion, rows) == 1
    seen = relative(poses[9], poses[3])
    c, s = math.cos(seen[2]), math.sin(seen[2])
    assert rows[0, :2] == pytest.approx([seen[0] + 2.2 * c, seen[1] + 2.2 * s])


@pytest.mark.parametrize("stamp_ns", [9 * TICK_NS, 8 * TICK_NS, 10 * TICK_NS, -1])
def test_a_scan_of_this_tick_or_from_before_the_trail_moves_at_the_newest_velocity(stamp_ns: int) -> None:
    assert driven()[0].velocity_since(stamp_ns, NEWEST) is NEWEST


def test_a_clock_that_begins_again_starts_a_new_trail() -> None:
    trail, poses = driven()
    trail.add(0, poses[0])
    trail.add(TICK_NS, poses[1])
    assert trail.velocity_since(0, NEWEST) is NEWEST

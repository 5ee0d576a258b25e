"""A long way through a real building with odometry that drifts by metres (found through NAVLOOM_DATA)."""

import heapq
import math
import os
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from navloom_scan_localizer.tracking import PoseTracker, Settings
from navloom_scans.field import distance_field
from navloom_scans.poses import compose, relative
from scan_localizer_rooms import beams_of, fan, ranges_in
from scipy.ndimage import distance_transform_edt, uniform_filter1d

IMAGE = Path(os.environ.get("NAVLOOM_DATA", "")) / "rosmaps" / "willow_full_0.1.pgm"
CELL, STEP, PERIOD, HALF_TRACK, SLIP = 0.1, 0.02, 0.05, 0.2, 0.002
BEARINGS = fan(181)

pytestmark = pytest.mark.skipif(
    not os.environ.get("NAVLOOM_DATA") or not IMAGE.exists(),
    reason="NAVLOOM_DATA with rosmaps/willow_full_0.1 is not set",
)


@pytest.fixture(scope="module")
def building():
    """(rows, columns) cells that are not free, row 0 at the lowest y."""
    content = IMAGE.read_bytes()
    columns, rows = 584, 526
    shades = np.frombuffer(content[-rows * columns :], np.uint8).reshape(rows, columns)
    return np.ascontiguousarray((1.0 - shades / 255.0 >= 0.196)[::-1])


def way_through(occupied, metres, rng):
    """(n, 3) poses in steps of 2 cm on a shortest path of at least that length, 0.4 m from walls, corners rounded."""
    free = distance_transform_edt(~occupied) * CELL > 0.4
    cells = np.argwhere(free)
    while True:
        start, parents, far = tuple(cells[rng.integers(len(cells))]), {}, []
        best, heap = {start: 0.0}, [(0.0, start)]
        while heap and not far:
            cost, at = heapq.heappop(heap)
            if cost >= metres / CELL:
                far.append(at)
            for down, across in ((0, 1), (1, 0), (0, -1), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)):
                other, further = (at[0] + down, at[1] + across), cost + math.hypot(down, across)
                if free[other] and further < best.get(other, math.inf):
                    best[other], parents[other] = further, at
                    heapq.heappush(heap, (further, other))
        if far:
            break
    way = [far[0]]
    while way[-1] != start:
        way.append(parents[way[-1]])
    points = (np.array(way[::-1])[:, ::-1] + 0.5) * CELL
    along = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))))
    at = np.arange(0.0, along[-1], STEP)
    dense = np.column_stack([uniform_filter1d(np.interp(at, along, points[:, k]), 31, mode="nearest") for k in (0, 1)])
    ways = np.diff(dense, axis=0)
    return np.column_stack((dense[:-1], np.arctan2(ways[:, 1], ways[:, 0])))


def measured(step, calibration, rng):
    """Odometry of a step, from wheels with radius errors and slip."""
    way, turn = math.hypot(step[0], step[1]), step[2]
    right, left = way + HALF_TRACK * turn, way - HALF_TRACK * turn
    right = right * (1.0 + calibration) + SLIP * math.sqrt(abs(right)) * rng.standard_normal()
    left = left * (1.0 - calibration) + SLIP * math.sqrt(abs(left)) * rng.standard_normal()
    ds, dw = 0.5 * (right + left), 0.5 * (right - left) / HALF_TRACK
    return np.array([ds * math.cos(0.5 * dw), ds * math.sin(0.5 * dw), dw])


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("calibration", [0.0, 0.01])
def test_the_pose_stays_within_ten_centimetres_over_forty_metres(building, seed, calibration):
    rng = np.random.default_rng(seed)
    poses = way_through(building, 40.0, rng)
    tracker = PoseTracker(Settings(), distance_field(building, CELL, (0.0, 0.0, 0.0), 1.0), poses[0])
    odometry, errors, jumps = np.zeros(3), [], []
    for before, true in pairwise(poses):
        odometry = compose(odometry, measured(relative(before, true), calibration, rng))
        tracker.predict(odometry, PERIOD)
        predicted = tracker.pose.copy()
        ranges = ranges_in(building, CELL, true, BEARINGS, 10.0)
        tracker.correct(beams_of(ranges + 0.01 * rng.standard_normal(len(ranges)), BEARINGS))
        errors.append(np.hypot(*(tracker.pose - true)[:2]))
        jumps.append(np.hypot(*(tracker.pose - predicted)[:2]))
    drift = np.hypot(*(compose(poses[0], odometry) - poses[-1])[:2])
    assert len(poses) * STEP > 35.0
    assert max(errors) < 0.10
    assert max(jumps) < 0.03
    assert drift > 10.0 * max(errors)  # the scans did it

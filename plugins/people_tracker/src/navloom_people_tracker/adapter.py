"""The tracker as a navloom node."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from navloom import (
    Context,
    Latest,
    MapperPorts,
    New,
    NodePlugin,
    OccupancyGrid,
    PlatformPorts,
    PoseEstimate,
    Publishes,
    RangeScan,
    Sensors,
    Tick,
    Tracks,
)
from navloom.geometry.echoes import poses_along
from navloom.geometry.frames import compose, inverse
from navloom_scans.field import DistanceField, distance_field
from numpy.typing import NDArray

from navloom_people_tracker.background import MOST_MARGIN, explain
from navloom_people_tracker.kalman import moved
from navloom_people_tracker.params import PeopleTrackerParams
from navloom_people_tracker.tracking import Tracker
from navloom_people_tracker.views import place_beams
from navloom_people_tracker.warming import warm_up

__all__ = ["PeopleTracker"]

Floats = NDArray[np.float64]

THIN = math.radians(2.0)
"""Half angle up to which a beam is a laser's, rad."""
KEPT = 2.0
"""How long odometry is kept, s: longer than any scan is late."""
AHEAD = 0.2
"""Time for which the velocity goes on beyond the newest odometry, s: longer than a scan takes."""


class PeopleTracker(NodePlugin[PeopleTrackerParams]):
    """Follows people and other moving bodies in the scans of all lasers."""

    name = "people_tracker"
    pose = Latest(PoseEstimate, triggers=True)
    odometry = New(PlatformPorts.odometry)
    known = Latest(MapperPorts.known)
    scans = Sensors(RangeScan)
    tracks = Publishes(Tracks)

    def __init__(self, params: PeopleTrackerParams, context: Context) -> None:
        super().__init__(params, context)
        self.reset()

    def reset(self) -> None:
        """Forget all tracks and the map."""
        self._tracker = Tracker(self.params)
        self._trail: deque[tuple[int, float, float, float]] = deque()
        self._map: OccupancyGrid | None = None
        self._field: DistanceField | None = None
        self._twist = np.zeros(3)

    @classmethod
    def warm_up(cls) -> None:
        """Compile the kernels, or load them from the cache."""
        warm_up()

    def step(self, tick: Tick) -> None:
        """Take the new scans, and publish the tracks at the time of the pose."""
        estimate = self.pose.value
        self._drive()
        if estimate is None or not self._trail:
            return
        self._take_map(self.known.value)
        begin_ns = self._trail[0][0]
        known, poses = self._way(begin_ns)
        at_pose = poses_along(np.array([estimate.stamp_ns - begin_ns]), known, poses)[0]
        here = estimate.pose
        odometry_to_map = compose((here.x, here.y, here.heading), inverse(at_pose))
        fresh = [(scan.stamp_ns, name, scan) for name, news in self.scans.items() for scan in news.values]
        for stamp_ns, name, scan in sorted(fresh, key=lambda one: one[:2]):
            if len(scan.ranges) > 1 and scan.half_angles.max() <= THIN and stamp_ns >= begin_ns:
                times = stamp_ns - begin_ns + 1e9 * scan.time_offsets
                self._see(name, scan, poses_along(times, known, poses), estimate, odometry_to_map)
        found = self._tracker.published(estimate.stamp_ns * 1e-9)
        unseen = np.maximum(estimate.stamp_ns * 1e-9 - found.seen, 0.0)
        means, covariances = moved(found.means, found.covariances, odometry_to_map)
        radii = np.maximum(found.radii, self.params.least_radius)
        self.tracks.put(
            Tracks(estimate.stamp_ns, found.ids, means[:, :2].copy(), means[:, 2:].copy(), covariances, radii, unseen)
        )

    def _drive(self) -> None:
        """Keep the odometry of the last seconds."""
        for odometry in self.odometry.values:
            pose, twist = odometry.pose, odometry.twist
            self._trail.append((odometry.stamp_ns, pose.x, pose.y, pose.heading))
            self._twist = np.array([twist.vx, twist.vy, twist.wz])
        while len(self._trail) > 1 and self._trail[-1][0] - self._trail[0][0] > 1e9 * KEPT:
            self._trail.popleft()

    def _way(self, begin_ns: int) -> tuple[Floats, Floats]:
        """Times since a stamp, ns, and poses of the odometry, and one ahead of it: beams may be newer."""
        stamps = np.array([float(row[0] - begin_ns) for row in self._trail])
        poses = np.array([row[1:] for row in self._trail])
        ahead = compose(poses[-1], AHEAD * self._twist)
        return np.append(stamps, stamps[-1] + 1e9 * AHEAD), np.vstack([poses, ahead])

    def _take_map(self, grid: OccupancyGrid | None) -> None:
        if grid is not None and grid is not self._map and grid.cells.size:
            walls, origin = grid.cells >= self.params.occupied_from, grid.origin
            place = (origin.x, origin.y, origin.heading)
            self._map, self._field = grid, distance_field(walls, grid.resolution, place, MOST_MARGIN)

    def _see(self, name: str, scan: RangeScan, poses: Floats, estimate: PoseEstimate, odometry_to_map: Floats) -> None:
        beams, mapped = np.empty((len(scan.ranges), 5)), np.full(len(scan.ranges), -1)
        limits = np.array([scan.range_min, scan.range_max])
        place_beams(poses, scan.origins, scan.bearings, scan.ranges, limits, beams)
        if self._map is not None and self._field is not None and estimate.state == "tracking":
            sigmas = 3.0 * np.sqrt(np.maximum(np.diag(estimate.covariance), 0.0))
            margin = np.array([self.params.map_margin, sigmas[:2].max(), sigmas[2]])
            motion = np.append(odometry_to_map, poses[-1, :2])
            explain(self._field.values, self._field.frame, self._map.cells, beams, motion, margin, mapped)
        mapped[np.hypot(beams[:, 2] - beams[:, 0], beams[:, 3] - beams[:, 1]) > self.params.reach] = 1
        step = float(np.median(np.abs(np.diff(scan.bearings))))
        self._tracker.see(scan.stamp_ns * 1e-9, name, poses[-1], beams, max(step, 1e-3), mapped)

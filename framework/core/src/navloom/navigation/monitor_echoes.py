"""Obstacles of the gate's monitor: readings of range sensors that another reading confirms.

All places are in the odometry frame. A laser's readings become surfaces: in each direction, the mean of the nearest
readings of which at least two agree. A sonar's reading becomes points on its arc, without those that another beam of
the ring reads through.
"""

from __future__ import annotations

import math
from collections import deque
from functools import lru_cache

import numpy as np
from numba import njit
from numpy.typing import NDArray

from navloom.messages import RangeScan
from navloom.navigation.monitor_motion import ClusterMotion
from navloom.navigation.monitor_rollout import within

__all__ = [
    "KEEP",
    "MOST_DRIFT",
    "NOTHING_MOVES",
    "NO_POINTS",
    "SensorEchoes",
    "arc_points",
    "covered",
    "directions",
    "nearest_surfaces",
    "out_of_view",
    "to_odometry",
]

Floats = NDArray[np.float64]

DEPTH = 12
"""Most readings per direction; older ones are left out."""
# Without these echoes, a robot that turns on the spot touches a post that it has seen.
HELD = 1.5
"""Largest distance at which a laser's echo is kept while no beam points at it, m."""
ARC_STEP = 0.05
"""Largest distance between two points of a sonar's arc, m."""
KEEP = 0.5
"""How long an echo counts, s; the last two scans of each sensor always count."""
BETWEEN = 1.5
"""How far an obstacle may reach beyond a laser's echo, in gaps between two beams at its distance: an edge lies up to
one gap beyond its last beam, and the mean of the last readings half a gap before that beam."""
DRIFT, MOST_DRIFT = 0.055, 0.08
"""How far an echo may be misplaced while no beam points at it, m per m of its distance and per m that the base drives
or 2 rad that it turns, and at most, m: odometry with a slip of 1 cm per root metre is wrong by 3° after a metre."""
NO_POINTS, NOTHING_MOVES = np.empty((0, 3)), np.empty((0, 6))


DEEP = 0.05
"""Depth within the footprint from which a remembered echo is forgotten, m: deeper than a robot touches things."""


class SensorEchoes:
    """Echoes of one sensor.

    Args:
        sigma: Standard deviation of a range, m.
        outline: (n, 2) footprint of the robot, m, base frame: what it remembers deep inside is forgotten.

    Attributes:
        scans: Stamp, s, and points (n, 2), m, odometry frame, of each scan that counts, newest first.
        ranges: Of the newest scan of sonars, m.
        obstacles: (k, 3) points, m, odometry frame, and how far an obstacle may reach beyond each, m.
        moving: (k, 6) the same of obstacles that move, at the newest scan, their velocity, m/s, and swing, m.
        seen_at: (3,) pose of the base at the newest scan of a laser, m, rad, odometry frame.
        view: x, y, m, of the laser then, heading, rad, of the base, and (bins,) which directions its beams cover.
    """

    def __init__(self, sigma: float, outline: Floats | None = None, approach_speed: float = 0.0) -> None:
        self.sigma, self.outline = sigma, outline
        self.motion = ClusterMotion(sigma, approach_speed) if approach_speed > 0.0 else None
        self.scans = deque[tuple[float, Floats]]()
        self.ranges: Floats | None = None
        self.obstacles, self.moving = NO_POINTS, NOTHING_MOVES
        self.seen_at: Floats | None = None
        self.view: tuple[float, float, float, NDArray[np.bool_]] | None = None
        none = np.empty(0)
        self._bearings, self._is_covered = none, covered(none, directions(none))

    def look_by_laser(self, time: float, scan: RangeScan, poses: Floats) -> None:
        """Take a scan of a laser.

        Args:
            time: Its stamp, s.
            scan: The scan.
            poses: (n, 3) poses of the base, m and rad, odometry frame, at the time of each beam; one for no beams.
        """
        points = np.empty((len(scan.ranges), 2))
        to_odometry(poses, scan.origins, scan.bearings, scan.ranges, scan.range_max, points)
        self._remember(time, points)
        middle = scan.origins.mean(axis=0) if len(scan.origins) else np.zeros(2)
        x, y, heading = base = poses[-1]
        cos, sin = math.cos(heading), math.sin(heading)
        # Directions are counted from the laser, not from the base: from there, beams are evenly apart.
        x, y = x + cos * middle[0] - sin * middle[1], y + sin * middle[0] + cos * middle[1]
        is_covered = self._covered_by(scan.bearings)
        bins = len(is_covered)
        found = np.empty((bins, 2))
        every = self._every()
        if self.motion is not None:
            self.motion.look(time, scan, poses, (x, y), bins)
            self.motion.carry(every)
        count = nearest_surfaces(every, x, y, bins, 3.0 * self.sigma, found)
        # Two beams are one bin apart, so that the gap grows with the distance.
        reach = BETWEEN * math.tau / bins * np.hypot(found[:count, 0] - x, found[:count, 1] - y)
        # What moved out of view is taken to be where it was last seen.
        known = np.concatenate([self.obstacles, self.moving[:, :3]]) if len(self.moving) else self.obstacles
        held = out_of_view(known, (x, y, heading), is_covered)
        if self.outline is not None and len(held):
            # A robot that was carried remembers echoes where it now stands, and sees none of them.
            dx, dy = held[:, 0] - base[0], held[:, 1] - base[1]
            inside = np.column_stack([cos * dx + sin * dy, cos * dy - sin * dx])
            held = held[~within(inside, self.outline, np.full(len(held), -DEEP))]
        if self.seen_at is not None:
            moved = np.abs(base - self.seen_at)
            # A slip turns the heading of the odometry, which displaces what is far away the most.
            turned = DRIFT * (math.hypot(*moved[:2]) + 0.5 * moved[2])
            held[:, 2] = np.minimum(held[:, 2] + turned * np.hypot(held[:, 0] - x, held[:, 1] - y), MOST_DRIFT)
        surfaces = np.column_stack([found[:count], reach])
        if self.motion is not None and len(self.motion.moving):
            owners = self.motion.owners(surfaces)
            moves = owners >= 0
            self.moving = np.concatenate([surfaces[moves], self.motion.moving[owners[moves]]], axis=1)
            surfaces = surfaces[~moves]
        else:
            self.moving = NOTHING_MOVES
        self.obstacles = np.concatenate([surfaces, held])
        self.seen_at, self.view = base, (x, y, heading, is_covered)

    def look_by_sonars(self, time: float, scan: RangeScan, poses: Floats, moved: float) -> None:
        """Take a scan of a ring of sonars: as `look_by_laser`, with the largest motion since the previous one, m."""
        before = self.ranges
        if before is None or len(before) != len(scan.ranges):
            before, moved = np.full(len(scan.ranges), math.nan), 0.0
        # Kernels cannot grow an array: this is the most that the arcs can need.
        arcs = 2.0 * scan.half_angles * np.where(scan.ranges < scan.range_max, scan.ranges, 0.0)
        found = np.empty((int(np.ceil(arcs / ARC_STEP).sum()) + 2 * len(arcs), 2))
        count = arc_points(
            poses[-1], scan.origins, scan.bearings, scan.half_angles, scan.ranges, before, moved,
            np.array([scan.range_max, 3.0 * self.sigma]), found,
        )  # fmt: skip
        # A copy, because the array may be a view of the buffer of a message that would be kept alive.
        self.ranges = scan.ranges.copy()
        # A copy, so that the unused rest of the buffer is freed.
        self._remember(time, found[:count].copy())
        every = self._every()
        self.obstacles = np.zeros((len(every), 3))
        self.obstacles[:, :2] = every

    def forget_unseen(self) -> None:
        """Forget the obstacles that the newest scan of a laser does not look at."""
        if self.view is not None:
            self.obstacles = self.obstacles[self.covers(self.obstacles[:, :2])]

    def near(self, pose: tuple[float, float, float], reach: float) -> Floats:
        """(k, 3) obstacles within reach, m, of a pose of the base, odometry frame, as `obstacles`, in its frame."""
        x, y, heading = pose
        cos, sin = math.cos(heading), math.sin(heading)
        dx, dy = self.obstacles[:, 0] - x, self.obstacles[:, 1] - y
        kept = dx * dx + dy * dy <= reach * reach
        dx, dy = dx[kept], dy[kept]
        return np.stack([cos * dx + sin * dy, cos * dy - sin * dx, self.obstacles[kept, 2]], axis=1)

    def moving_from(self, pose: tuple[float, float, float], time: float) -> Floats:
        """(k, 7) obstacles that move, as `moving`, in the frame of a pose of the base, and their age at a time, s."""
        x, y, heading = pose
        cos, sin = math.cos(heading), math.sin(heading)
        dx, dy, beyond, vx, vy, swing = (self.moving - (x, y, 0.0, 0.0, 0.0, 0.0)).T
        ahead, aside, age = cos * dx + sin * dy, cos * dy - sin * dx, np.full(len(dx), time - self.scans[0][0])
        return np.stack([ahead, aside, beyond, cos * vx + sin * vy, cos * vy - sin * vx, swing, age], axis=1)

    def covers(self, points: Floats) -> NDArray[np.bool_]:
        """(k,) which points (k, 2), m, odometry frame, lie in a direction of a laser's newest scan."""
        if self.view is None:
            return np.zeros(len(points), np.bool_)
        x, y, heading, looked = self.view
        turns = (np.arctan2(points[:, 1] - y, points[:, 0] - x) - heading) / math.tau
        return looked[np.floor(turns * len(looked)).astype(np.int64) % len(looked)]

    def _covered_by(self, bearings: Floats) -> NDArray[np.bool_]:
        """(bins,) directions that beams (n,), rad, cover; computed again only for other beams."""
        if not np.array_equal(bearings, self._bearings):
            # A copy, because the array may be a view of the buffer of a message that would be kept alive.
            self._bearings, self._is_covered = bearings.copy(), covered(bearings, directions(bearings))
        return self._is_covered

    def _remember(self, time: float, points: Floats) -> None:
        self.scans.appendleft((time, points))
        # Two at least, however slow the sensor is: a reading counts only if another one confirms it.
        while len(self.scans) > 2 and self.scans[-1][0] < time - KEEP:
            self.scans.pop()

    def _every(self) -> Floats:
        """(n, 2) points of all scans that count, newest first, m."""
        return np.concatenate([points for _, points in self.scans])


@njit(cache=True, nogil=True, error_model="numpy")
def to_odometry(poses, origins, bearings, ranges, range_max, points):  # type: ignore[no-untyped-def]
    """Places of the echoes of a scan.

    Args:
        poses: (n, 3) poses of the base, odometry frame, at the time of each beam: x, y, m, heading, rad.
        origins, bearings, ranges: Of the n beams, as in `RangeScan`.
        range_max: Smallest reading that is no echo, m.
        points: (n, 2) output, m, odometry frame; NaN for no echo.
    """
    for i in range(ranges.shape[0]):
        if not ranges[i] < range_max:
            # NaN instead of a shorter array: rows stay those of the beams.
            points[i, 0], points[i, 1] = math.nan, math.nan
            continue
        cos, sin = math.cos(poses[i, 2]), math.sin(poses[i, 2])
        x = origins[i, 0] + ranges[i] * math.cos(bearings[i])
        y = origins[i, 1] + ranges[i] * math.sin(bearings[i])
        points[i, 0] = poses[i, 0] + cos * x - sin * y
        points[i, 1] = poses[i, 1] + sin * x + cos * y


@njit(cache=True, nogil=True, error_model="numpy")
def nearest_surfaces(points, x, y, bins, agreement, found):  # type: ignore[no-untyped-def]
    """The nearest surface in each direction on which at least two readings agree.

    Readings of a direction and of its two neighbours agree if their distances differ by no more than `agreement`.
    The surface is the mean of the nearest agreeing reading and all within `agreement` behind it: averaging removes
    most of the noise, and the window excludes what is farther behind. Of 30 readings the nearest is two standard
    deviations too near, so the window cuts off the farthest, and its mean is 0.3 of one too near. A second window, to
    two thirds of `agreement` behind that mean, leaves 0.07.

    Args:
        points: (n, 2) echoes of the scans that count, newest first, m; NaN for no echo.
        x, y: Current position of the sensor, m.
        bins: Number of directions in a full turn.
        agreement: Largest difference of agreeing distances, m.
        found: (bins, 2) output, m.

    Returns:
        Number of filled rows of `found`.
    """
    counts = np.zeros(bins, np.int64)
    distances, held = np.empty((bins, DEPTH)), np.empty((bins, DEPTH), np.int64)
    for i in range(points.shape[0]):
        dx, dy = points[i, 0] - x, points[i, 1] - y
        if math.isnan(dx):
            continue
        row = int((math.atan2(dy, dx) / (2.0 * math.pi) + 0.5) * bins) % bins
        # Newest first, so that older readings are the ones left out.
        if counts[row] < DEPTH:
            distances[row, counts[row]], held[row, counts[row]] = math.hypot(dx, dy), i
            counts[row] += 1
    total = 0
    for row in range(bins):
        if counts[row] == 0:
            continue
        beyond = -1.0
        while True:
            nearest = math.inf
            # The robot moved since: the same surface may fall into the direction beside.
            for side in range(-1, 2):
                other = (row + side) % bins
                for k in range(counts[other]):
                    if beyond < distances[other, k] < nearest:
                        nearest = distances[other, k]
            if nearest == math.inf:
                break
            least, most = nearest, nearest + agreement
            for _ in range(2):
                sum_x, sum_y, sum_d, members = 0.0, 0.0, 0.0, 0
                for side in range(-1, 2):
                    other = (row + side) % bins
                    for k in range(counts[other]):
                        if least <= distances[other, k] <= most:
                            sum_x += points[held[other, k], 0]
                            sum_y += points[held[other, k], 1]
                            sum_d += distances[other, k]
                            members += 1
                most = sum_d / members + 2.0 / 3.0 * agreement
            # A single noisy reading (σ = 3 cm) would close every gap of 5 cm a side.
            if members > 1:
                found[total, 0], found[total, 1] = sum_x / members, sum_y / members
                total += 1
                break
            # A single reading may be noise or rain; the next farther ones of this direction get their turn.
            beyond = nearest
    return total


def covered(bearings: Floats, bins: int) -> NDArray[np.bool_]:
    """(bins,) directions of a full turn that beams (n,), rad, cover: their own, and the ones beside. Read-only."""
    return _covered(bearings.tobytes(), bins)


# The beams of a sensor are the same in every scan, so this and `directions` are computed once for each sensor.
@lru_cache(maxsize=64)
def _covered(bearings: bytes, bins: int) -> NDArray[np.bool_]:
    found = np.zeros(bins, dtype=bool)
    looked = np.floor(np.frombuffer(bearings) * (bins / math.tau)).astype(np.int64)
    for side in (-1, 0, 1):
        found[(looked + side) % bins] = True
    found.flags.writeable = False
    return found


def out_of_view(points: Floats, eye: tuple[float, float, float], is_covered: NDArray[np.bool_]) -> Floats:
    """Nearest echo in each direction that no beam covers now: it counts until a beam points there again.

    Args:
        points: (k, 3) obstacles after the previous scan: x, y, odometry frame, and how far they may reach beyond, m.
        eye: x, y, m, of the laser and heading, rad, of the base, odometry frame.
        is_covered: (bins,) directions of a full turn that beams cover.
    """
    bins = len(is_covered)
    dx, dy = points[:, 0] - eye[0], points[:, 1] - eye[1]
    rows = np.floor((np.arctan2(dy, dx) - eye[2]) * (bins / math.tau)).astype(np.int64) % bins
    far = np.hypot(dx, dy)
    chosen = np.flatnonzero(~is_covered[rows] & (far < HELD))
    chosen = chosen[np.argsort(far[chosen], kind="stable")]
    _, first = np.unique(rows[chosen], return_index=True)
    held: Floats = points[chosen[np.sort(first)]]
    return held


def directions(bearings: Floats) -> int:
    """Number of directions in a full turn, about one for each beam, from 180 to 1440."""
    return _directions(bearings.tobytes())


@lru_cache(maxsize=64)
def _directions(bearings: bytes) -> int:
    turns = np.abs(np.diff(np.frombuffer(bearings)))
    if not len(turns):
        return 360
    step = float(np.median(turns))
    # Bounded, because a kernel's time grows with the bins, and a few beams must not become coarse sectors.
    return min(1440, max(180, round(2.0 * math.pi / max(step, 1e-3))))


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _angle_between(first, second):  # type: ignore[no-untyped-def]
    """Angle between two directions, rad, 0 to π."""
    turn = first - second
    return abs(turn - 2.0 * math.pi * math.floor(turn / (2.0 * math.pi) + 0.5))


@njit(cache=True, nogil=True, error_model="numpy")
def arc_points(base, origins, bearings, half_angles, ranges, before, moved, limits, found):  # type: ignore[no-untyped-def]
    """Points on the arcs of a ring of sonars where an obstacle may be.

    A reading counts if the sonar's previous reading, or the reading of a neighbour with an overlapping cone, agrees
    with it. A point of an arc is left out if another sonar's cone covers it and its reading is farther.

    Args:
        base: (3,) x, y, m, heading, rad, of the base in the odometry frame.
        origins, bearings, half_angles, ranges: Of the n beams, as in `RangeScan`.
        before: (n,) ranges of the previous scan, m; NaN for none.
        moved: Upper bound of the motion of any point of the robot since then, m.
        limits: (2,) range_max and agreement, m.
        found: (k, 2) output, m, odometry frame; points beyond k are dropped.

    Returns:
        Number of filled rows of `found`.
    """
    count, total = ranges.shape[0], 0
    range_max, agreement = limits[0], limits[1]
    cos, sin = math.cos(base[2]), math.sin(base[2])
    for i in range(count):
        if not ranges[i] < range_max:
            continue
        # Cross-talk of sonars gives single readings; a surface is there in the next scan too.
        agrees = abs(ranges[i] - before[i]) <= agreement + moved
        for j in (i - 1, i + 1):
            if 0 <= j < count and ranges[j] < range_max and abs(ranges[j] - ranges[i]) <= agreement:
                gap = _angle_between(bearings[j], bearings[i])
                agrees = agrees or gap <= half_angles[i] + half_angles[j]
        if not agrees:
            continue
        steps = math.ceil(2.0 * half_angles[i] * ranges[i] / ARC_STEP) + 1
        for step in range(steps + 1):
            angle = bearings[i] + half_angles[i] * (2.0 * step / steps - 1.0)
            px = origins[i, 0] + ranges[i] * math.cos(angle)
            py = origins[i, 1] + ranges[i] * math.sin(angle)
            if total < found.shape[0] and not _is_read_through(
                i, px, py, origins, bearings, half_angles, ranges, agreement
            ):
                found[total, 0] = base[0] + cos * px - sin * py
                found[total, 1] = base[1] + sin * px + cos * py
                total += 1
    return total


@njit(cache=True, nogil=True, error_model="numpy")
def _is_read_through(own, px, py, origins, bearings, half_angles, ranges, agreement):  # type: ignore[no-untyped-def]
    """Whether another beam's cone covers a point, base frame, and its reading is farther than the point."""
    for j in range(ranges.shape[0]):
        if j == own:
            continue
        dx, dy = px - origins[j, 0], py - origins[j, 1]
        # Only beams of this ring are asked: a laser looks over obstacles that a lower sonar hears.
        if _angle_between(math.atan2(dy, dx), bearings[j]) > half_angles[j]:
            continue
        if math.hypot(dx, dy) < ranges[j] - agreement:
            return True
    return False

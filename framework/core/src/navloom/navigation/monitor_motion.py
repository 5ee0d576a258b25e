"""How fast the things move that a laser sees: clusters of its echoes, followed from scan to scan.

All places are in the odometry frame. A cluster is a run of echoes along neighbouring beams, small enough for a person
or a robot. It continues the nearest cluster of the previous scan, and its velocity is the slope of its mean places
over the last half second.

A slope is no proof of motion: while the robot drives, the visible part of a wall beside an edge slides along the wall.
So a cluster moves only if it also has entered space that the laser saw through, or has left space that the laser sees
through now. In a static world nothing does: what comes into view was hidden, and what goes out of view is hidden.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from navloom.messages import RangeScan
from navloom.navigation.monitor_clusters import (
    BEFORE,
    EXTENT,
    FIRST,
    LAST,
    MOST_CLUSTERS,
    PROOF,
    STRIDE,
    SWING,
    THIN,
    VX,
    VY,
    Looks,
    X,
    Y,
    direction,
    enter_scan,
    find_clusters,
    share_within,
)

__all__ = ["ClusterMotion"]

Floats = NDArray[np.float64]

WINDOW, RECENT = 1.0, 0.5
"""Time for which a scan is compared with the newest one, and of the scans that give a velocity, s: a slow laser needs a
second to prove 0.5 m/s, but what turns or stops has another velocity half a second later."""
MOST_SCANS = 32
"""Most scans of a window; with a faster laser the window is shorter."""
NEAR = 4.0
"""Distance, in standard deviations of a range, up to which a place counts as that of an echo of another scan."""
SLIP = 0.11
"""Additional such distance per m of range and per m that the base drives or 2 rad that it turns meanwhile: twice the
`DRIFT` of echoes out of view."""
SLACK = 0.1
"""Distance between two mean places of a thing at rest, m."""
SLOWEST = 0.2
"""Slowest motion that is told from none, m/s: odometry may be 10 % wrong at 2 m/s."""
SHORTEST = 0.09
"""Shortest time over which a velocity is measured, s."""
CURVED = 0.15
"""Largest deviation of the mean places from steady motion, as a share of its way: 0.25 is one jump between places at
rest, as when a post is taken for the one beside it."""
SHARE = 0.5
"""Share of a cluster that must have entered seen space, or of its earlier echoes that must have left it, in sum."""
SURE, SUREST = 2, 6
"""Scans that must show motion before it counts, and that count at most: so many later ones may fail to show it."""
UNSTEADY, SLOW, STEADY = range(3)
"""Motion of a cluster."""
NO_MOTION = np.empty((0, 3))


class ClusterMotion:
    """Velocities of the clusters of one laser.

    Args:
        sigma: Standard deviation of a range, m.
        fastest: Largest speed that is believed, m/s.

    Attributes:
        moving: (k, 3) velocities, m/s, odometry frame, of the clusters of the newest scan that move, and how far a leg
            may soon be ahead of that, m.
    """

    def __init__(self, sigma: float, fastest: float) -> None:
        self.moving = NO_MOTION
        self._sigma, self._fastest = sigma, fastest
        self._begin(np.empty(0), 1)

    def _begin(self, bearings: Floats, bins: int) -> None:
        # Beams may come in any order, but clusters are runs of neighbours.
        self._bearings, self._order = bearings.copy(), np.argsort(bearings, kind="stable")
        self._limits = np.array([self._sigma, self._fastest, math.tau / bins])
        # Allocated once: the newest scan overwrites the oldest.
        self._looks = Looks(
            np.empty((MOST_SCANS, 6)), np.empty((MOST_SCANS, len(bearings), 2)), np.empty((MOST_SCANS, len(bearings))),
            np.empty((MOST_SCANS, bins), np.int64), np.empty((MOST_SCANS, len(bearings)), np.int64),
            np.empty((MOST_SCANS, MOST_CLUSTERS, 10)),
            np.zeros(MOST_SCANS, np.int64),
        )  # fmt: skip
        self._labels = np.empty(len(bearings), np.int64)
        self._slots: NDArray[np.int64] = np.empty(0, np.int64)

    def look(self, time: float, scan: RangeScan, poses: Floats, eye: tuple[float, float], bins: int) -> None:
        """Take a scan.

        Args:
            time: Its stamp, s.
            scan: The scan.
            poses: (n, 3) poses of the base, m and rad, odometry frame, at the time of each beam; one for no beams.
            eye: Place of the laser, m, odometry frame.
            bins: Number of directions in a full turn, about one for each beam.
        """
        looks = self._looks
        if looks.images.shape[1] != bins or not np.array_equal(scan.bearings, self._bearings):
            self._begin(scan.bearings, bins)
            looks = self._looks
        newest = (self._slots[0] + 1) % MOST_SCANS if len(self._slots) else 0
        kept = [slot for slot in self._slots[: MOST_SCANS - 1] if looks.frames[slot, 0] >= time - WINDOW]
        self._slots = np.array([newest, *kept])
        looks.frames[newest] = time, *eye, *poses[-1]
        enter_scan(newest, poses, scan.origins, scan.bearings, scan.ranges, scan.range_max, self._order, looks)
        find_clusters(newest, self._limits, looks)
        follow(self._slots, self._limits, looks)
        moving = np.empty((MOST_CLUSTERS, 3))
        count = label(newest, looks, self._labels, moving)
        self.moving = moving[:count].copy()

    def carry(self, points: Floats) -> None:
        """Move earlier echoes of clusters that move to where these are at the newest scan.

        Args:
            points: (m, 2) echoes of scans, newest first, m: one row for each beam, m.
        """
        if len(self.moving):
            carry(points, self._slots, self._order, self._looks)

    def owners(self, surfaces: Floats) -> NDArray[np.int64]:
        """(m,) row in `moving` of the cluster that each surface (m, 2 or more), m, belongs to; -1 for none."""
        found = np.full(len(surfaces), -1)
        if len(self.moving):
            own(surfaces, self._slots[0], self._limits, self._looks, self._labels, found)
        return found


@njit(cache=True, nogil=True, error_model="numpy")
def follow(slots, limits, looks):  # type: ignore[no-untyped-def]
    """Fill predecessor, velocity and proof of the newest clusters. `slots` are newest first."""
    newest = slots[0]
    chain = np.empty(slots.shape[0], np.int64)
    for row in range(looks.counts[newest]):
        cluster = looks.clusters[newest, row]
        cluster[BEFORE], cluster[VX], cluster[VY], cluster[PROOF] = -1, 0.0, 0.0, 0
        if slots.shape[0] < 2 or cluster[LAST] < cluster[FIRST]:
            continue
        before = _continued(cluster, looks.frames[newest, 0], slots[1], limits[1], looks)
        cluster[BEFORE] = before
        if before < 0:
            continue
        _keep_step(cluster, looks.clusters[slots[1], before], looks.frames[newest, 0] - looks.frames[slots[1], 0])
        length = _chain(slots, row, looks, chain)
        former = looks.clusters[slots[1], before]
        motion = _fit(slots, chain, length, limits, looks)
        if motion == STEADY and _share_moved(newest, row, slots[length - 1], chain[length - 1], limits, looks) >= SHARE:
            cluster[PROOF] = min(former[PROOF] + 1, SUREST)
            continue
        # Noise splits a cluster, or something hides a part of it, for a few scans.
        if motion != SLOW:
            cluster[PROOF] = max(former[PROOF] - 1, 0)
        if motion == UNSTEADY:
            cluster[VX], cluster[VY] = former[VX], former[VY]


@njit(cache=True, nogil=True, error_model="numpy")
def _continued(cluster, time, slot, fastest, looks):  # type: ignore[no-untyped-def]
    """Row of the cluster of a slot that a later cluster continues; -1 for none."""
    passed = time - looks.frames[slot, 0]
    best, found = math.inf, -1
    for row in range(looks.counts[slot]):
        other = looks.clusters[slot, row]
        if other[LAST] < other[FIRST]:
            continue
        # A velocity that is not proved may be of a cluster whose visible part changes: it is at rest.
        share = passed if other[PROOF] >= SURE else 0.0
        apart = math.hypot(other[X] + share * other[VX] - cluster[X], other[Y] + share * other[VY] - cluster[Y])
        # A walker of whom one leg hides the other is a leg, up to half a stride beside its middle.
        if apart < min(best, SLACK + fastest * passed + max(cluster[SWING], other[SWING])):
            best, found = apart, row
    return found


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _keep_step(cluster, former, passed):  # type: ignore[no-untyped-def]
    """Let what continues a walker be one: the middle of a single leg is where the walker's is expected.

    But no farther from the leg than half a stride, so that a walker who stops is seen to.
    """
    if former[SWING] == 0.0 or cluster[SWING] > 0.0 or cluster[EXTENT] > STRIDE:
        return
    cluster[SWING] = former[SWING]
    if cluster[EXTENT] > THIN or former[PROOF] < SURE:
        return
    dx = former[X] + passed * former[VX] - cluster[X]
    dy = former[Y] + passed * former[VY] - cluster[Y]
    share = min(1.0, former[SWING] / max(math.hypot(dx, dy), 1e-9))
    cluster[X], cluster[Y] = cluster[X] + share * dx, cluster[Y] + share * dy


@njit(cache=True, nogil=True, error_model="numpy")
def _chain(slots, row, looks, chain):  # type: ignore[no-untyped-def]
    """Number of scans in which a newest cluster was seen; fills its row in each."""
    for k in range(slots.shape[0]):
        chain[k] = row
        row = int(looks.clusters[slots[k], row, BEFORE])
        if row < 0:
            return k + 1
    return slots.shape[0]


@njit(cache=True, nogil=True, error_model="numpy")
def _fit(slots, chain, length, limits, looks):  # type: ignore[no-untyped-def]
    """Kind of the motion of a cluster, by its mean places; fills its velocity, by least squares, unless it is slow."""
    cluster, now = looks.clusters[slots[0], chain[0]], looks.frames[slots[0], 0]
    while length > 3 and looks.frames[slots[length - 1], 0] < now - RECENT - 1e-9:
        length -= 1
    span = now - looks.frames[slots[length - 1], 0]
    if length < 3 or span < SHORTEST:
        return UNSTEADY
    t = x = y = tt = tx = ty = 0.0
    for k in range(length):
        other = looks.clusters[slots[k], chain[k]]
        # Differences from the newest, so that no digits are lost far from the origin.
        at, dx, dy = looks.frames[slots[k], 0] - now, other[X] - cluster[X], other[Y] - cluster[Y]
        t, x, y, tt, tx, ty = t + at, x + dx, y + dy, tt + at * at, tx + at * dx, ty + at * dy
    spread = tt - t * t / length
    vx, vy = (tx - t * x / length) / spread, (ty - t * y / length) / spread
    speed = math.hypot(vx, vy)
    off = 0.0
    for k in range(length):
        other, at = looks.clusters[slots[k], chain[k]], looks.frames[slots[k], 0] - now - t / length
        off += (other[X] - cluster[X] - x / length - vx * at) ** 2 + (other[Y] - cluster[Y] - y / length - vy * at) ** 2
    if math.sqrt(off / length) > CURVED * speed * span + limits[0]:
        return UNSTEADY
    if speed < SLOWEST:
        return SLOW
    bound = min(1.0, limits[1] / speed)
    cluster[VX], cluster[VY] = vx * bound, vy * bound
    return STEADY


@njit(cache=True, nogil=True, error_model="numpy")
def _share_moved(newest, row, oldest, former, limits, looks):  # type: ignore[no-untyped-def]
    """Share of a cluster's echoes that an earlier scan saw through, plus that of its echoes then that this one does."""
    now, then = looks.frames[newest], looks.frames[oldest]
    driven = math.hypot(now[3] - then[3], now[4] - then[4]) + 0.5 * abs(now[5] - then[5])
    near = NEAR * limits[0], SLIP * driven
    return share_within(newest, row, oldest, near, limits, looks) + share_within(
        oldest, former, newest, near, limits, looks
    )


@njit(cache=True, nogil=True, error_model="numpy")
def label(slot, looks, labels, moving):  # type: ignore[no-untyped-def]
    """Number of clusters that move; fills their velocities, and (n,) which of them each beam belongs to, or -1."""
    labels[:] = -1
    count = 0
    for row in range(looks.counts[slot]):
        cluster = looks.clusters[slot, row]
        if cluster[PROOF] >= SURE:
            moving[count, 0], moving[count, 1], moving[count, 2] = cluster[VX], cluster[VY], cluster[SWING]
            for member in range(int(cluster[FIRST]), int(cluster[LAST]) + 1):
                k = member % labels.shape[0]
                if looks.labels[slot, k] == row:
                    labels[k] = count
            count += 1
    return count


@njit(cache=True, nogil=True, error_model="numpy")
def carry(points, slots, order, looks):  # type: ignore[no-untyped-def]
    """As `ClusterMotion.carry`."""
    beams, newest = order.shape[0], slots[0]
    for start in range(looks.counts[newest]):
        cluster = looks.clusters[newest, start]
        if cluster[PROOF] < SURE:
            continue
        row = start
        for age in range(min(slots.shape[0], points.shape[0] // beams)):
            other, passed = looks.clusters[slots[age], row], looks.frames[newest, 0] - looks.frames[slots[age], 0]
            for member in range(int(other[FIRST]), int(other[LAST]) + 1):
                k = member % beams
                if looks.labels[slots[age], k] == row:
                    points[age * beams + order[k], 0] += passed * cluster[VX]
                    points[age * beams + order[k], 1] += passed * cluster[VY]
            row = int(other[BEFORE])
            if row < 0:
                break


@njit(cache=True, nogil=True, error_model="numpy")
def own(surfaces, slot, limits, looks, labels, owners):  # type: ignore[no-untyped-def]
    """As `ClusterMotion.owners`: by the echoes of the newest scan in the same direction."""
    image = looks.images[slot]
    for i in range(surfaces.shape[0]):
        dx, dy = surfaces[i, 0] - looks.frames[slot, 1], surfaces[i, 1] - looks.frames[slot, 2]
        far, row = math.hypot(dx, dy), direction(dx, dy, image.shape[0])
        for side in (0, -1, 1):
            k = image[(row + side) % image.shape[0]]
            if k >= 0 and labels[k] >= 0 and abs(looks.reads[slot, k] - far) <= NEAR * limits[0]:
                owners[i] = labels[k]
                break

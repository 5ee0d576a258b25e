"""Clusters of a laser's echoes, and which of them lie in space that another scan saw through.

All places are in the odometry frame. A cluster is a run of echoes along neighbouring beams, or two thin ones a stride
apart, as the legs of a person.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["MOST_CLUSTERS", "Looks", "direction", "enter_scan", "find_clusters", "share_within"]

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

MOST_CLUSTERS = 256
"""Most clusters of a scan."""
LEAST_BEAMS = 3
"""Fewest echoes of a cluster: one or two may be noise or rain."""
WIDEST = 1.6
"""Largest extent of a cluster that can move, m: a larger one is a wall or a row of things."""
FARTHEST = 8.0
"""Largest distance from the laser of a cluster that can move, m: at 2 m/s it takes 4 s to arrive."""
JUMP, BEAMS_APART = 6.0, 4.0
"""Largest distance of two neighbouring echoes of a cluster, in standard deviations of a range plus in distances between
two beams: noise parts a cluster of 60 beams once in 1000 scans, and a surface seen at 15° has its echoes 4 apart."""
THIN, STRIDE = 0.25, 0.7
"""Largest extent of a leg and largest distance between two legs of a person, m. Each leg stands half of the time, and
swings at twice the speed of the person; their middle moves steadily."""
TESTED = 16
"""Most echoes of a cluster that are tested."""

# Columns of a cluster.
X, Y, FIRST, LAST, BEFORE, VX, VY, PROOF, EXTENT, SWING = range(10)
"""Mean place, m; first and last beam, counted on past the end of a scan; row in the previous scan or -1; velocity, m/s;
scans that showed motion; extent, m; how far a leg may soon be ahead of its person, m. A row whose last beam is before
its first one is empty: it was joined to another one."""


class Looks(NamedTuple):
    """The scans of a window, each in a slot.

    Attributes:
        frames: (slots, 6) time, s, place of the laser, m, and pose of the base, m, rad.
        ends: (slots, n, 2) places of the echoes, m, in the order of the bearings; of a beam without one, of its end.
        reads: (slots, n) distances of the ends from the laser, m; negative without an echo, NaN without a reading.
        images: (slots, bins) nearest beam in each direction, counted from the laser; -1 for none.
        labels: (slots, n) row of the cluster of each beam; -1 for none.
        clusters: (slots, MOST_CLUSTERS, 10) see `X` and so on.
        counts: (slots,) number of clusters.
    """

    frames: Floats
    ends: Floats
    reads: Floats
    images: Integers
    labels: Integers
    clusters: Floats
    counts: Integers


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def direction(dx, dy, bins):  # type: ignore[no-untyped-def]
    return int((math.atan2(dy, dx) / (2.0 * math.pi) + 0.5) * bins) % bins


@njit(cache=True, nogil=True, error_model="numpy")
def enter_scan(slot, poses, origins, bearings, ranges, range_max, order, looks):  # type: ignore[no-untyped-def]
    """Fill ends, reads and image of a slot."""
    bins = looks.images.shape[1]
    looks.images[slot, :] = -1
    for k in range(order.shape[0]):
        i = order[k]
        if math.isnan(ranges[i]):
            looks.reads[slot, k] = math.nan
            continue
        reach = min(ranges[i], range_max)
        cos, sin = math.cos(poses[i, 2]), math.sin(poses[i, 2])
        x, y = origins[i, 0] + reach * math.cos(bearings[i]), origins[i, 1] + reach * math.sin(bearings[i])
        px, py = poses[i, 0] + cos * x - sin * y, poses[i, 1] + sin * x + cos * y
        dx, dy = px - looks.frames[slot, 1], py - looks.frames[slot, 2]
        far = math.hypot(dx, dy)
        looks.ends[slot, k, 0], looks.ends[slot, k, 1] = px, py
        looks.reads[slot, k] = far if ranges[i] < range_max else -far
        row = direction(dx, dy, bins)
        held = looks.images[slot, row]
        if held < 0 or far < abs(looks.reads[slot, held]):
            looks.images[slot, row] = k


@njit(cache=True, nogil=True, error_model="numpy")
def find_clusters(slot, limits, looks):  # type: ignore[no-untyped-def]
    """Fill the clusters of a slot. `limits` is standard deviation, m, largest speed, m/s, rad between two beams."""
    ends, reads, labels, found = looks.ends[slot], looks.reads[slot], looks.labels[slot], looks.clusters[slot]
    labels[:] = -1
    beams, count, first, last, members, extent = reads.shape[0], 0, 0, -1, 0, 0.0
    sum_x, sum_y = 0.0, 0.0
    start = _first_beam(ends, reads, limits)
    for k in range(start, start + beams + 1):
        i, is_end = k % max(1, beams), k == start + beams
        # A beam without an echo does not end a cluster: a dark or bright spot loses some.
        if not is_end and not reads[i] > 0.0:
            continue
        if not is_end and last >= 0 and _are_neighbours(ends, reads, i, last % beams, limits):
            last, members = k, members + 1
            sum_x, sum_y = sum_x + ends[i, 0], sum_y + ends[i, 1]
            extent = max(extent, math.hypot(ends[i, 0] - ends[first % beams, 0], ends[i, 1] - ends[first % beams, 1]))
            continue
        if (
            members >= LEAST_BEAMS and extent <= WIDEST and reads[first % beams] <= FARTHEST and count < MOST_CLUSTERS
        ):  # fmt: skip
            found[count, X], found[count, Y] = sum_x / members, sum_y / members
            found[count, FIRST], found[count, LAST], found[count, EXTENT] = first, last, extent
            found[count, SWING] = 0.0
            for member in range(first, last + 1):
                if reads[member % beams] > 0.0:
                    labels[member % beams] = count
            count += 1
        if not is_end:
            first, last, members, extent = k, k, 1, 0.0
            sum_x, sum_y = ends[i, 0], ends[i, 1]
    looks.counts[slot] = count
    for row in range(count):
        other = _leg_beside(found, count, row)
        if other > row and _leg_beside(found, count, other) == row:
            _join(found, labels, row, other)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _are_neighbours(ends, reads, i, j, limits):  # type: ignore[no-untyped-def]
    """Whether two echoes belong to one cluster if no other echo is between them."""
    apart = math.hypot(ends[i, 0] - ends[j, 0], ends[i, 1] - ends[j, 1])
    return apart <= JUMP * limits[0] + BEAMS_APART * limits[2] * min(reads[i], reads[j])


@njit(cache=True, nogil=True, error_model="numpy")
def _first_beam(ends, reads, limits):  # type: ignore[no-untyped-def]
    """A beam at which a cluster begins: what is seen by the first and last beams of a full turn is one cluster."""
    before = -1
    for k in range(reads.shape[0]):
        if reads[k] > 0.0:
            if before >= 0 and not _are_neighbours(ends, reads, k, before, limits):
                return k
            before = k
    return 0


@njit(cache=True, nogil=True, error_model="numpy")
def _leg_beside(clusters, count, row):  # type: ignore[no-untyped-def]
    """Row of the thin cluster that is nearest to a thin one, within a stride; -1 for none."""
    best, found = STRIDE, -1
    if clusters[row, EXTENT] > THIN or clusters[row, LAST] < clusters[row, FIRST]:
        return -1
    for other in range(count):
        if other == row or clusters[other, EXTENT] > THIN or clusters[other, LAST] < clusters[other, FIRST]:
            continue
        apart = math.hypot(clusters[other, X] - clusters[row, X], clusters[other, Y] - clusters[row, Y])
        if apart < best:
            best, found = apart, other
    return found


@njit(cache=True, nogil=True, error_model="numpy")
def _join(clusters, labels, row, other):  # type: ignore[no-untyped-def]
    """Join a cluster to another one. Both count the same, however many beams see them."""
    for member in range(int(clusters[other, FIRST]), int(clusters[other, LAST]) + 1):
        if labels[member % labels.shape[0]] == other:
            labels[member % labels.shape[0]] = row
    clusters[row, X] = 0.5 * (clusters[row, X] + clusters[other, X])
    clusters[row, Y] = 0.5 * (clusters[row, Y] + clusters[other, Y])
    clusters[row, FIRST] = min(clusters[row, FIRST], clusters[other, FIRST])
    clusters[row, LAST] = max(clusters[row, LAST], clusters[other, LAST])
    # Joined only once, and continued by none.
    clusters[row, EXTENT], clusters[row, SWING] = WIDEST, 0.5 * STRIDE
    clusters[other, FIRST], clusters[other, LAST] = 0, -1
    clusters[other, X], clusters[other, Y] = math.inf, math.inf


@njit(cache=True, nogil=True, error_model="numpy")
def share_within(slot, row, other, near, limits, looks):  # type: ignore[no-untyped-def]
    """Share of the echoes of a cluster in one slot that lie in space that the scan of another slot saw through."""
    cluster, inside, count = looks.clusters[slot, row], 0, 0
    first, last = int(cluster[FIRST]), int(cluster[LAST])
    stride = max(1, (last - first + 1) // TESTED)
    for member in range(first, last + 1, stride):
        k = member % looks.labels.shape[1]
        if looks.labels[slot, k] == row:
            count += 1
            inside += _is_seen_through(looks.ends[slot, k, 0], looks.ends[slot, k, 1], other, near, limits[2], looks)
    return inside / count if count else 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def _is_seen_through(px, py, slot, near, step, looks):  # type: ignore[no-untyped-def]
    """Whether the beams of a scan pass a place, and no echo, or line between two echoes, is near it."""
    ends, reads, image = looks.ends[slot], looks.reads[slot], looks.images[slot]
    bins = image.shape[0]
    dx, dy = px - looks.frames[slot, 1], py - looks.frames[slot, 2]
    far = math.hypot(dx, dy)
    row, close, beams = direction(dx, dy, bins), near[0] + near[1] * far, 0
    for side in range(-1, 2):
        k = image[(row + side) % bins]
        if k >= 0:
            beams += 1
            if abs(reads[k]) < far + close:
                return False
    if beams == 0:
        return False
    wide = min(bins // 4, int(close / (far * step)) + 2)
    # Near the laser, beams are denser than needed.
    stride, last = max(1, wide // 8), -1
    for offset in range(-wide, wide + 1, stride):
        k = image[(row + offset) % bins]
        if k < 0 or reads[k] < 0.0:
            continue
        if _distance_to_line(px, py, ends[k], ends[last] if last >= 0 else ends[k]) < close:
            return False
        last = k
    return True


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _distance_to_line(px, py, start, end):  # type: ignore[no-untyped-def]
    """Distance of a place from the line between two places (2,), m."""
    ux, uy, rx, ry = end[0] - start[0], end[1] - start[1], px - start[0], py - start[1]
    square = ux * ux + uy * uy
    share = min(max((rx * ux + ry * uy) / square, 0.0), 1.0) if square > 0.0 else 0.0
    return math.hypot(rx - share * ux, ry - share * uy)

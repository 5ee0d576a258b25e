"""Memory of laser echoes: points in the pose frame at the laser's resolution, forgotten when the laser sees past."""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from navloom_avoidance.beams import Beams
from navloom_avoidance.certainty import THIN_BEAM
from navloom_avoidance.clearance import outside_distance

BESIDE = 0.05  # m: a beam that passes a remembered point at a greater distance gives no information on it
TOUCH = 1.0e-6  # m: a point within its margin is treated as this far outside of it
BEHIND = 0.1  # m: a beam that ends this far before a remembered point hit something else


@njit(cache=True, nogil=True)
def nearest_beam(bearings: NDArray[np.float64], bearing: float) -> int:
    """Index of the beam with the nearest bearing, rad; `bearings` rise, and both are within the same turn."""
    low, high = 0, bearings.size - 1
    while high - low > 1:
        middle = (low + high) // 2
        if bearings[middle] <= bearing:
            low = middle
        else:
            high = middle
    return low if bearing - bearings[low] <= bearings[high] - bearing else high


@njit(cache=True, nogil=True)
def is_superseded(
    x: float,
    y: float,
    origins: NDArray[np.float64],
    bearings: NDArray[np.float64],
    axes: NDArray[np.float64],
    ranges: NDArray[np.float64],
    range_max: float,
) -> bool:
    """Whether a scan sees a remembered point again, or sees past it.

    Args:
        x, y: m, base frame. origins: (n, 2), m; bearings: (n,), rad, rising; axes: (n, 2), cosine and sine of each.
        ranges: (n,), m. range_max: m.
    """
    bearing = math.atan2(y - origins[0, 1], x - origins[0, 0])
    if bearing < bearings[0]:
        bearing += 2.0 * math.pi
    i = nearest_beam(bearings, bearing)
    dx, dy = x - origins[i, 0], y - origins[i, 1]
    c, s = axes[i, 0], axes[i, 1]
    along = dx * c + dy * s
    return bool(along > 0.0 and abs(dy * c - dx * s) <= BESIDE and min(ranges[i], range_max) > along - BEHIND)


@njit(cache=True, nogil=True)
def remember(
    points: NDArray[np.float64],
    count: int,
    pose: tuple[float, float, float],
    origins: NDArray[np.float64],
    bearings: NDArray[np.float64],
    ranges: NDArray[np.float64],
    range_max: float,
    time: float,
    memory: float,
    reach: float,
    spacing: float,
    edges: NDArray[np.float64],
) -> int:
    """Enter all points of one scan, and keep the older points that it does not see and that are not too old.

    Args:
        points: (N, 3), x, y, m, pose frame, and the time seen, s; changed in place. When full, the oldest are lost.
        count: Rows in use.
        pose: x, y, m, heading, rad, of the base.
        origins, bearings, ranges, range_max: As for is_superseded(). If bearings do not rise, no point is superseded.
        time: Current time, s. memory: Greatest age of a point, s. reach: Greatest distance of a point from the base, m.
        spacing: One older point is kept per square of this side, m.
        edges: Footprint: clearance.footprint_edges(). Older points deep inside it are forgotten.

    Returns:
        Rows in use.
    """
    x, y, heading = pose
    c, s = math.cos(heading), math.sin(heading)
    rises = bearings.size > 1
    for i in range(1, bearings.size):
        rises = rises and bearings[i] > bearings[i - 1]
    side = int(2.0 * reach / spacing) + 2
    taken = np.zeros((side, side), np.bool_)
    old = points[:count].copy()
    kept = 0
    axes = np.empty((bearings.size, 2))
    for i in range(bearings.size):
        axes[i, 0], axes[i, 1] = math.cos(bearings[i]), math.sin(bearings[i])
    for i in range(ranges.size):
        if not 0.0 < ranges[i] < range_max:
            continue
        bx, by = origins[i, 0] + ranges[i] * axes[i, 0], origins[i, 1] + ranges[i] * axes[i, 1]
        if bx * bx + by * by > reach * reach or kept >= points.shape[0]:
            continue
        points[kept, 0], points[kept, 1], points[kept, 2] = x + bx * c - by * s, y + bx * s + by * c, time
        taken[int((points[kept, 1] - y + reach) / spacing), int((points[kept, 0] - x + reach) / spacing)] = True
        kept += 1
    for i in range(old.shape[0]):
        dx, dy = old[i, 0] - x, old[i, 1] - y
        if time - old[i, 2] > memory or dx * dx + dy * dy > reach * reach or kept >= points.shape[0]:
            continue
        row, column = int((dy + reach) / spacing), int((dx + reach) / spacing)
        bx, by = dx * c + dy * s, dy * c - dx * s
        if taken[row, column] or outside_distance(edges, bx, by) < -BESIDE:
            continue
        if rises and is_superseded(bx, by, origins, bearings, axes, ranges, range_max):
            continue
        taken[row, column] = True
        points[kept] = old[i]
        kept += 1
    return kept


@njit(cache=True, nogil=True)
def obstacles_in_base(
    points: NDArray[np.float64],
    cells: NDArray[np.float64],
    arc_reach: float,
    pose: tuple[float, float, float],
    edges: NDArray[np.float64],
    margins: tuple[float, float],
    reach: float,
    obstacles: NDArray[np.float64],
    gaps: NDArray[np.float64],
) -> int:
    """Collect the obstacles near the footprint, nearest first, with the margin to keep to each.

    An obstacle nearer than its margin has its distance as margin: the robot may move away but not come nearer.

    Args:
        points: (n, 3), m, pose frame, from remember(). cells: (k, 3), m, base frame, and certainty.
        arc_reach: Cells of sonar arcs, certainty 2, count up to this distance from the base, m.
        pose, edges: As for remember(). margins: Margins for points and for cells, m.
        reach: Greatest distance beyond a side of the footprint, m.
        obstacles: (N, 3), filled in: x, y, margin, m, base frame.
        gaps: (N,), filled in: distance beyond a side, m, rising.

    Returns:
        Rows filled.
    """
    x, y, heading = pose
    c, s = math.cos(heading), math.sin(heading)
    total = points.shape[0] + cells.shape[0]
    found, distance = np.empty((total, 3)), np.empty(total)
    count = 0
    for i in range(total):
        if i < points.shape[0]:
            dx, dy = points[i, 0] - x, points[i, 1] - y
            bx, by, margin = dx * c + dy * s, dy * c - dx * s, margins[0]
        else:
            k = i - points.shape[0]
            bx, by, margin = cells[k, 0], cells[k, 1], margins[1]
            if cells[k, 2] < 3.0 and bx * bx + by * by > arc_reach * arc_reach:
                continue
        gap = outside_distance(edges, bx, by)
        if gap <= reach:
            found[count, 0], found[count, 1], found[count, 2] = bx, by, min(margin, gap - TOUCH)
            distance[count] = gap
            count += 1
    order = np.argsort(distance[:count])
    count = min(count, gaps.size)
    for i in range(count):
        obstacles[i] = found[order[i]]
        gaps[i] = distance[order[i]]
    return count


@njit(cache=True, nogil=True)
def points_in_base(
    points: NDArray[np.float64],
    pose: tuple[float, float, float],
    reach: float,
    spacing: float,
    certainty: float,
    cells: NDArray[np.float64],
) -> int:
    """Points near the robot as cells of full certainty, one in a square, the newest first.

    Args:
        points: (n, 3), m, pose frame, from remember(). pose: x, y, m, heading, rad, of the base.
        reach: Points farther than this from the base are left out, m. spacing: Side of a square, m.
        certainty: Written into the third column.
        cells: (N, 3), filled in: x, y, m, base frame, and certainty.

    Returns:
        Rows filled.
    """
    x, y, heading = pose
    c, s = math.cos(heading), math.sin(heading)
    side = int(2.0 * reach / spacing) + 2
    taken = np.zeros((side, side), np.bool_)
    count = 0
    for i in range(points.shape[0]):
        dx, dy = points[i, 0] - x, points[i, 1] - y
        if dx * dx + dy * dy > reach * reach or count >= cells.shape[0]:
            continue
        bx, by = dx * c + dy * s, dy * c - dx * s
        row, column = int((by + reach) / spacing), int((bx + reach) / spacing)
        if taken[row, column]:
            continue
        taken[row, column] = True
        cells[count, 0], cells[count, 1], cells[count, 2] = bx, by, certainty
        count += 1
    return count


class EchoMemory:
    """Echo points of all lasers of a robot; a laser is a sensor whose beams are all thin.

    Args:
        edges: Footprint: clearance.footprint_edges(). memory: How long points out of sight count, s.
        reach: Points farther from the base are dropped, m. spacing: One older point is kept in a square of this, m.
        capacity: Most points; the oldest are lost.

    Attributes:
        beam_spacing: Largest angle between neighbouring beams, rad: what a laser sees may reach that much farther.
    """

    def __init__(
        self, edges: NDArray[np.float64], memory: float, reach: float, spacing: float = 0.03, capacity: int = 8192
    ) -> None:
        self._edges, self._memory, self._reach, self._spacing = edges, memory, reach, spacing
        self._points = np.zeros((capacity, 3))
        self._known: NDArray[np.int64] | None = None
        self.forget()

    def forget(self) -> None:
        """Forget all points."""
        self._count = 0
        self.beam_spacing = 0.0

    @property
    def points(self) -> NDArray[np.float64]:
        """(n, 3), x, y, m, pose frame, and the time seen, s."""
        return self._points[: self._count]

    def enter(self, beams: Beams, pose: tuple[float, float, float], time: float) -> Beams | None:
        """Enter the lasers' readings of a tick, at a time, s; return the beams of the other sensors, None for none."""
        if beams.sensors is not self._known:
            self._known = beams.sensors
            numbers = np.unique(beams.sensors)
            thin = [n for n in numbers if (beams.half_angles[beams.sensors == n] < THIN_BEAM).all()]
            self._lasers = [np.flatnonzero(beams.sensors == n) for n in thin]
            bearings = [np.diff(np.sort(beams.bearings[index])) for index in self._lasers if index.size > 1]
            self.beam_spacing = max((float(np.median(steps)) for steps in bearings), default=0.0)
            self._others = np.flatnonzero(~np.isin(beams.sensors, thin))
        for index in self._lasers:
            laser = slice(index[0], index[-1] + 1)
            self._count = remember(
                self._points, self._count, pose, beams.origins[laser], beams.bearings[laser], beams.ranges[laser],
                float(beams.limits[index[0], 1]), time, self._memory, self._reach, self._spacing, self._edges,
            )  # fmt: skip
        if self._others.size == 0:
            return None
        rest = self._others
        return Beams.fixed(
            beams.origins[rest], beams.bearings[rest], beams.half_angles[rest], beams.ranges[rest],
            beams.limits[rest], beams.sensors[rest],
        )  # fmt: skip

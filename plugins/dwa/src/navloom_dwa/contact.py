"""Exact time at which a footprint on an arc meets a point, for a convex polygon and for a disc.

Fox et al. 1997 use the distance along the arc for a round robot; for polygons see Arras, Persson, Tomatis, Siegwart,
*Real-Time Obstacle Avoidance for Polygonal Robots with a Reduced Dynamic Window*, ICRA 2002. The robot turns about its
centre of rotation (0, v / w); in the robot's frame, a static point turns about the same centre the other way.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

TURN = 2.0 * math.pi
STRAIGHT = 1.0e-6  # rad/m: an arc of less curvature is treated as a line


@njit(cache=True, nogil=True)
def line_contact(x: float, y: float, edges: NDArray[np.float64], margin: float, v: float) -> float:
    """polygon_contact() for a robot that drives straight."""
    enter, leave = 0.0, np.inf
    for k in range(edges.shape[0]):
        gap, rate = edges[k, 0] * x + edges[k, 1] * y - edges[k, 2] - margin, edges[k, 0] * v
        if rate > 0.0:
            enter = max(enter, gap / rate)
        elif rate < 0.0:
            leave = min(leave, gap / rate)
        elif gap > 0.0:
            return np.inf
    return enter if enter <= leave else np.inf


@njit(cache=True, nogil=True)
def polygon_contact(
    x: float, y: float, edges: NDArray[np.float64], margin: float, v: float, w: float, least_cosine: float = -2.0
) -> float:
    """Time until a point comes within the margin of a convex footprint on its arc.

    Args:
        x, y: The point, outside the footprint by more than the margin, m, base frame.
        edges: (k, 3), outward unit normal and offset of each side, m: clearance.footprint_edges().
        margin: Each side is moved out by this, m; corners stay sharp.
        v, w: Constant speed, m/s, and turn rate, rad/s; not both 0.
        least_cosine: From cosine_until(): later contacts may be ignored, which saves the arctangent for most points.

    Returns:
        Time, s; +inf where the point's circle never meets the footprint.
    """
    if abs(w) <= STRAIGHT * abs(v):
        return line_contact(x, y, edges, margin, v)
    centre = v / w
    qx, qy = x, y - centre
    rho = math.sqrt(qx * qx + qy * qy)
    if rho == 0.0:
        return np.inf
    sign = 1.0 if w > 0.0 else -1.0
    best = np.inf
    for i in range(edges.shape[0]):
        nx, ny = edges[i, 0], edges[i, 1]
        height = (edges[i, 2] + margin - ny * centre) / rho
        if height >= 1.0:
            continue  # the whole circle is inside this side
        if height <= -1.0:
            return np.inf
        across = sign * math.sqrt(1.0 - height * height)
        ux, uy = height * nx + across * ny, height * ny - across * nx  # where the circle enters this half plane
        along = qx * ux + qy * uy
        # Later than the best so far.
        if along < least_cosine * rho:
            continue
        inside = True
        for j in range(edges.shape[0]):
            if j != i:
                beyond = rho * (edges[j, 0] * ux + edges[j, 1] * uy) + edges[j, 1] * centre - edges[j, 2] - margin
                # A contact exactly at a corner belongs to both sides; rounding must not lose it on both.
                if beyond > 1.0e-9:
                    inside = False
                    break
        if inside:
            angle = (-sign * math.atan2(qx * uy - qy * ux, along)) % TURN
            # Just before a full turn is a contact now.
            best = min(best, 0.0 if angle > TURN - 1.0e-9 else angle)
    return best / abs(w)


@njit(cache=True, nogil=True)
def cosine_until(angle: float) -> float:
    """Cosine below which a turn is longer than an angle, rad, for sure; -2, below every cosine, from pi on."""
    return math.cos(angle) - 1.0e-9 if angle < math.pi else -2.0


@njit(cache=True, nogil=True)
def disc_contact(x: float, y: float, radius: float, v: float, w: float) -> float:
    """Time, s, until a point is within `radius`, m, of the base; other arguments as for polygon_contact().

    Law of cosines: the base, |v / w| from the centre of rotation, and the point, at rho, are `radius` apart at a known
    angle.
    """
    if x * x + y * y <= radius * radius:
        return 0.0
    if abs(w) <= STRAIGHT * abs(v):
        along = x if v > 0.0 else -x
        if abs(y) >= radius or along <= 0.0:
            return np.inf
        return (along - math.sqrt(radius * radius - y * y)) / abs(v)
    centre = v / w
    rho = math.hypot(x, y - centre)
    if rho == 0.0 or centre == 0.0:
        return np.inf
    cosine = (centre * centre + rho * rho - radius * radius) / (2.0 * abs(centre) * rho)
    if abs(cosine) >= 1.0:
        return np.inf
    ahead = math.atan2(centre * x, -centre * (y - centre)) * (1.0 if w > 0.0 else -1.0)
    return ((ahead - math.acos(cosine)) % TURN) / abs(w)


def enlarged_corners(edges: NDArray[np.float64], margin: float) -> NDArray[np.float64]:
    """(k, 2) corners, m, of a convex footprint with edges (k, 3) after each side is moved out by the margin, m."""
    before = np.roll(edges, 1, axis=0)
    determinant = before[:, 0] * edges[:, 1] - before[:, 1] * edges[:, 0]
    first, second = before[:, 2] + margin, edges[:, 2] + margin
    x = (first * edges[:, 1] - second * before[:, 1]) / determinant
    y = (second * before[:, 0] - first * edges[:, 0]) / determinant
    return np.ascontiguousarray(np.column_stack((x, y)))


@njit(cache=True, nogil=True)
def annulus(
    corners: NDArray[np.float64], edges: NDArray[np.float64], margin: float, centre: float
) -> tuple[float, float]:
    """Squares of the least and greatest distance, m^2, of a footprint with its margin from (0, centre).

    Args:
        corners: (k, 2), m, from enlarged_corners(). edges: (k, 3), m, without the margin. margin, centre: m.
    """
    far, near = 0.0, 0.0
    for k in range(corners.shape[0]):
        far = max(far, math.hypot(corners[k, 0], corners[k, 1] - centre))
        near = max(near, edges[k, 1] * centre - edges[k, 2] - margin)
    return near * near, far * far


@njit(cache=True, nogil=True)
def first_contacts(
    points: NDArray[np.float64],
    gaps: NDArray[np.float64],
    corners: NDArray[np.float64],
    edges: NDArray[np.float64],
    radius: float,
    is_disc: bool,
    margin: float,
    arcs: NDArray[np.float64],
    longest: float,
    times: NDArray[np.float64],
) -> None:
    """Compute the first contact on each arc with any point, at the speeds given for the arc.

    Args:
        points: (n, 3), x, y, m, base frame, and the margin of each, m; nearest first.
        gaps: (n,), distance of each point beyond a side of the footprint, m, rising.
        corners: (k, 2), m, from enlarged_corners(). edges: (k, 3) of the footprint, m.
        radius: Radius of the disc about the base that encloses the footprint, m.
        is_disc: Whether contact is with that disc.
        margin: Greatest margin of all points, m.
        arcs: (m, >= 2), v, m/s, and w, rad/s.
        longest: Contacts later than this do not count, s.
        times: (m,), filled in, s; +inf for no contact.
    """
    reach = 0.0
    for k in range(corners.shape[0]):
        reach = max(reach, math.hypot(corners[k, 0], corners[k, 1]))
    slack = radius - edges[:, 2].min() if is_disc else 0.0  # the disc reaches beyond the sides
    for j in range(arcs.shape[0]):
        v, w = arcs[j, 0], arcs[j, 1]
        fastest = abs(v) + abs(w) * reach
        is_line = abs(w) <= STRAIGHT * abs(v)
        centre = 0.0 if is_line else v / w
        near, far = annulus(corners, edges, margin, centre)
        best, least_cosine = longest, cosine_until(longest * abs(w))
        for i in range(points.shape[0]):
            # Points are sorted by their gaps: none that follows can be met earlier.
            if gaps[i] - slack - margin >= best * fastest:
                break
            x, y = points[i, 0], points[i, 1]
            if is_disc:
                time = disc_contact(x, y, radius + points[i, 2], v, w)
            else:
                if not is_line:
                    square = x * x + (y - centre) * (y - centre)
                    # A point whose circle misses the footprint's ring is sorted out without a root.
                    if square < near or square > far:
                        continue
                time = polygon_contact(x, y, edges, points[i, 2], v, w, least_cosine)
            if time < best:
                best, least_cosine = time, cosine_until(time * abs(w))
        times[j] = best if best < longest else np.inf

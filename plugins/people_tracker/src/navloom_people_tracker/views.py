"""What earlier scans saw through: the evidence that something moves.

A place that a beam passed was free. An echo there now is of something that came; if a beam passes the place of an
earlier echo now, that body has left. Parts of walls that come into view from behind something were never seen
through, so they give no evidence, however their visible parts shift while the robot drives and turns.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["View", "are_fresh", "cover", "looked_through", "place_beams", "view_of"]

Floats = NDArray[np.float64]

NO_ECHO = 0.9
"""Share of the range to which a beam without an echo shows free space: echoes from the end are weak."""


class View(NamedTuple):
    """How far one scan saw, by direction.

    Attributes:
        time: Run time, s.
        driven, turned: Way, m, and angles, rad, of the robot since its start, all counted positive.
        x, y: Place of the sensor, m, odometry frame.
        near: (bins,) shortest beam in each direction of a full turn from the x axis, m; NaN where no beam looked, and
            negative without an echo: then nothing is known of its end.
    """

    time: float
    driven: float
    turned: float
    x: float
    y: float
    near: Floats


@njit(cache=True, nogil=True, error_model="numpy")
def place_beams(poses, origins, bearings, ranges, limits, out):  # type: ignore[no-untyped-def]
    """Origins and ends of beams in the frame of the poses.

    Args:
        poses: (n, 3) pose of base at the time of each beam: x, y, m, heading, rad.
        origins, bearings, ranges: (n, 2) m, (n,) rad, base frame, and (n,) m.
        limits: (2,) readings up to the first are the robot's own or noise, and are left out; from the second on they
            are no echo, m.
        out: (n, 5) x, y, m, of origin, and of end; 1 for an echo, 0 for none, -1 for a beam that is left out.
    """
    for i in range(ranges.shape[0]):
        c, s = math.cos(poses[i, 2]), math.sin(poses[i, 2])
        x = poses[i, 0] + c * origins[i, 0] - s * origins[i, 1]
        y = poses[i, 1] + s * origins[i, 0] + c * origins[i, 1]
        is_echo = ranges[i] < limits[1]
        reach = ranges[i] if is_echo else NO_ECHO * limits[1]
        turn = poses[i, 2] + bearings[i]
        out[i, 0], out[i, 1] = x, y
        out[i, 2], out[i, 3] = x + reach * math.cos(turn), y + reach * math.sin(turn)
        out[i, 4] = (1.0 if is_echo else 0.0) if ranges[i] > limits[0] else -1.0


@njit(cache=True, nogil=True, error_model="numpy")
def _near(beams, x, y, near):  # type: ignore[no-untyped-def]
    near[:] = np.nan
    bins = near.shape[0]
    for i in range(beams.shape[0]):
        if beams[i, 4] < 0.0:
            continue
        dx, dy = beams[i, 2] - x, beams[i, 3] - y
        k = int((math.atan2(dy, dx) / (2.0 * math.pi) + 1.0) * bins) % bins
        far = math.hypot(dx, dy)
        if not abs(near[k]) < far:
            near[k] = far if beams[i, 4] > 0.0 else -far


def view_of(time: float, way: tuple[float, float], eye: tuple[float, float], beams: Floats, bins: int) -> View:
    """The view of a scan.

    Args:
        time: s. way: `driven` and `turned` of the view, m and rad. eye: Place of the sensor, m.
        beams: (n, 5) as those of `place_beams`.
        bins: Number of directions in a full turn.
    """
    near = np.empty(bins)
    _near(beams, *eye, near)
    return View(time, *way, *eye, near)


@njit(cache=True, nogil=True, error_model="numpy")
def _passes(near, x, y, px, py, margin):  # type: ignore[no-untyped-def]
    """1 if all beams through a disc round a point end beyond it, -1 if one ends in it, else 0."""
    bins = near.shape[0]
    dx, dy = px - x, py - y
    far = math.hypot(dx, dy)
    if far <= margin:
        return 0
    k = int((math.atan2(dy, dx) / (2.0 * math.pi) + 1.0) * bins) % bins
    # Beside the point too: with the drift of the odometry, what stands there may appear here.
    half = min(1 + int(margin / far * bins / (2.0 * math.pi)), bins // 4)
    seen, passed, at = 0, 0, 0
    for side in range(-half, half + 1):
        reach = near[(k + side) % bins]
        if math.isnan(reach):
            continue
        seen += 1
        passed += abs(reach) > far + margin
        at += abs(reach - far) <= margin
    if at:
        return -1
    return 1 if seen > 1 and passed == seen else 0


@njit(cache=True, nogil=True, error_model="numpy")
def looked_through(near, x, y, points, margins, found):  # type: ignore[no-untyped-def]
    """What a view says of points: 1 if it looks through the place, -1 if an echo was there, 0 if it does not tell.

    Args:
        near, x, y: Attributes of a `View`.
        points: (n, 2) m; NaN for none, of which it tells nothing.
        margins: (n, 2) radius of the disc round each point, m, and what is added to that for each m away.
        found: (n,) output.
    """
    for i in range(points.shape[0]):
        found[i] = 0
        if not math.isnan(points[i, 0]):
            far = math.hypot(points[i, 0] - x, points[i, 1] - y)
            found[i] = _passes(near, x, y, points[i, 0], points[i, 1], margins[i, 0] + margins[i, 1] * far)


@njit(cache=True, nogil=True, error_model="numpy")
def are_fresh(nears, eyes, margins, are_old, points, found):  # type: ignore[no-untyped-def]
    """Whether a view looked through the place of each echo, and no old one after that shows that something stood there.

    Args:
        nears, eyes: (k, bins) and (k, 2) `near`, and x, y, m, of the views, the oldest first.
        margins: (k, 2) as those of `looked_through`, of each view.
        are_old: (k,) which views tell that something stood.
        points: (n, 2) m.
        found: (n,) output.
    """
    for i in range(points.shape[0]):
        found[i] = False
        for k in range(nears.shape[0]):
            x, y = eyes[k, 0], eyes[k, 1]
            far = math.hypot(points[i, 0] - x, points[i, 1] - y)
            said = _passes(nears[k], x, y, points[i, 0], points[i, 1], margins[k, 0] + margins[k, 1] * far)
            if said > 0:
                found[i] = True
            elif said < 0 and are_old[k]:
                found[i] = False


@njit(cache=True, nogil=True, error_model="numpy")
def cover(near, x, y, places, radii, found):  # type: ignore[no-untyped-def]
    """Whether a view shows the places of discs to be empty (1) or hidden (-1), or has echoes there (0).

    Args:
        near, x, y: Attributes of a `View`. places, radii: (n, 2) centres, m, and (n,) m, same frame.
        found: (n,) output; a place in a direction without a beam is hidden.
    """
    bins = near.shape[0]
    for i in range(places.shape[0]):
        dx, dy = places[i, 0] - x, places[i, 1] - y
        far = max(math.hypot(dx, dy), 1e-3)
        middle = int((math.atan2(dy, dx) / (2.0 * math.pi) + 1.0) * bins) % bins
        half = min(int(radii[i] / far * bins / (2.0 * math.pi)), bins // 4)
        beyond, at, before = 0, 0, 0
        for side in range(-half, half + 1):
            reach = near[(middle + side) % bins]
            if math.isnan(reach):
                continue
            if abs(reach) > far + radii[i] + 0.1:
                beyond += 1
            elif reach < far - radii[i] - 0.1:  # also without an echo: it is not seen so far
                before += 1
            else:
                at += 1
        total = beyond + at + before
        if total == 0 or 2 * before >= total:
            found[i] = -1
        else:
            found[i] = 1 if beyond > at else 0

"""Projects a robot's pose onto its trajectory: the reference point that every controller tracks."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from navloom.geometry.world import read_only

__all__ = ["Projection", "point_at", "project", "warm_up", "way_ahead"]

Floats = NDArray[np.float64]

_HEADING_WEIGHT = 0.5
"""Penalty distance of a part of the trajectory that runs against the robot's heading, m (times sqrt 2)."""


class Projection(NamedTuple):
    """The reference of a pose.

    Attributes:
        progress: Arc length of the reference point, m.
        x, y, heading: Reference pose, m, rad in [-π, π), in the frame of the samples.
        curvature: κ, 1/m.
        speed: v_r, m/s.
        turn_rate: ω_r = κ v_r, rad/s.
        cross_track: Distance of the robot from the trajectory, m, positive to the left.
        target_x, target_y: Point one look-ahead farther along, m.
    """

    progress: float
    x: float
    y: float
    heading: float
    curvature: float
    speed: float
    turn_rate: float
    cross_track: float
    target_x: float
    target_y: float


def project(
    samples: Floats,
    x: float,
    y: float,
    heading: float,
    progress: float,
    look_ahead: float,
    back: float = 0.5,
    ahead: float = 1.0,
) -> Projection:
    """The point of a trajectory nearest to a pose, near the previous reference point.

    Within the window, each local minimum of the distance is a candidate. The nearest candidate wins, where a part whose
    heading differs from the robot's counts as farther away: this avoids the other leg of a hairpin. At the foot point
    the robot is exactly abeam (e1 of eq. (4) of Hoang et al. 2013 is 0); it moves continuously with the robot.

    Args:
        samples: (n, 6) of `trajectory.SmoothPath`, n >= 1, equal steps of arc length.
        x, y, heading: Pose, m, rad, in the frame of the samples.
        progress: Previous progress, m; 0 for a new trajectory.
        look_ahead: Arc length from the reference point to the target, m; the target does not pass the end.
        back, ahead: How much smaller or larger than the previous progress the new one may be, m.
    """
    return Projection(*_project(read_only(samples), x, y, heading, progress, look_ahead, back, ahead))


def point_at(samples: Floats, progress: float) -> tuple[float, float]:
    """x, y, m, of a trajectory (n, 6) at an arc length, m; clamped to its ends."""
    point: tuple[float, float] = _point_at(read_only(samples), progress)
    return point


def way_ahead(samples: Floats, progress: float, length: float, step: float = 0.2) -> Floats:
    """(k, 2) points, m, of a trajectory (n, 6) from an arc length to `length` farther, about `step` apart, m.

    Read-only. Near the end of the trajectory there are fewer points, but always at least one.
    """
    points: Floats = _way_ahead(read_only(samples), progress, length, step)
    # It becomes part of a message as it is.
    points.setflags(write=False)
    return points


@njit(cache=True, nogil=True, error_model="numpy")
def _way_ahead(samples, progress, length, step):  # type: ignore[no-untyped-def]
    end = min(progress + length, samples[-1, 0])
    # Rounding must not add a point to a length of exactly some steps.
    count = max(1, math.ceil((end - progress) / step - 1e-9) + 1) if end > progress else 1
    points = np.empty((count, 2))
    for k in range(count):
        s = progress if count == 1 else progress + (end - progress) * k / (count - 1)
        points[k, 0], points[k, 1] = _point_at(samples, s)
    return points


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _wrap(angle):  # type: ignore[no-untyped-def]
    return angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))


@njit(cache=True, nogil=True, error_model="numpy")
def _step(samples):  # type: ignore[no-untyped-def]
    return samples[-1, 0] / (samples.shape[0] - 1) if samples.shape[0] > 1 else 1.0


@njit(cache=True, nogil=True, error_model="numpy")
def _point_at(samples, progress):  # type: ignore[no-untyped-def]
    last = samples.shape[0] - 1
    place = min(max(progress / _step(samples), 0.0), float(last))
    k = max(0, min(int(place), last - 1))
    share, after = place - k, min(k + 1, last)
    x = samples[k, 1] + share * (samples[after, 1] - samples[k, 1])
    y = samples[k, 2] + share * (samples[after, 2] - samples[k, 2])
    return x, y


@njit(cache=True, nogil=True, error_model="numpy")
def _nearest(samples, x, y, heading, first, last):  # type: ignore[no-untyped-def]
    """Index of the best candidate among samples `first` to `last`."""
    best, index = np.inf, first
    square_before = np.inf
    square = (samples[first, 1] - x) ** 2 + (samples[first, 2] - y) ** 2
    for k in range(first, last + 1):
        square_after = np.inf
        if k < last:
            square_after = (samples[k + 1, 1] - x) ** 2 + (samples[k + 1, 2] - y) ** 2
        # Only local minima: at the edge of the window, the distance may still fall beyond it.
        if square <= square_before and square < square_after:
            cost = square + _HEADING_WEIGHT**2 * (1.0 - math.cos(samples[k, 3] - heading))
            if cost < best:
                best, index = cost, k
        square_before, square = square, square_after
    return index


@njit(cache=True, nogil=True, error_model="numpy")
def _abeam(samples, k, x, y):  # type: ignore[no-untyped-def]
    """How far a point is in front of sample k, m, along the heading there."""
    return (x - samples[k, 1]) * math.cos(samples[k, 3]) + (y - samples[k, 2]) * math.sin(samples[k, 3])


@njit(cache=True, nogil=True, error_model="numpy")
def _foot(samples, k, x, y):  # type: ignore[no-untyped-def]
    """Place, in samples, where the point is abeam: between k and a neighbour, by linear interpolation."""
    front = _abeam(samples, k, x, y)
    if front >= 0.0:
        if k == samples.shape[0] - 1:
            return float(k)
        # Two samples that are abeam of the same point would divide by zero.
        return k + min(1.0, front / max(front - _abeam(samples, k + 1, x, y), 1e-12))
    if k == 0:
        return 0.0
    behind = _abeam(samples, k - 1, x, y)
    return k - min(1.0, front / min(front - behind, -1e-12))


@njit(cache=True, nogil=True, error_model="numpy")
def _project(samples, x, y, heading, progress, look_ahead, back, ahead):  # type: ignore[no-untyped-def]
    step, end = _step(samples), samples.shape[0] - 1
    # A window about the last place: where a trajectory crosses itself, the robot stays on its branch.
    lowest = min(max((progress - back) / step, 0.0), float(end))
    highest = min(max((progress + ahead) / step, lowest), float(end))
    k = _nearest(samples, x, y, heading, math.floor(lowest), math.ceil(highest))
    place = min(max(_foot(samples, k, x, y), lowest), highest)
    k = max(0, min(int(place), end - 1))
    share, after = place - k, min(k + 1, end)
    x_ref = samples[k, 1] + share * (samples[after, 1] - samples[k, 1])
    y_ref = samples[k, 2] + share * (samples[after, 2] - samples[k, 2])
    # The difference is wrapped before it is interpolated: between 179° and -179° lies 180°, not 0°.
    heading_ref = _wrap(samples[k, 3] + share * _wrap(samples[after, 3] - samples[k, 3]))
    bend = samples[k, 4] + share * (samples[after, 4] - samples[k, 4])
    speed = samples[k, 5] + share * (samples[after, 5] - samples[k, 5])
    most = max(abs(samples[k, 4] * samples[k, 5]), abs(samples[after, 4] * samples[after, 5]))
    if abs(bend) * speed > most:
        speed = most / abs(bend)  # interpolated separately, both may require more turn rate than the samples allow
    cross = math.cos(heading_ref) * (y - y_ref) - math.sin(heading_ref) * (x - x_ref)
    x_target, y_target = _point_at(samples, place * step + look_ahead)
    return place * step, x_ref, y_ref, heading_ref, bend, speed, bend * speed, cross, x_target, y_target


def warm_up() -> None:
    """Compile the kernels."""
    samples = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.2], [1.0, 1.0, 0.0, 0.0, 0.0, 0.2]])
    project(samples, 0.5, 0.1, 0.0, 0.0, 1.0)
    point_at(samples, 0.5)
    way_ahead(samples, 0.0, 1.0)

"""Turns a planner's path into the trajectory that controllers follow: pruned, rounded, sampled, with a speed profile.

The robot's heading at the start is ignored: turning onto the first segment is the controller's job. The speed never
falls to zero, since tracking laws such as eq. (6) of Hoang et al. 2013 need a moving reference: it ends at the lowest
speed, and the goal checker stops the robot.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numba import njit
from numpy.typing import NDArray

from navloom.navigation import fillets, line_of_sight
from navloom.roles import RobotSpec

__all__ = [
    "SpeedLimits",
    "SmoothPath",
    "free_samples",
    "keep_corners",
    "make_trajectory",
    "sample_path",
    "speed_profile",
    "warm_up",
]

Floats = NDArray[np.float64]
Cells = NDArray[np.bool_]

_CRAWL = 0.02
"""Speed that a limited turn acceleration leaves in the tightest corner, m/s: there the robot turns in place."""
_FINEST = 0.005
_PER_FILLET = 8.0
"""Samples on the shortest fillet, as far as steps of at least `_FINEST`, m, allow."""


@dataclass(frozen=True)
class SpeedLimits:
    """Limits of the reference.

    Attributes:
        robot: Its turn rate and accelerations are those of the reference.
        slowest, fastest: Speed, m/s. It is below `slowest` only where a tight corner and the turn rate require it.
        lateral: Largest lateral acceleration v² |κ|, m/s².
    """

    robot: RobotSpec
    slowest: float
    fastest: float
    lateral: float

    def radius_at(self, speed: float) -> float:
        """Smallest radius, m, at which a speed, m/s, keeps the limits of turn rate and lateral acceleration."""
        return max(speed / self.robot.max_angular, speed * speed / self.lateral)


@dataclass(frozen=True, eq=False)
class SmoothPath:
    """A trajectory, and the places where it must be slow.

    Attributes:
        samples: (n, 6) rows of arc length s, m, from 0 in equal steps; x, y, m; heading, rad in [-π, π); curvature,
            1/m, positive to the left; speed, m/s. Read-only, in the frame of the points.
        corners: (m, 2) the polyline that was rounded, m.
        radii: (m,) smallest radius of each corner's fillet, m; infinite for no turn.
        slow_places: (k, 2) corners that are so tight that the speed there is below `SpeedLimits.slowest`, m.
    """

    samples: Floats
    corners: Floats
    radii: Floats
    slow_places: Floats


def make_trajectory(
    points: Floats,
    limits: SpeedLimits,
    traversable: Cells | None = None,
    resolution: float = 1.0,
    origin: tuple[float, float] = (0.0, 0.0),
    spacing: float = 0.02,
    rounding: float = 0.05,
    heading: float = 0.0,
) -> SmoothPath:
    """The trajectory of a path.

    With a grid, corners are pruned by line of sight and every fillet stays within free cells: it is shrunk, or its
    corner moved outwards, until it does. If the radius of the lowest speed (0.458 m at 0.2 m/s and 25°/s) does not fit
    into the free space, the corner gets the largest radius that does, and the speed there falls below the lowest one,
    so that the turn rate stays within its limit; `slow_places` lists such corners. The speed is above 0.05 m/s down to
    a radius of 0.115 m. Without a grid, the result is within 2 `rounding` of the path.

    Args:
        points: (n, 2) path, m, n >= 1, in the frame of the grid.
        limits: Speeds and accelerations.
        traversable: (rows, cols) bool, True where the robot's centre may be; row 0 has the lowest y. None: unknown.
        resolution: Edge of a cell, m.
        origin: x, y of the lower left corner of cell (0, 0), m; its axes are parallel to those of the points.
        spacing: Largest arc length between samples, m; a tight fillet lowers it to as little as 0.005 m.
        rounding: Without a grid: how far corners may be cut, m.
        heading: Heading of the only sample of a path without length, rad; otherwise without effect.

        Raises:
            ValueError: `points` is not (n, 2), empty or not finite.
    """
    path = _checked(points)
    slow, fast = limits.radius_at(limits.slowest), limits.radius_at(limits.fastest)
    if traversable is None:
        cells, frame = np.zeros((0, 0), np.bool_), np.array([1.0, 0.0, 0.0])
        corners, beside = line_of_sight.simplify(path, rounding), rounding
    else:
        cells, frame = np.ascontiguousarray(traversable, np.bool_), np.array([resolution, *origin])
        corners, beside = line_of_sight.prune(path, cells, resolution, origin), math.inf
        # A little more than needed: with exactly `slow`, rounding puts the corner among the slow places.
        corners = fillets.move_corners(corners, cells, frame, 1.01 * slow, fast, 2)
    if len(corners) == 1:
        return _standing(corners, limits, heading)
    radii, shares = fillets.fit_fillets(corners, cells, frame, slow, fast, beside)
    samples = sample_path(corners, radii, shares, _spacing(corners, radii, shares, spacing))
    samples[:, 5] = speed_profile(samples[1, 0], _bend(samples), limits)
    return _read_only(samples, corners, radii, corners[radii < slow])


def keep_corners(points: Floats, limits: SpeedLimits, spacing: float = 0.02, heading: float = 0.0) -> SmoothPath:
    """The trajectory along the points themselves, neither pruned nor rounded.

    At a corner the heading jumps by the turn of the path. Curvature and turn rate stay 0 and the speed does not fall
    there, so that a tracking law must swing onto the next leg by itself.

    Args:
        points, limits, spacing, heading: As in `make_trajectory`.

        Raises:
            ValueError: As in `make_trajectory`.
    """
    path = _checked(points)
    # Repeated points have no direction.
    corners = path[np.append(True, np.hypot(*np.diff(path, axis=0).T) > 0.0)]
    if len(corners) == 1:
        return _standing(corners, limits, heading)
    radii = np.full(len(corners), np.inf)
    samples = sample_path(corners, radii, np.ones(len(corners)), spacing)
    samples[:, 5] = speed_profile(samples[1, 0], samples[:, 4], limits)
    return _read_only(samples, corners, radii, np.zeros((0, 2)))


def speed_profile(
    step: float, curvature: Floats, limits: SpeedLimits, start: float | None = None, most: Floats | float = math.inf
) -> Floats:
    """v_r(s) = clip(min(v_max, ω_lim/|κ|, sqrt(a_lat/|κ|)), v_min, v_max), then limited by the accelerations.

    ω_lim takes precedence over v_min: in a corner too tight for both, v is ω_lim/|κ|. So does the turn acceleration
    dω/dt = v² dκ/ds + κ dv/dt: half of it bounds the first term and a quarter the second, and the rest is left to the
    corrections of the tracking law.

    Args:
        step: Arc length between samples, m.
        curvature: (n,) 1/m.
        limits: Speeds and accelerations.
        start: Speed of the first sample, m/s; None for the lowest.
        most: (n,) or one further limit of the speed, m/s.

    Returns:
        (n,) speed, m/s, > 0; the last one is at most the lowest speed of the limits.
    """
    # Straight parts would divide by zero; nothing limits the speed at that curvature.
    bend = np.maximum(np.abs(curvature), 1e-9)
    speed: Floats = np.minimum(limits.fastest, np.sqrt(limits.lateral / bend)).clip(limits.slowest, limits.fastest)
    speed = np.minimum(np.minimum(speed, limits.robot.max_angular / bend), most)
    rates = (limits.robot.max_acceleration, limits.robot.max_deceleration)
    turning = 0.5 * limits.robot.max_angular_acceleration
    speed = np.minimum(speed, np.maximum(_CRAWL, np.sqrt(turning / _bend_change(step, curvature))))
    speed[0] = min(speed[0], limits.slowest if start is None else max(start, limits.slowest))
    # Not zero: tracking laws need a moving reference, and the goal stops the robot.
    speed[-1] = min(speed[-1], limits.slowest)
    gain, loss = (2.0 * step * np.minimum(rate, 0.5 * turning / bend) for rate in rates)
    _limit_acceleration(speed, gain, loss)
    return speed


def sample_path(corners: Floats, radii: Floats, shares: Floats, spacing: float) -> Floats:
    """Samples of a rounded polyline in equal steps of arc length, the first and the last at its ends.

    Args:
        corners: (m, 2) polyline, m, m >= 2.
        radii, shares: (m,) of `fillets.fit_fillets`.
        spacing: Largest step, m.

    Returns:
        (n, 6) arc length, x, y, heading in [-π, π), curvature, and 0 for the speed.
    """
    samples: Floats = _sample(corners, radii, shares, spacing)
    return samples


def free_samples(samples: Floats, traversable: Cells, resolution: float, origin: tuple[float, float]) -> bool:
    """Whether all chords between samples (n, 6) touch only free cells: checks a trajectory against a newer grid."""
    cells = np.ascontiguousarray(traversable, np.bool_)
    where = (cells, resolution, *origin)
    return all(line_of_sight.is_segment_free(*where, a[1], a[2], b[1], b[2]) for a, b in pairwise(samples))


def _checked(points: Floats) -> Floats:
    path = np.ascontiguousarray(points, dtype=np.float64)
    if path.ndim != 2 or path.shape[1] != 2 or len(path) == 0 or not np.isfinite(path).all():
        raise ValueError(f"points: expected (n, 2) finite numbers with n >= 1, given {path.shape} {path.dtype}")
    return path


def _standing(corners: Floats, limits: SpeedLimits, heading: float) -> SmoothPath:
    """The trajectory of a path without length: one sample."""
    wrapped = (heading + math.pi) % (2.0 * math.pi) - math.pi
    samples = np.array([[0.0, *corners[0], wrapped, 0.0, limits.slowest]])
    return _read_only(samples, corners, np.full(1, np.inf), np.zeros((0, 2)))


def _read_only(samples: Floats, corners: Floats, radii: Floats, slow_places: Floats) -> SmoothPath:
    for array in (samples, corners, radii, slow_places):
        # They go into messages without a copy.
        array.flags.writeable = False
    return SmoothPath(samples, corners, radii, slow_places)


def _spacing(corners: Floats, radii: Floats, shares: Floats, spacing: float) -> float:
    """Step that gives the shortest fillet enough samples, m."""
    lengths = np.diff(fillets.stations(corners, radii, shares)[:, :2], axis=1)
    shortest = lengths[lengths > 0.0].min(initial=math.inf)
    return float(min(spacing, max(_FINEST, shortest / _PER_FILLET)))


def _bend(samples: Floats) -> Floats:
    """Curvature (n,), 1/m, in which a fillet too small for the samples counts as the turn between two of them."""
    turns = (np.diff(samples[:, 3]) + math.pi) % (2.0 * math.pi) - math.pi
    between = np.abs(turns) / samples[1, 0]
    bend = np.abs(samples[:, 4])
    # On a smooth part, both agree up to the step: only where samples skip a fillet is the turn between them larger.
    between[between <= 1.1 * np.maximum(bend[:-1], bend[1:])] = 0.0
    bend[:-1] = np.maximum(bend[:-1], between)
    bend[1:] = np.maximum(bend[1:], between)
    return bend


def _bend_change(step: float, curvature: Floats) -> Floats:
    """|dκ/ds| (n,), 1/m², the larger one of the steps before and after each sample."""
    change = np.abs(np.diff(curvature)) / step
    largest: Floats = np.maximum(np.append(change, 0.0), np.append(0.0, change)).clip(1e-9)
    return largest


@njit(cache=True, nogil=True, error_model="numpy")
def _limit_acceleration(speed, gain, loss):  # type: ignore[no-untyped-def]
    """Forward and backward pass, in place: v² rises by at most `gain` (n,) and falls by at most `loss` (n,) a step."""
    for k in range(1, speed.shape[0]):
        speed[k] = min(speed[k], math.sqrt(speed[k - 1] ** 2 + gain[k]))
    for k in range(speed.shape[0] - 2, -1, -1):
        speed[k] = min(speed[k], math.sqrt(speed[k + 1] ** 2 + loss[k]))


@njit(cache=True, nogil=True, error_model="numpy")
def _sample(corners, radii, shares, spacing):  # type: ignore[no-untyped-def]
    stations = fillets.stations(corners, radii, shares)
    total = stations[-1, 1]
    count = math.ceil(total / spacing - 1e-9) + 1
    # Two at least: a step between samples is needed to interpolate.
    samples = np.zeros((max(2, count), 6))
    step, i = total / (samples.shape[0] - 1), 1
    for k in range(samples.shape[0]):
        # The last one exactly at the end, whatever the sum of steps rounds to.
        s = total if k == samples.shape[0] - 1 else k * step
        while i < corners.shape[0] - 1 and s >= stations[i, 1]:
            i += 1
        samples[k, 0] = s
        _place(corners, radii, shares, stations, i, s, samples[k])
    return samples


@njit(cache=True, nogil=True, error_model="numpy")
def _place(corners, radii, shares, stations, i, s, sample):  # type: ignore[no-untyped-def]
    """Fill x, y, heading and curvature at arc length s, before or on the fillet of corner i."""
    # A fillet is symmetric: its second half is the first, from the other end and mirrored.
    back = s > 0.5 * (stations[i, 0] + stations[i, 1]) and stations[i, 2] > 0.0
    other = i + 1 if back else i - 1
    ux, uy = corners[i, 0] - corners[other, 0], corners[i, 1] - corners[other, 1]
    size = math.sqrt(ux * ux + uy * uy)
    ux, uy = ux / size, uy / size
    turn, along = fillets.turn_at(corners, i), s - stations[i, 0]
    x, y, heading, bend = along - stations[i, 2], 0.0, 0.0, 0.0
    if along > 0.0 and stations[i, 2] > 0.0:
        radius, share = radii[i], shares[i]
        along = max(0.0, stations[i, 1] - s) if back else along
        x, y, heading, bend = fillets.fillet_point(along / radius, abs(turn), share)
        side = -math.copysign(1.0, turn) if back else math.copysign(1.0, turn)
        x, y, heading, bend = x * radius - stations[i, 2], y * radius * side, heading * side, bend / radius
    sample[1], sample[2] = corners[i, 0] + x * ux - y * uy, corners[i, 1] + x * uy + y * ux
    heading += math.atan2(-uy, -ux) if back else math.atan2(uy, ux)
    sample[3] = (heading + math.pi) % (2.0 * math.pi) - math.pi
    sample[4] = math.copysign(bend, turn)


def warm_up() -> None:
    """Compile all kernels that turn a path into a trajectory."""
    line_of_sight.warm_up()
    fillets.warm_up()
    path, cells = np.array([[0.5, 0.5], [2.5, 0.5], [2.5, 2.5]]), np.ones((3, 3), np.bool_)
    robot = RobotSpec(path, 1.0, 0.05, 0.2, 0.5, 0.5, 0.5, 0.5)
    limits = SpeedLimits(robot, 0.2, 0.4, 0.3)
    made = make_trajectory(path, limits, cells)
    make_trajectory(path, limits)
    free_samples(made.samples, cells, 1.0, (0.0, 0.0))

"""3D-to-2D image pressure, steps 1 to 3 of IPaBD (Hoang et al. 2013, II.B), in one fused pass over the image."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from navloom_ipabd.rules import Filters, Rule
from navloom_ipabd.sweep import SweepImage
from navloom_ipabd.track import FrameMotion, standing

__all__ = ["Barriers", "Bins", "bins_of", "press", "settle", "warm_up"]

Floats = NDArray[np.float64]
TAU = 2.0 * math.pi


@dataclass(frozen=True)
class Bins:
    """Azimuth bins for the nearest obstacle, in the reference frame (see `FrameMotion`).

    Attributes:
        first, step: Bin i is centred on `first` + i `step`, rad.
        size: Number of bins.
        are_columns: Whether the bins are the columns of the image. Otherwise they cover the whole circle.
    """

    first: float
    step: float
    size: int
    are_columns: bool = False

    @property
    def azimuths(self) -> Floats:
        """(size,) centres of the bins, rad, increasing from `first`, not wrapped."""
        return self.first + self.step * np.arange(self.size, dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Barriers:
    """The 2D image: the nearest obstacle point on every azimuth.

    Attributes:
        bins: The azimuths.
        ranges: (bins,) horizontal range of the nearest obstacle point, m, reference frame; +inf if there is none.
        points: (bins, 3) that point: x, y, m, reference frame, and z above the floor, m; NaN if there is none.
        seen: (bins,) distance up to which the azimuth was observed, m: that of the obstacle, or of the farthest return
            if there is no obstacle; 0 if no ray returned.
        counts: Number of image points by rule; they sum to frames × beams.
    """

    bins: Bins
    ranges: Floats
    points: Floats
    seen: Floats
    counts: dict[Rule, int]


def bins_of(sweep: SweepImage, motion: FrameMotion | None = None, bin_width: float | None = None) -> Bins:
    """Azimuth bins of a sweep: its columns if these have fixed azimuths, otherwise equal steps of the whole circle.

    Columns have fixed azimuths if the geometry is eq. (1), the beams are evenly spaced and the robot is stopped. With a
    rigid pitch, a column spreads over the azimuths atan(tan b / cosα). Movement of the robot rotates it.

    Args:
        sweep: The 3D image.
        motion: Movement during the sweep; None: the robot was stopped.
        bin_width: Width of a bin, rad; None: the bearing step. With a width, the bins cover the whole circle.
    """
    first = float(sweep.bearings[0])
    is_still = motion is None or motion.is_still
    if is_still and sweep.geometry == "paper" and bin_width is None and sweep.is_evenly_spaced:
        return Bins(first, sweep.bearing_step, sweep.bearings.size, are_columns=True)
    step = sweep.bearing_step if bin_width is None else bin_width
    # Less 1e-9: rounding must not add a bin to a circle of whole steps.
    return Bins(first, step, max(1, math.ceil(TAU / step - 1e-9)))


def press(
    sweep: SweepImage, filters: Filters, motion: FrameMotion | None = None, bin_width: float | None = None
) -> Barriers:
    """Nearest obstacle point of every azimuth, and the number of points rejected by each rule.

    Args:
        sweep: The 3D image.
        filters: Limits of points that count as obstacles.
        motion: Movement during the sweep; None: the robot was stopped at the origin of the map.
        bin_width: Width of an azimuth bin, rad; None: the bearing step.
    """
    bins = bins_of(sweep, motion, bin_width)
    pitch = (np.sin(sweep.pitches), np.cos(sweep.pitches))
    sin_b, cos_b = np.sin(sweep.bearings), np.cos(sweep.bearings)
    limits, height = _limits(sweep, filters), sweep.mount[2]
    if bins.are_columns:
        nearest, heights, seen, tally = _press_columns(sweep.ranges, *pitch, height, limits)
        level = np.where(nearest < math.inf, nearest, math.nan)
        points = np.stack([level * cos_b, level * sin_b, heights], axis=1)
    else:
        motion = standing(sweep.pitches.size, (0.0, 0.0, 0.0)) if motion is None else motion
        frames = np.column_stack([*pitch, motion.shifts, np.sin(motion.turns), np.cos(motion.turns)])
        circle = np.array([bins.first, bins.step])
        is_rigid = sweep.geometry == "rigid_pitch"
        nearest, points, seen, tally = _press_bins(
            sweep.ranges, frames, sin_b, cos_b, height, limits, is_rigid, circle, bins.size
        )
    return settle(bins, nearest, points, seen, tally, filters, height)


def _limits(sweep: SweepImage, filters: Filters) -> Floats:
    """Least range, first range that is too long, and the four `Heights`, m.

    With the printed order the height limits are infinite, because `settle` filters heights later.
    """
    range_min = max(sweep.range_min, filters.min_range)
    range_cut = sweep.range_max - filters.max_range_tolerance
    if filters.order == "paper":
        return np.array([range_min, range_cut, -math.inf, -math.inf, -math.inf, math.inf])
    return np.array([range_min, range_cut, *filters.heights(sweep.mount[2])])


def settle(
    bins: Bins, nearest: Floats, points: Floats, seen: Floats, tally: NDArray[np.int64], f: Filters, sensor_z: float
) -> Barriers:
    """Complete the counts. For the printed order, also filter the minima: step 3 after step 2.

    Args:
        nearest: (bins,) smallest horizontal range, m; +inf if there is none.
        points: (bins, 3) its point, m; NaN if there is none.
        seen: (bins,) largest horizontal range of any return, m.
        tally: (7,) counts by rule; NOT_MINIMUM includes all points that passed.
        f: The filters.
        sensor_z: Height of the sensor above the floor, m.
    """
    counts = dict(zip(Rule, tally.tolist(), strict=False))  # KEPT, the last, is counted below
    found = np.isfinite(nearest)
    counts[Rule.NOT_MINIMUM] -= int(found.sum())
    if f.order == "paper":
        z, limits = points[:, 2], f.heights(sensor_z)
        wrong = {
            Rule.BELOW_FLOOR: z < limits.below,
            Rule.FLOOR: (z >= max(limits.below, limits.deep)) & (z <= limits.low),
            Rule.TOO_HIGH: z > limits.high,
        }
        for rule, mask in wrong.items():
            counts[rule] += int(mask.sum())
            found &= ~mask
        nearest = np.where(found, nearest, math.inf)
        points = np.where(found[:, None], points, math.nan)
    counts[Rule.KEPT] = int(found.sum())
    return Barriers(bins, nearest, points, np.where(found, nearest, seen), counts)


@njit(cache=True, nogil=True, error_model="numpy")
def _press_columns(
    ranges: Floats, sin_pitch: Floats, cos_pitch: Floats, height: float, limits: Floats
) -> tuple[Floats, Floats, Floats, NDArray[np.int64]]:
    """Press an image whose columns are azimuths. The loop has no branches, so that it can be vectorized.

    Limits as `_limits` returns them.
    """
    frames, beams = ranges.shape
    range_min, range_cut, below, deep, low, high = limits[0], limits[1], limits[2], limits[3], limits[4], limits[5]
    nearest = np.full(beams, np.inf)
    heights = np.full(beams, np.nan)
    seen = np.zeros(beams)
    none = far = near = under = floor = over = 0
    for j in range(frames):
        s, c = sin_pitch[j], cos_pitch[j]
        row = ranges[j]
        for k in range(beams):
            r = row[k]
            none += int(r == np.inf)
            far += int(r >= range_cut)
            near += int(r < range_min)
            r = r if (r >= range_min) & (r < range_cut) else np.nan  # fails every comparison below
            z = r * s + height
            level = r * c
            under += int(z < below)
            floor += int((z <= low) & (z >= deep))
            over += int(z > high)
            seen[k] = level if level > seen[k] else seen[k]
            is_nearer = ((z > low) | (z < deep)) & (z <= high) & (level < nearest[k])
            nearest[k] = level if is_nearer else nearest[k]
            heights[k] = z if is_nearer else heights[k]
    return nearest, heights, seen, _tally(ranges.size, none, far, near, under, floor, over)


@njit(cache=True, nogil=True, error_model="numpy")
def _tally(total: int, none: int, far: int, near: int, under: int, floor: int, over: int) -> NDArray[np.int64]:
    """Counts by rule. `far` includes the missing returns, and `floor` includes the points below the floor."""
    far_only, floor_only = far - none, floor - under
    passed = total - far - near - floor - over
    return np.array([none, far_only, near, under, floor_only, over, passed])


@njit(cache=True, nogil=True, error_model="numpy")
def _press_bins(
    ranges: Floats, frames: Floats, sin_b: Floats, cos_b: Floats, height: float, limits: Floats, is_rigid: bool,
    circle: Floats, size: int,
) -> tuple[Floats, Floats, Floats, NDArray[np.int64]]:  # fmt: skip
    """Press an image of any geometry and movement.

    `frames` holds sin and cos of the pitch, shift x, y, m, and sin and cos of the turn of each frame.
    """
    range_min, range_cut, below, deep, low, high = limits[0], limits[1], limits[2], limits[3], limits[4], limits[5]
    nearest = np.full(size, np.inf)
    points = np.full((size, 3), np.nan)
    seen = np.zeros(size)
    none = far = near = under = floor = over = 0
    for j in range(ranges.shape[0]):
        sin_a, cos_a, shift_x, shift_y, sin_t, cos_t = frames[j]
        for k in range(ranges.shape[1]):
            r = ranges[j, k]
            none += r == np.inf
            if r >= range_cut:
                far += 1
                continue
            if r < range_min:
                near += 1
                continue
            if is_rigid:
                forward, left, z = r * (cos_a * cos_b[k]), r * sin_b[k], r * (sin_a * cos_b[k]) + height
            else:
                forward, left, z = r * cos_a * cos_b[k], r * cos_a * sin_b[k], r * sin_a + height
            x = cos_t * forward - sin_t * left + shift_x
            y = sin_t * forward + cos_t * left + shift_y
            level = math.sqrt(x * x + y * y)
            angle = math.atan2(y, x) - circle[0] + 0.5 * circle[1]
            angle -= TAU * math.floor(angle / TAU)
            # Rounding may give the full circle, which would be bin `size`.
            i = min(int(angle / circle[1]), size - 1)
            seen[i] = max(seen[i], level)
            under += z < below
            floor += deep <= z <= low
            over += z > high
            if (low < z <= high or z < deep) and level < nearest[i]:
                nearest[i] = level
                points[i, 0], points[i, 1], points[i, 2] = x, y, z
    return nearest, points, seen, _tally(ranges.size, none, far, near, under, floor, over)


def warm_up() -> None:
    """Compile both kernels for read-only float64 images, the only type in a `SweepImage`."""
    for geometry in ("paper", "rigid_pitch"):
        image = SweepImage(
            np.ones((2, 2)), np.zeros(2), np.zeros(2), np.array([0.0, 0.1]), (0.0, 0.0, 0.4), 0.0, 80.0, geometry
        )
        press(image, Filters())

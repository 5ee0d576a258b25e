"""Where the robot was when each frame of a sweep was taken."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numba import njit
from numpy.typing import NDArray

from navloom_ipabd.errors import TrackError

__all__ = ["FrameMotion", "check_track", "frame_motion", "interpolate", "poses_at", "standing", "warm_up"]

Floats = NDArray[np.float64]

STILL_METRES, STILL_RADIANS = 1e-6, 1e-7
"""Largest movement within a sweep that counts as rounding of the pose track, m and rad."""
_FEW = 16
"""Number of poses up to which a Python loop is faster than numpy."""


@dataclass(frozen=True, eq=False)
class FrameMotion:
    """Movement during a sweep, seen from the reference pose.

    The *reference frame* has its origin on the floor below the sensor and the axes of base, both at the reference pose.
    Rays start near its origin, so the nearest point on a bearing is the one that the sensor saw nearest.

    Attributes:
        shifts: (frames, 2) position of the sensor at each frame, m, reference frame.
        turns: (frames,) heading of base minus that of the reference, rad.
        reference: x, y, m, and heading, rad, of base in the map frame at the end of the sweep.
    """

    shifts: Floats
    turns: Floats
    reference: tuple[float, float, float]

    @property
    def is_still(self) -> bool:
        """Whether all frames were taken at the reference pose."""
        return bool(np.abs(self.shifts).max() <= STILL_METRES and np.abs(self.turns).max() <= STILL_RADIANS)


def poses_at(offsets: Floats, track_offsets: Floats, track_poses: Floats, slack: float) -> Floats:
    """Interpolate the poses of a track linearly, headings along the shorter arc.

    Beyond its ends, the track holds its first and last pose for up to `slack`.

    Args:
        offsets: (m,) requested times, s after an epoch.
        track_offsets: (n,) times of the track, s after the same epoch, strictly increasing.
        track_poses: (n, 3) x, y, m, heading, rad, map frame.
        slack: Longest time by which the track may miss either end, s.

    Returns:
        (m, 3) x, y, m, heading, rad, not wrapped, map frame.

    Raises:
        TrackError: The track is empty, has the wrong shape, has stamps that do not increase or poses that are not
            finite, or misses either end by more than `slack`.
    """
    check_track(float(offsets.min()), float(offsets.max()), track_offsets, track_poses, slack)
    # Copies, because messages are read-only and numba would compile another kernel for read-only arrays.
    given = (np.array(values, dtype=np.float64, order="C") for values in (offsets, track_offsets, track_poses))
    poses: Floats = interpolate(*given)
    return poses


def check_track(first: float, last: float, track_offsets: Floats, track_poses: Floats, slack: float) -> None:
    """Check that a track covers an interval of time.

    Args:
        first, last: Ends of the interval, s after an epoch.
        track_offsets, track_poses, slack: See `poses_at`.

    Raises:
        TrackError: See `poses_at`.
    """
    if track_poses.shape != (track_offsets.size, 3) or track_offsets.size == 0:
        given = f"{track_offsets.size} stamps and poses of shape {track_poses.shape}"
        raise TrackError("track", given, "n >= 1 stamps and poses (n, 3)")
    if not _is_sound(track_offsets, track_poses):
        raise TrackError("track", "stamps that do not rise or poses that are not finite", "rising stamps, finite poses")
    begin, end = float(track_offsets[0]), float(track_offsets[-1])
    if begin - first > slack or last - end > slack:
        given = f"a track from {begin:.3f} to {end:.3f} s after the stamp"
        raise TrackError("track.stamps_ns", given, f"one that covers {first:.3f} to {last:.3f} s, within {slack:g} s")


def _is_sound(track_offsets: Floats, track_poses: Floats) -> bool:
    """Whether stamps increase and poses are finite. For a few poses, as with one scan, Python is faster than numpy."""
    if track_offsets.size <= _FEW:
        stamps = track_offsets.tolist()
        rises = all(later > earlier for earlier, later in pairwise(stamps))
        return rises and all(map(math.isfinite, track_poses.ravel().tolist()))
    return bool(np.isfinite(track_poses).all() and (track_offsets[1:] > track_offsets[:-1]).all())


@njit(cache=True, nogil=True, error_model="numpy")
def interpolate(offsets: Floats, track_offsets: Floats, track_poses: Floats) -> Floats:
    """`poses_at` for kernels, without its checks. The result is bit-identical to `np.interp` and `np.unwrap`."""
    last = track_offsets.size - 1
    headings = _unwrapped(track_poses[:, 2])
    poses = np.empty((offsets.size, 3))
    before = 0
    for i in range(offsets.size):
        time = offsets[i]
        while before > 0 and track_offsets[before] > time:
            before -= 1
        while before < last and track_offsets[before + 1] <= time:
            before += 1
        known, since = track_poses[before], time - track_offsets[before]
        poses[i, 0], poses[i, 1], poses[i, 2] = known[0], known[1], headings[before]
        if since > 0.0 and before < last:
            after, span = track_poses[before + 1], track_offsets[before + 1] - track_offsets[before]
            poses[i, 0] += (after[0] - known[0]) / span * since
            poses[i, 1] += (after[1] - known[1]) / span * since
            poses[i, 2] += (headings[before + 1] - headings[before]) / span * since
    return poses


@njit(cache=True, nogil=True, error_model="numpy")
def _unwrapped(angles: Floats) -> Floats:
    """Unwrap angles, rad: each step takes the shorter arc, and a step of half a turn keeps its sign."""
    unwrapped, correction = angles.copy(), 0.0
    for i in range(1, angles.size):
        step = angles[i] - angles[i - 1]
        if abs(step) >= math.pi:
            short = (step + math.pi) % math.tau - math.pi
            correction += (math.pi if short == -math.pi and step > 0.0 else short) - step
        unwrapped[i] = angles[i] + correction
    return unwrapped


def frame_motion(
    stamp_ns: int, frame_times: Floats, mount_xy: tuple[float, float], stamps_ns: NDArray[np.int64], poses: Floats, *,
    slack: float, deskew: bool = True,
) -> FrameMotion:  # fmt: skip
    """Movement of the sensor during a sweep; the reference is the pose at its last frame.

    Args:
        stamp_ns: Stamp of the sweep, ns.
        frame_times: (frames,) s after the stamp.
        mount_xy: Position of the sensor in base, m.
        stamps_ns: (n,) stamps of the track, ns, strictly increasing.
        poses: (n, 3) x, y, m, heading, rad, of base in the map frame.
        slack: Longest time by which the track may miss the sweep's ends, s.
        deskew: If False, all frames are assumed to be taken at the reference pose.

    Raises:
        TrackError: See `poses_at`.
    """
    track_offsets: Floats = (np.asarray(stamps_ns, dtype=np.int64) - stamp_ns).astype(np.float64) * 1e-9
    at_frames = poses_at(frame_times, track_offsets, np.asarray(poses, dtype=np.float64), slack)
    x, y, heading = (float(value) for value in at_frames[int(np.argmax(frame_times))])
    if not deskew:
        return standing(frame_times.size, (x, y, heading))
    turns = at_frames[:, 2] - heading
    moved = at_frames[:, :2] - (x, y)
    cos_h, sin_h = np.cos(heading), np.sin(heading)
    cos_t, sin_t = np.cos(turns), np.sin(turns)
    mount_x, mount_y = mount_xy
    shift_x = moved[:, 0] * cos_h + moved[:, 1] * sin_h + (cos_t - 1.0) * mount_x - sin_t * mount_y
    shift_y = moved[:, 1] * cos_h - moved[:, 0] * sin_h + sin_t * mount_x + (cos_t - 1.0) * mount_y
    return FrameMotion(np.column_stack([shift_x, shift_y]), turns, (x, y, heading))


def standing(frames: int, reference: tuple[float, float, float]) -> FrameMotion:
    """Motion of a sweep during which the robot was stopped at `reference` (x, y, m, heading, rad, map frame)."""
    return FrameMotion(np.zeros((frames, 2)), np.zeros(frames), reference)


def warm_up() -> None:
    """Compile the kernel of this module."""
    poses_at(np.zeros(1), np.zeros(1), np.zeros((1, 3)), 0.0)

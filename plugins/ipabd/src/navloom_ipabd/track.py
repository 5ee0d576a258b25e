"""Where the robot was when each frame of a sweep was taken."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from navloom_ipabd.errors import TrackError

__all__ = ["FrameMotion", "frame_motion", "poses_at", "standing"]

Floats = NDArray[np.float64]

STILL_METRES, STILL_RADIANS = 1e-6, 1e-7
"""Movement within a sweep that is only rounding of the pose track."""


@dataclass(frozen=True, eq=False)
class FrameMotion:
    """Movement during a sweep, seen from the reference pose.

    The *reference frame* has its origin at the sensor's place, on the floor, and the axes of base, both at the
    reference pose: rays start near its origin, so that "nearest on a bearing" is what the sensor saw nearest.

    Attributes:
        shifts: (frames, 2) where the sensor was, m, reference frame.
        turns: (frames,) heading of base less that of the reference, rad.
        reference: x, y, heading of base in the map frame at the end of the sweep, m and rad.
    """

    shifts: Floats
    turns: Floats
    reference: tuple[float, float, float]

    @property
    def is_still(self) -> bool:
        """No frame was taken anywhere else than at the reference."""
        return bool(np.abs(self.shifts).max() <= STILL_METRES and np.abs(self.turns).max() <= STILL_RADIANS)


def poses_at(offsets: Floats, track_offsets: Floats, track_poses: Floats, slack: float) -> Floats:
    """Poses on a track: linear in between, the heading the short way round, held for `slack` beyond both ends.

    Args:
        offsets: (m,) times asked for, s after an epoch.
        track_offsets: (n,) times of the track, s after the same epoch, rising.
        track_poses: (n, 3) x, y, m, heading, rad, map frame.
        slack: s.

    Returns:
        (m, 3) x, y, m, heading, rad, not wrapped, map frame.

    Raises:
        TrackError: The track is empty, has the wrong shape, does not rise, or ends more than `slack` too early.
    """
    if track_poses.shape != (track_offsets.size, 3) or track_offsets.size == 0:
        given = f"{track_offsets.size} stamps and poses of shape {track_poses.shape}"
        raise TrackError("track", given, "n >= 1 stamps and poses (n, 3)")
    if not (np.isfinite(track_poses).all() and (np.diff(track_offsets) > 0.0).all()):
        raise TrackError("track", "stamps that do not rise or poses that are not finite", "rising stamps, finite poses")
    early, late = track_offsets[0] - offsets.min(), offsets.max() - track_offsets[-1]
    if early > slack or late > slack:
        given = f"a track from {track_offsets[0]:.3f} to {track_offsets[-1]:.3f} s after the stamp"
        wanted = f"one that covers {offsets.min():.3f} to {offsets.max():.3f} s, within {slack:g} s"
        raise TrackError("track.stamps_ns", given, wanted)
    headings = np.unwrap(track_poses[:, 2])
    columns = (track_poses[:, 0], track_poses[:, 1], headings)
    return np.column_stack([np.interp(offsets, track_offsets, column) for column in columns])


def frame_motion(
    stamp_ns: int, frame_times: Floats, mount_xy: tuple[float, float], stamps_ns: NDArray[np.int64], poses: Floats, *,
    slack: float, deskew: bool = True,
) -> FrameMotion:  # fmt: skip
    """Movement of the sensor during a sweep; the reference is the pose at its last frame.

    Args:
        stamp_ns: Stamp of the sweep, ns.
        frame_times: (frames,) s after the stamp.
        mount_xy: Sensor in base, m.
        stamps_ns: (n,) of the track, ns, rising.
        poses: (n, 3) x, y, m, heading, rad, of base in the map frame.
        slack: How far a track may miss the sweep's ends, s.
        deskew: False takes all frames as seen from the reference pose.

    Raises:
        TrackError: As of `poses_at`.
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
    """A sweep during which the robot stood at `reference` (x, y, m, heading, rad, map frame)."""
    return FrameMotion(np.zeros((frames, 2)), np.zeros(frames), reference)

"""The pitched LMS-211: directions of a sweep in both geometries, and the kernel that measures its frames.

Hoang et al. 2013, eq. (1), has x to the right, y ahead and the beam angle β measured from x: x = R cosα cosβ,
y = R cosα sinβ, z = R sinα. Here the base has x ahead and y to the left, so the bearing is b = β - 90°.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from navloom_sensors_sim.casting import cast_block, to_map
from navloom_sensors_sim.motion import pose_within

__all__ = ["frame_offsets_ns", "read_frames", "sweep_directions"]

Floats = NDArray[np.float64]


def sweep_directions(pitches: Floats, bearings: Floats, geometry: str) -> Floats:
    """Unit vectors of all beams of a sweep.

    Args:
        pitches: (f,) α, rad, up positive.
        bearings: (b,) β - 90°, rad.
        geometry: "paper": eq. (1), each beam lies on the cone of its pitch. "rigid_pitch": the beams lie in one plane,
            which is pitched about the y axis as a whole.

    Returns:
        (f, 3, b) base frame, x ahead, y left.
    """
    a, b = pitches[:, None], bearings[None, :]
    if geometry == "paper":
        parts = (np.cos(a) * np.cos(b), np.cos(a) * np.sin(b), np.sin(a) + 0.0 * b)
    else:
        parts = (np.cos(a) * np.cos(b), np.sin(b) + 0.0 * a, np.sin(a) * np.cos(b))
    return np.ascontiguousarray(np.stack(parts, axis=1))


def frame_offsets_ns(frames: int, sweep_time: float) -> NDArray[np.int64]:
    """(f,) time of each frame, ns after the start of the sweep; evenly spaced, the last one interval before its end."""
    return np.round(np.arange(frames) * (sweep_time * 1e9 / frames)).astype(np.int64)


@njit(cache=True, nogil=True, error_model="numpy")
def read_frames(track, times, mount, directions, obstacles, options, normals, ranges):  # type: ignore[no-untyped-def]
    """Ranges of some frames of a sweep, each from the true pose at its own time.

    Args:
        track: (n, 6) the robot's motion within the tick, as `drive_tick` fills it.
        times: (f,) s from the start of the tick.
        mount: (3,) sensor in the base frame, m; z above the floor.
        directions: (f, 3, b) base frame.
        obstacles: What can be hit, at its position at the end of the tick.
        options: (4,) lowest and highest range, m; standard deviation, m; systematic error, m.
        normals: (f, b) standard normal draws.
        ranges: (f, b) filled: m, +inf for no return.
    """
    count = directions.shape[2]
    starts, ways, hits = np.empty((3, count)), np.empty((3, count)), np.empty(count, np.int64)
    for f in range(times.shape[0]):
        x, y, heading = pose_within(track, times[f])
        c, s = math.cos(heading), math.sin(heading)
        starts[0, :] = x + c * mount[0] - s * mount[1]
        starts[1, :] = y + s * mount[0] + c * mount[1]
        starts[2, :] = mount[2]
        to_map(x, y, heading, directions[f], np.bool_(False), ways)
        cast_block(starts, ways, obstacles, np.bool_(True), options[1], ranges[f], hits)
        for i in range(count):
            measured = max(ranges[f, i] + options[3] + options[2] * normals[f, i], options[0])
            is_echo = ranges[f, i] < options[1] and measured < options[1]
            ranges[f, i] = measured if is_echo else np.inf

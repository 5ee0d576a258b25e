"""Differential drive, wheel odometry and contact: one kernel call per tick.

Hoang et al. 2013, eq. (2), gives the wheels' angular speeds for a commanded velocity from the nominal wheel radius and
half track. The robot moves with the true radius and half track, along exact arcs. Odometry integrates the encoder
counts with the radii and half track that it assumes.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from navloom_sensors_sim.clearance import clearance_at

__all__ = ["STATE", "arc", "drive_tick", "pose_within"]

Floats = NDArray[np.float64]

_NAMES = ["x", "y", "heading", "right", "left", "vx", "wz", "odo_x", "odo_y", "odo_heading", "odo_vx", "odo_wz"]
_NAMES += ["counted_right", "counted_left", "gap", "nearest", "touching"]
STATE = {name: index for index, name in enumerate(_NAMES)}
"""Index of each number in the state vector.

x, y, heading: true base in the map frame, m, rad. right, left: wheel speeds, rad/s. vx, wz: true velocity, m/s, rad/s.
odo_*: odometry, in the odometry frame. counted_*: wheel angle left over from encoder counting, rad. gap: clearance, m.
nearest: index of the nearest obstacle. touching: 1 in contact.
"""
_X, _Y, _HEADING, _RIGHT, _LEFT, _VX, _WZ, _ODO_X, _ODO_Y, _ODO_HEADING, _ODO_VX, _ODO_WZ = range(12)
_COUNTED_RIGHT, _COUNTED_LEFT, _GAP, _NEAREST, _TOUCHING = range(12, 17)


@njit(cache=True, nogil=True, error_model="numpy")
def arc(x, y, heading, v, w, time):  # type: ignore[no-untyped-def]
    """Exact pose of a unicycle after `time`, s, at constant speed v, m/s, and turn rate w, rad/s; heading in [-π, π).

    The chord is v t sinc(w t / 2) long and points along the mean heading, which has no singularity at w = 0.
    """
    half = 0.5 * w * time
    chord = v * time * (math.sin(half) / half if abs(half) > 1e-8 else 1.0)
    turned = heading + w * time
    turned -= 2.0 * math.pi * math.floor((turned + math.pi) / (2.0 * math.pi))
    return x + chord * math.cos(heading + half), y + chord * math.sin(heading + half), turned


@njit(cache=True, nogil=True, error_model="numpy")
def pose_within(track, time):  # type: ignore[no-untyped-def]
    """True pose at `time`, s from the start of the tick; see `drive_tick` for `track`."""
    row = 0
    while row + 1 < track.shape[0] and track[row + 1, 0] <= time:
        row += 1
    return arc(track[row, 1], track[row, 2], track[row, 3], track[row, 4], track[row, 5], time - track[row, 0])


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _spin(speed, goal, step, lag, acceleration):  # type: ignore[no-untyped-def]
    """Wheel speed after `step`, s, of first-order lag towards `goal` with limited acceleration, and its mean."""
    if lag > 0.0:
        decay = math.exp(-step / lag)
        end = goal + (speed - goal) * decay
        mean = goal + (speed - goal) * (1.0 - decay) * lag / step
    else:
        end, mean = goal, goal
    if abs(end - speed) > acceleration * step:
        end = speed + math.copysign(acceleration * step, end - speed)
        mean = 0.5 * (speed + end)
    return end, mean


@njit(cache=True, nogil=True, error_model="numpy")
def drive_tick(state, track, drive, odometry, command, noise, footprint, height, obstacles):  # type: ignore[no-untyped-def]
    """Moves robot and odometry through one tick and measures the clearance at its end.

    If the footprint would touch something at the end of the tick, the robot stays where it was, its wheels stall, and
    the contact is reported for this tick.

    Args:
        state: (17,) see STATE; changed.
        track: (steps + 1, 6) filled with time from the start of the tick, s; x, y, m, and heading, rad, map frame, at
            that time; speed, m/s, and turn rate, rad/s, from that time on. One row per sub-step, plus one for the end.
        drive: (8,) nominal radius and half track, true radius and half track, m; highest wheel speed, rad/s; lag, s
            (0 = none); wheel acceleration, rad/s² (inf = no limit); length of the tick, s.
        odometry: (5,) assumed right and left radius and half track, m; slip, m/sqrt(m); angle of one encoder count,
            rad (0 = continuous).
        command: (2,) forward speed, m/s, and turn rate, rad/s.
        noise: (2,) standard normal draws for the slip of right and left wheel.
        footprint, height, obstacles: As for `clearance_at`.
    """
    right, left = _wheel_goals(drive, command)
    steps = track.shape[0] - 1
    step = drive[7] / steps
    x, y, heading = state[_X], state[_Y], state[_HEADING]
    spun = np.empty((steps, 2))
    for k in range(steps):
        state[_RIGHT], mean_right = _spin(state[_RIGHT], right, step, drive[5], drive[6])
        state[_LEFT], mean_left = _spin(state[_LEFT], left, step, drive[5], drive[6])
        v = 0.5 * drive[2] * (mean_right + mean_left)
        w = 0.5 * drive[2] * (mean_right - mean_left) / drive[3]
        spun[k, 0], spun[k, 1] = mean_right * step, mean_left * step
        track[k, 0], track[k, 1], track[k, 2], track[k, 3], track[k, 4], track[k, 5] = k * step, x, y, heading, v, w
        x, y, heading = arc(x, y, heading, v, w, step)
    gap, nearest = clearance_at(x, y, heading, footprint, height, obstacles)
    state[_GAP], state[_NEAREST], state[_TOUCHING] = gap, nearest, 1.0 if gap == 0.0 else 0.0
    if gap == 0.0:
        x, y, heading = state[_X], state[_Y], state[_HEADING]
        _stall(state, track, spun)
    state[_X], state[_Y], state[_HEADING] = x, y, heading
    state[_VX] = 0.5 * drive[2] * (state[_RIGHT] + state[_LEFT])
    state[_WZ] = 0.5 * drive[2] * (state[_RIGHT] - state[_LEFT]) / drive[3]
    track[steps, 0], track[steps, 1], track[steps, 2], track[steps, 3] = drive[7], x, y, heading
    track[steps, 4], track[steps, 5] = state[_VX], state[_WZ]
    _count_wheels(state, spun, odometry, drive[2], noise, drive[7])


@njit(cache=True, nogil=True, error_model="numpy")
def _stall(state, track, spun):  # type: ignore[no-untyped-def]
    """Undoes the motion of a tick: the robot stays where the tick began, and its wheels do not turn."""
    state[_RIGHT], state[_LEFT] = 0.0, 0.0
    spun[:] = 0.0
    for k in range(track.shape[0]):
        track[k, 1], track[k, 2], track[k, 3] = state[_X], state[_Y], state[_HEADING]
        track[k, 4], track[k, 5] = 0.0, 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def _wheel_goals(drive, command):  # type: ignore[no-untyped-def]
    """Eq. (2): v_r = (v + R w) / r, v_l = (v - R w) / r; the limit scales both equally, which keeps the curvature."""
    right = (command[0] + drive[1] * command[1]) / drive[0]
    left = (command[0] - drive[1] * command[1]) / drive[0]
    fastest = max(abs(right), abs(left))
    if fastest > drive[4]:
        return right * drive[4] / fastest, left * drive[4] / fastest
    return right, left


@njit(cache=True, nogil=True, error_model="numpy")
def _count_wheels(state, spun, odometry, radius, noise, period):  # type: ignore[no-untyped-def]
    """Integrates the encoder counts. Slip is a random walk: its spread grows with the square root of the distance."""
    way_right, way_left = radius * np.abs(spun[:, 0]).sum(), radius * np.abs(spun[:, 1]).sum()
    # The variance grows with the way, so that the result does not depend on the length of a tick.
    slip_right = 1.0 + odometry[3] * noise[0] / math.sqrt(way_right) if way_right > 0.0 else 1.0
    slip_left = 1.0 + odometry[3] * noise[1] / math.sqrt(way_left) if way_left > 0.0 else 1.0
    x, y, heading = state[_ODO_X], state[_ODO_Y], state[_ODO_HEADING]
    way, turn = 0.0, 0.0
    for k in range(spun.shape[0]):
        state[_COUNTED_RIGHT], right = _counts(state[_COUNTED_RIGHT] + spun[k, 0] * slip_right, odometry[4])
        state[_COUNTED_LEFT], left = _counts(state[_COUNTED_LEFT] + spun[k, 1] * slip_left, odometry[4])
        right, left = right * odometry[0], left * odometry[1]
        ds, dw = 0.5 * (right + left), 0.5 * (right - left) / odometry[2]
        x, y, heading = arc(x, y, heading, ds, dw, 1.0)
        way, turn = way + ds, turn + dw
    state[_ODO_X], state[_ODO_Y], state[_ODO_HEADING] = x, y, heading
    state[_ODO_VX], state[_ODO_WZ] = way / period, turn / period


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _counts(angle, count):  # type: ignore[no-untyped-def]
    """Splits a wheel angle into the remainder and the angle of its whole counts."""
    # The remainder is kept for the next tick, as an encoder does.
    whole = math.floor(angle / count) * count if count > 0.0 else angle
    return angle - whole, whole

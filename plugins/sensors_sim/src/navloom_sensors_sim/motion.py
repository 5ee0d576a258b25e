"""Differential, Ackermann and holonomic drive, wheel odometry and contact: one kernel call per tick.

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

__all__ = ["STATE", "arc", "drive_tick", "omni_tick", "pose_within", "slide", "steer_tick"]

Floats = NDArray[np.float64]

_NAMES = ["x", "y", "heading", "right", "left", "vx", "wz", "odo_x", "odo_y", "odo_heading", "odo_vx", "odo_wz"]
_NAMES += ["counted_right", "counted_left", "gap", "nearest", "touching"]
_NAMES += ["steering", "side", "vy", "odo_vy", "counted_side"]
STATE = {name: index for index, name in enumerate(_NAMES)}
"""Index of each number in the state vector.

x, y, heading: true base in the map frame, m, rad. right, left: wheel speeds, rad/s. vx, wz: true velocity, m/s, rad/s.
odo_*: odometry, in the odometry frame. counted_*: wheel angle left over from encoder counting, rad. gap: clearance, m.
nearest: index of the nearest obstacle. touching: 1 in contact. steering: angle of the front wheels, rad. side: sideways
speed of the wheels of a holonomic robot, rad/s; vy, odo_vy, counted_side: as for vx and right.
"""
_X, _Y, _HEADING, _RIGHT, _LEFT, _VX, _WZ, _ODO_X, _ODO_Y, _ODO_HEADING, _ODO_VX, _ODO_WZ = range(12)
_COUNTED_RIGHT, _COUNTED_LEFT, _GAP, _NEAREST, _TOUCHING = range(12, 17)
_STEERING, _SIDE, _VY, _ODO_VY, _COUNTED_SIDE = range(17, 22)

_STANDS = 1e-4
"""Commanded speed below which an Ackermann robot stands, m/s."""


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
def slide(x, y, heading, v, side, w, time):  # type: ignore[no-untyped-def]
    """As `arc`, with a speed to the left, m/s, beside the forward one."""
    if side == 0.0:
        return arc(x, y, heading, v, w, time)
    off = math.atan2(side, v)
    x, y, turned = arc(x, y, heading + off, math.hypot(v, side), w, time)
    turned -= off
    turned -= 2.0 * math.pi * math.floor((turned + math.pi) / (2.0 * math.pi))
    return x, y, turned


@njit(cache=True, nogil=True, error_model="numpy")
def pose_within(track, time):  # type: ignore[no-untyped-def]
    """True pose at `time`, s from the start of the tick; see `drive_tick` for `track`."""
    row = 0
    while row + 1 < track.shape[0] and track[row + 1, 0] <= time:
        row += 1
    side = track[row, 6] if track.shape[1] > 6 else 0.0
    return slide(track[row, 1], track[row, 2], track[row, 3], track[row, 4], side, track[row, 5], time - track[row, 0])


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
        state: (22,) see STATE; changed.
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
    _place(state, track, spun, drive, (x, y, heading), footprint, height, obstacles)
    _count_wheels(state, spun, odometry, drive[2], noise, drive[7])


@njit(cache=True, nogil=True, error_model="numpy")
def steer_tick(state, track, drive, odometry, command, noise, footprint, height, obstacles):  # type: ignore[no-untyped-def]
    """As `drive_tick` for the bicycle model about the middle of the rear axle: w = v tan(steering) / wheelbase.

    A twist becomes the steering angle atan(wheelbase w / v), within the limit. Without a speed the robot cannot turn:
    its wheels steer as far as they can to that side, or stay as they are. Odometry counts the rear wheels.

    Args:
        drive: (12,) as for `drive_tick`; wheelbase, m; largest steering angle, rad, and rate, rad/s (inf = no limit);
            steering lag, s (0 = none).
        The others are those of `drive_tick`.
    """
    goal = _within(command[0] / drive[0], drive[4])
    if abs(command[0]) > _STANDS:
        angle = math.atan(drive[8] * command[1] / command[0])
    else:
        angle = math.copysign(drive[9], command[1]) if command[1] != 0.0 else state[_STEERING]
    angle = _within(angle, drive[9])
    steps = track.shape[0] - 1
    step = drive[7] / steps
    x, y, heading = state[_X], state[_Y], state[_HEADING]
    spun = np.empty((steps, 2))
    spin = 0.5 * (state[_RIGHT] + state[_LEFT])
    for k in range(steps):
        spin, mean = _spin(spin, goal, step, drive[5], drive[6])
        state[_STEERING], steering = _spin(state[_STEERING], angle, step, drive[11], drive[10])
        v = drive[2] * mean
        w = v * math.tan(steering) / drive[8]
        difference = drive[3] * w / drive[2]
        spun[k, 0], spun[k, 1] = (mean + difference) * step, (mean - difference) * step
        track[k, 0], track[k, 1], track[k, 2], track[k, 3], track[k, 4], track[k, 5] = k * step, x, y, heading, v, w
        x, y, heading = arc(x, y, heading, v, w, step)
    turn = drive[3] * spin * math.tan(state[_STEERING]) / drive[8]
    state[_RIGHT], state[_LEFT] = spin + turn, spin - turn
    _place(state, track, spun, drive, (x, y, heading), footprint, height, obstacles)
    _count_wheels(state, spun, odometry, drive[2], noise, drive[7])


@njit(cache=True, nogil=True, error_model="numpy")
def omni_tick(state, track, drive, odometry, command, noise, footprint, height, obstacles):  # type: ignore[no-untyped-def]
    """As `drive_tick` for a robot that also drives sideways, as if by a third wheel across the two.

    Args:
        track: (steps + 1, 7) as for `drive_tick`, and the speed to the left, m/s.
        command: (3,) forward speed, m/s, turn rate, rad/s, and speed to the left, m/s.
        noise: (3,) standard normal draws for the slip of right, left and third wheel.
        The others are those of `drive_tick`.
    """
    right, left = _wheel_goals(drive, command)
    side = command[2] / drive[0]
    if abs(side) > drive[4]:
        right, left, side = right * drive[4] / abs(side), left * drive[4] / abs(side), math.copysign(drive[4], side)
    steps = track.shape[0] - 1
    step = drive[7] / steps
    x, y, heading = state[_X], state[_Y], state[_HEADING]
    spun = np.empty((steps, 3))
    for k in range(steps):
        state[_RIGHT], mean_right = _spin(state[_RIGHT], right, step, drive[5], drive[6])
        state[_LEFT], mean_left = _spin(state[_LEFT], left, step, drive[5], drive[6])
        state[_SIDE], mean_side = _spin(state[_SIDE], side, step, drive[5], drive[6])
        v = 0.5 * drive[2] * (mean_right + mean_left)
        w = 0.5 * drive[2] * (mean_right - mean_left) / drive[3]
        spun[k, 0], spun[k, 1], spun[k, 2] = mean_right * step, mean_left * step, mean_side * step
        track[k, 0], track[k, 1], track[k, 2], track[k, 3], track[k, 4], track[k, 5] = k * step, x, y, heading, v, w
        track[k, 6] = drive[2] * mean_side
        x, y, heading = slide(x, y, heading, v, track[k, 6], w, step)
    _place(state, track, spun, drive, (x, y, heading), footprint, height, obstacles)
    _count_wheels(state, spun, odometry, drive[2], noise, drive[7])


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _within(value, most):  # type: ignore[no-untyped-def]
    return min(max(value, -most), most)


@njit(cache=True, nogil=True, error_model="numpy")
def _place(state, track, spun, drive, pose, footprint, height, obstacles):  # type: ignore[no-untyped-def]
    """Puts the robot at the pose at the end of a tick, or back where it was if it touches something."""
    gap, nearest = clearance_at(pose[0], pose[1], pose[2], footprint, height, obstacles)
    state[_GAP], state[_NEAREST], state[_TOUCHING] = gap, nearest, 1.0 if gap == 0.0 else 0.0
    if gap == 0.0:
        _stall(state, track, spun)
    else:
        state[_X], state[_Y], state[_HEADING] = pose
    state[_VX], state[_VY] = 0.5 * drive[2] * (state[_RIGHT] + state[_LEFT]), drive[2] * state[_SIDE]
    state[_WZ] = 0.5 * drive[2] * (state[_RIGHT] - state[_LEFT]) / drive[3]
    end = track.shape[0] - 1
    track[end, 0], track[end, 1], track[end, 2], track[end, 3] = drive[7], state[_X], state[_Y], state[_HEADING]
    track[end, 4], track[end, 5] = state[_VX], state[_WZ]
    if track.shape[1] > 6:
        track[end, 6] = state[_VY]


@njit(cache=True, nogil=True, error_model="numpy")
def _stall(state, track, spun):  # type: ignore[no-untyped-def]
    """Undoes the motion of a tick: the robot stays where the tick began, and its wheels do not turn."""
    state[_RIGHT], state[_LEFT], state[_SIDE] = 0.0, 0.0, 0.0
    spun[:] = 0.0
    for k in range(track.shape[0]):
        track[k, 1], track[k, 2], track[k, 3] = state[_X], state[_Y], state[_HEADING]
        track[k, 4:] = 0.0


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
    has_side = spun.shape[1] > 2
    way_side = radius * np.abs(spun[:, 2]).sum() if has_side else 0.0
    slip_side = 1.0 + odometry[3] * noise[2] / math.sqrt(way_side) if way_side > 0.0 else 1.0
    x, y, heading = state[_ODO_X], state[_ODO_Y], state[_ODO_HEADING]
    way, turn, aside, side = 0.0, 0.0, 0.0, 0.0
    for k in range(spun.shape[0]):
        state[_COUNTED_RIGHT], right = _counts(state[_COUNTED_RIGHT] + spun[k, 0] * slip_right, odometry[4])
        state[_COUNTED_LEFT], left = _counts(state[_COUNTED_LEFT] + spun[k, 1] * slip_left, odometry[4])
        right, left = right * odometry[0], left * odometry[1]
        ds, dw = 0.5 * (right + left), 0.5 * (right - left) / odometry[2]
        if has_side:
            state[_COUNTED_SIDE], side = _counts(state[_COUNTED_SIDE] + spun[k, 2] * slip_side, odometry[4])
            side *= 0.5 * (odometry[0] + odometry[1])
        x, y, heading = slide(x, y, heading, ds, side, dw, 1.0)
        way, turn, aside = way + ds, turn + dw, aside + side
    state[_ODO_X], state[_ODO_Y], state[_ODO_HEADING] = x, y, heading
    state[_ODO_VX], state[_ODO_WZ], state[_ODO_VY] = way / period, turn / period, aside / period


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _counts(angle, count):  # type: ignore[no-untyped-def]
    """Splits a wheel angle into the remainder and the angle of its whole counts."""
    # The remainder is kept for the next tick, as an encoder does.
    whole = math.floor(angle / count) * count if count > 0.0 else angle
    return angle - whole, whole

"""The simulated robot between ticks: state vector, constants of the kernels, slip draws."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from navloom_sensors_sim.casting import NOTHING, Obstacles
from navloom_sensors_sim.clearance import clearance_at
from navloom_sensors_sim.disturbing import Effect, Pose, compose
from navloom_sensors_sim.motion import STATE, drive_tick, omni_tick, steer_tick

__all__ = ["Robot"]

Floats = NDArray[np.float64]

_SUB_STEP = 0.01
"""Longest sub-step of the wheels' lag and acceleration, s."""
_NOTHING_AROUND = Obstacles(np.zeros((0, 9)), np.zeros((0, 6)), np.zeros((0, 0), np.float32), np.zeros(7))
"""What wheels meet that turn freely."""


class Robot:
    """Simulated robot that follows commands and keeps wheel odometry.

    Attributes:
        state: (22,) numbers by `motion.STATE`.
        track: (n, 6) or, for a holonomic robot, (n, 7) true motion within the last tick, see `motion.drive_tick`.
    """

    def __init__(
        self,
        footprint: Floats,
        height: float,
        start: Sequence[float],
        rng: np.random.Generator,
        kind: str = "differential",
    ) -> None:
        """Place the robot at the start.

        Args:
            footprint: (n, 2) corners of a convex polygon, counter-clockwise, m, base frame.
            height: Height of the robot, m.
            start: x, y, m, heading, rad, in the map frame.
            rng: Gives a draw for the slip of each wheel per call of `drive`: two, or three for a holonomic robot.
            kind: How it drives, as `RobotSpec.drive`.
        """
        self.state = np.zeros(len(STATE))
        self.state[:3] = start
        self._tick = {"ackermann": steer_tick, "holonomic": omni_tick}.get(kind, drive_tick)
        wheels = 3 if kind == "holonomic" else 2
        self.track = np.zeros((2, 4 + wheels))
        self._command, self._noise = np.zeros(wheels), np.zeros(wheels)
        # Copied: a read-only array is another type to numba, and the kernels would be compiled within a control tick.
        self._footprint, self._height = np.array(footprint, dtype=np.float64, order="C"), float(height)
        self._rng = rng

    @property
    def pose(self) -> Pose:
        """True x, y, m, and heading, rad, map frame."""
        x, y, heading = self.state[:3].tolist()
        return x, y, heading

    def configure(self, drive: Floats, odometry: Floats) -> None:
        """Take new `drive` and `odometry` constants of `motion.drive_tick`, or of `motion.steer_tick`."""
        self._drive, self._odometry = drive, odometry
        self._has_dynamics = drive[5] > 0.0 or math.isfinite(drive[6]) or len(drive) > 8

    def drive(self, command: Sequence[float], time: float, obstacles: Obstacles) -> None:
        """Drive for `time`, s, with a speed, m/s, a turn rate, rad/s, and, if holonomic, a speed to the left, m/s."""
        self._rng.standard_normal(out=self._noise)
        steps = math.ceil(time / _SUB_STEP - 1e-9) if self._has_dynamics else 1
        if len(self.track) != steps + 1:
            self.track = np.zeros((steps + 1, self.track.shape[1]))
        self._drive[7] = time
        self._command[:] = command
        constants, body = (self._drive, self._odometry), (self._footprint, self._height)
        self._tick(self.state, self.track, *constants, self._command, self._noise, *body, obstacles)

    def drive_through(self, legs: Sequence[tuple[float, ...]], obstacles: Obstacles) -> None:
        """Drive through one tick in legs of constant command, as for `drive`, and duration, s."""
        if len(legs) == 1:
            self.drive(legs[0][:-1], legs[0][-1], obstacles)
            return
        tracks, begin, touched = [], 0.0, False
        for *command, time in legs:
            self.drive(command, time, obstacles)
            part = self.track.copy()
            part[:, 0] += begin
            tracks.append(part)
            begin += time
            touched = touched or self.state[STATE["touching"]] != 0.0
        self.track = np.concatenate([part[:-1] for part in tracks] + [tracks[-1][-1:]])
        self.state[STATE["touching"]] = touched

    def hold(self, legs: Sequence[tuple[float, ...]], effect: Effect, obstacles: Obstacles) -> None:
        """Let the wheels turn for one tick, in legs as for `drive_through`, while a disturbance holds the robot."""
        if legs:
            self.drive_through(legs, _NOTHING_AROUND)
            # At once, the robot keeps its speed; over a time, it does not move by itself.
            if effect.is_in_hand or not effect.put_down:
                self.state[STATE["vx"]] = self.state[STATE["wz"]] = self.state[STATE["vy"]] = 0.0
            self.track[:, 1:4], self.track[:, 4:] = effect.pose, 0.0
        self.state[:3] = effect.pose
        if effect.is_in_hand:
            self.state[STATE["gap"]], self.state[STATE["nearest"]], self.state[STATE["touching"]] = (
                math.inf,
                NOTHING,
                0.0,
            )
        else:
            self.stand(obstacles)

    def slip(self, effect: Effect, time: float) -> None:
        """Add to the odometry what the wheels report beside their own motion in a tick of `time`, s."""
        first, last = STATE["odo_x"], STATE["odo_heading"] + 1
        x, y, heading = self.state[first:last].tolist()
        self.state[first:last] = compose((x, y, heading), effect.slip)
        if effect.takes_time and time > 0.0:
            self.state[STATE["odo_vx"]] += effect.slip[0] / time
            self.state[STATE["odo_wz"]] += effect.slip[2] / time

    def stand(self, obstacles: Obstacles) -> None:
        """Measure the clearance without moving."""
        x, y, heading = self.state[:3]
        gap, nearest = clearance_at(x, y, heading, self._footprint, self._height, obstacles)
        self.state[STATE["gap"]], self.state[STATE["nearest"]], self.state[STATE["touching"]] = gap, nearest, gap == 0.0

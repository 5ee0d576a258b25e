"""Drives a robot without room to turn to a place where it can turn. Pure; SI."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import product

import numpy as np
from numpy.typing import NDArray

from navloom_recoveries.motion import gap
from navloom_recoveries.way_out import STEP, has_room, way_out

__all__ = ["DrivingOut"]

Floats = NDArray[np.float64]
Pose = tuple[float, float, float]

CLOSE = 0.1
"""Gap below which a robot drives out in the first attempt already, m."""
FAR = 0.2
"""Gap, to the nearest of many noisy echoes, with which a robot need not look, m."""
ROOMS = (0.1, 0.05, 0.02)
"""Room beside the turning robot, m, in order of preference; n times as much in the n-th attempt.

An echo of a laser with a noise of 3 cm may be 5 cm too near, and the gate keeps a margin to it.
"""
SHARES = (1.0, 0.6, 0.4)
"""Shares of the wished margin, in order of preference; 0.4 of 3 cm is just more than the gate's 1 cm."""
LOOK = 0.3
"""Time for which the robot looks before it chooses a way, s: the mean of several scans is less noisy."""
HELD = 1.0
"""Time without progress after which the gate counts as holding the robot, s: at 2 cm/s, its slowest, it makes 2 cm."""
STRAIGHT = 0.1
"""How far the robot drives straight on where the gate does not let it bend, m."""
STARTING = 0.02
"""Speed of a stopped robot that its turn rate is computed for, m/s."""
TRIES = 8
"""Most ways without a move in one attempt."""
MOVED = 0.05
"""Least such move, m."""
LONGEST_DRIVE = 120.0
"""Longest drive, s."""
AHEAD = 8
"""How many poses ahead the place on the way is looked for."""
BACK_TO_WAY, BACK_TO_HEADING = 6.0, 4.0
"""Gains of the distance from the way, 1/m², and of the heading, 1/m: critically damped is 4·6 = 4.9²."""


class DrivingOut:
    """Looks for a way out, follows it, and looks again where the gate holds the robot.

    Args:
        edges: Of the footprint, see `motion.edges_of`.
        radius: Of the circle round the base that holds the footprint, m.
        margin: Gap to keep to what is sensed, m.
        speed, turn_rate: Largest, m/s and rad/s.
        delay: Lag and dead time of the motors, s.

    Attributes:
        has_arrived: The robot came to where it can turn.
    """

    def __init__(
        self, edges: Floats, radius: float, margin: float, speed: float, turn_rate: float, delay: float
    ) -> None:
        self._edges, self._radius, self._margin = edges, radius, margin
        self._speed, self._turn_rate, self._patience = speed, turn_rate, HELD + delay
        self.start(0.0, 1)

    def start(self, time: float, attempt: int) -> None:
        """Start an attempt, numbered from 1, at a run time, s."""
        self._attempt = attempt
        self._rooms = [self._radius + attempt * room for room in ROOMS]
        self.has_arrived = False
        self._goes, self._tries, self._began, self._place = [True, True], TRIES, time, (math.inf, 0.0)
        self._look_again(time)

    def _look_again(self, time: float) -> None:
        self._way, self._at, self._moved_at, self._from = np.empty((0, 5)), 0, time, (0.0, 0.0, 0.0)
        self._straight = 0.0
        self._choices: Iterator[tuple[float, tuple[bool, bool], float]] | None = None
        self._seen = np.empty((0, 2))

    def step(
        self, time: float, pose: Pose, moving: float, echoes: Floats, mapped: Floats
    ) -> tuple[float, float] | None:
        """Speed, m/s, and turn rate, rad/s; None at the end, and where the robot has room already.

        Args:
            time: Run time, s. pose: x, y, m, heading, rad, map frame. moving: Its speed, m/s.
            echoes: (k, 2) of the last scans, m, base frame. mapped: (n, 2) surfaces of the map near the robot, m.
        """
        if not len(self._way):
            is_first = self._attempt == 1 and not self._has_driven
            if is_first and len(echoes) and gap(np.concatenate([echoes, mapped]), self._edges) > FAR:
                return None
            if self._choices is None and time - self._moved_at < LOOK:
                return 0.0, 0.0
            is_over = self._tries == 0 or time - self._began > LONGEST_DRIVE
            if is_over or not self._choose(time, pose, echoes, mapped):
                return None
            if not len(self._way):
                return 0.0, 0.0
        x, y, heading = _seen_from(self._from, pose)
        if self._straight != 0.0:
            return self._go_straight(time, math.hypot(x, y))
        before, ahead = self._at, float(self._way[self._at, 4])
        ends = np.flatnonzero(self._way[self._at :, 4] != ahead)
        last = self._at + int(ends[0]) if len(ends) else len(self._way)
        # Only ahead, and only up to the next change of direction: where a way crosses itself, the nearest pose may be
        # another leg's.
        near = self._way[self._at : min(last, self._at + AHEAD)]
        self._at += int(np.argmin(np.hypot(near[:, 0] - x, near[:, 1] - y)))
        if self._at == len(self._way) - 1:
            self.has_arrived = True
            return None
        if self._at == last - 1:
            self._at = last
        if self._at > before:
            self._moved_at = time
        # The gate sees more than the search: what holds the robot may be of its margin to noise.
        elif time - self._moved_at > self._patience:
            self._straight, self._from, self._moved_at = ahead, pose, time
            return 0.0, 0.0
        return self._follow(x, y, heading, min(self._speed, abs(moving) + STARTING))

    def _go_straight(self, time: float, driven: float) -> tuple[float, float]:
        """Leave a place where the gate holds the robot because the bend is too narrow for what it sees."""
        if driven < STRAIGHT and time - self._moved_at < self._patience + STRAIGHT / self._speed:
            return self._straight * self._speed, 0.0
        if driven < 0.5 * STEP:
            # It did not move straight on either: this direction is blocked.
            self._goes[0 if self._straight > 0.0 else 1] = False
            if not any(self._goes):  # the noise of a scan may have held it
                self._goes = [True, True]
        self._look_again(time)
        return 0.0, 0.0

    @property
    def _has_driven(self) -> bool:
        """Whether a way was chosen in this attempt."""
        return math.isfinite(self._place[0])

    def _follow(self, x: float, y: float, heading: float, pace: float) -> tuple[float, float]:
        """The command; it turns as fast as fits the pace, m/s, that it has, or it would turn on the spot at first."""
        way_x, way_y, way_heading, bend, ahead = self._way[self._at]
        beside = math.cos(way_heading) * (y - way_y) - math.sin(way_heading) * (x - way_x)
        off = math.remainder(heading - way_heading, math.tau)
        turn = pace * (ahead * (bend - BACK_TO_WAY * beside) - BACK_TO_HEADING * off)
        return float(ahead * self._speed), float(min(max(turn, -self._turn_rate), self._turn_rate))

    def _choose(self, time: float, pose: Pose, echoes: Floats, mapped: Floats) -> bool:
        """Try one more choice of room, directions and margin; False if there is none left, or no need for a way.

        Only one in a tick: a search takes up to 0.1 s.
        """
        if self._choices is None:
            self._from, self._seen = pose, _surroundings(echoes, mapped)
            if has_room(self._seen, self._rooms[-1]):
                self.has_arrived = self._has_driven
                return False
            if self._attempt == 1 and not self._has_driven and gap(self._seen, self._edges) >= CLOSE:
                return False
            moved = math.dist(pose[:2], self._place) >= MOVED
            self._tries = TRIES if moved else self._tries - 1
            self._place = pose[:2] if moved else self._place
            both = (self._goes[0], self._goes[1])
            # Forwards only first: the gate lets no robot back into space that it has not seen.
            self._choices = product(self._rooms, ((self._goes[0], False), both), SHARES)
        choice = next(self._choices, None)
        if choice is None:
            return False
        room, goes, share = choice
        self._way = way_out(self._seen, self._edges, self._radius, share * self._margin, room, goes)
        self._moved_at = time
        return True


def _seen_from(origin: Pose, pose: Pose) -> Pose:
    """A pose in the frame of another one."""
    cos, sin, dx, dy = math.cos(origin[2]), math.sin(origin[2]), pose[0] - origin[0], pose[1] - origin[1]
    return cos * dx + sin * dy, cos * dy - sin * dx, pose[2] - origin[2]


def _surroundings(echoes: Floats, mapped: Floats) -> Floats:
    """(k, 2) echoes and surfaces of the map, m: a surface of the map is smoother than its echoes, and longer."""
    seen = _less_noisy(echoes)
    if not len(mapped):
        return seen
    is_new = np.array([np.hypot(*(mapped - place).T).min() > CLOSE for place in seen], dtype=bool)
    return np.concatenate([seen[is_new], mapped])


def _less_noisy(echoes: Floats) -> Floats:
    """(k, 2) the echo of median distance in each degree, m, base frame."""
    if not len(echoes):
        return echoes
    degrees = np.floor(np.degrees(np.arctan2(echoes[:, 1], echoes[:, 0]))).astype(np.int64)
    order = np.lexsort((np.hypot(echoes[:, 0], echoes[:, 1]), degrees))
    _, first, count = np.unique(degrees[order], return_index=True, return_counts=True)
    found: Floats = echoes[order[first + count // 2]]
    return found

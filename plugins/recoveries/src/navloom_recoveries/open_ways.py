"""Which straight ways from where a robot stands are open, as its beams show, and which leads to a new place. Pure; SI.

It needs no pose in a map: the frame is that of the odometry, whose drift over some tens of metres does not matter here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["OpenWays"]

Floats = NDArray[np.float64]
Pose = tuple[float, float, float]

WAYS = 144
"""Number of headings that are looked at: one each 2.5 degrees, at 3 m 13 cm apart."""
SIGHT = 8.0
"""Longest way that is told from a longer one, m."""
REACH = 3.0
"""How far ahead a place counts as new, m."""
LONG, TURNED = 0.05, 0.1
"""Values of a metre of open way, and of half a turn, against a metre of new place, m."""

BINS = 720
"""Number of directions in which the nearest echo is kept: one each half a degree."""
BIN = math.tau / BINS
HEADINGS = (np.arange(WAYS) + 0.5) * (math.tau / WAYS)


class OpenWays:
    """What the beams show around one place.

    Args:
        half_width: Of the strip that has to be free, m. front: How far the robot reaches ahead of its base, m.
    """

    def __init__(self, half_width: float, front: float) -> None:
        self._half_width, self._front = half_width, front
        self.clear()

    def clear(self) -> None:
        """Forget what was seen, as the robot has moved."""
        self._is_seen = np.zeros(WAYS, dtype=np.bool_)
        self._points: list[Floats] = []

    def look(self, pose: Pose, bearings: Floats, half_angles: Floats, points: Floats) -> None:
        """Take a scan.

        Args:
            pose: x, y, m, heading, rad, odometry frame.
            bearings, half_angles: (n,) of the beams, rad, base frame.
            points: (k, 2) their echoes, m, base frame.
        """
        x, y, heading = pose
        off = np.abs(np.mod(HEADINGS[:, None] - heading - bearings + math.pi, math.tau) - math.pi)
        self._is_seen |= (off <= np.maximum(half_angles, math.pi / WAYS)).any(axis=1)
        cos, sin = math.cos(heading), math.sin(heading)
        placed = [x + cos * points[:, 0] - sin * points[:, 1], y + sin * points[:, 0] + cos * points[:, 1]]
        self._points.append(np.stack(placed, axis=1))

    def lengths(self, place: tuple[float, float]) -> Floats:
        """(WAYS,) how far the robot can drive at each heading, m; 0 where no beam looked."""
        points = np.concatenate([np.empty((0, 2)), *self._points]) - place
        # In each direction the nearest echo is enough: it is in the way of every heading that a farther one blocks.
        bearings = np.floor(np.mod(np.arctan2(points[:, 1], points[:, 0]), math.tau) / BIN).astype(np.int64)
        near = np.full(BINS + 1, np.inf)
        np.minimum.at(near, bearings, np.hypot(points[:, 0], points[:, 1]))
        is_heard = near < SIGHT + self._front
        angles = (np.flatnonzero(is_heard) + 0.5) * BIN
        points = near[is_heard, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        cos, sin = np.cos(HEADINGS)[:, None], np.sin(HEADINGS)[:, None]
        ahead, beside = cos * points[:, 0] + sin * points[:, 1], cos * points[:, 1] - sin * points[:, 0]
        is_in_way = (ahead > 0.0) & (np.abs(beside) < self._half_width)
        found = np.where(is_in_way, ahead - self._front, SIGHT).min(axis=1, initial=SIGHT)
        return np.where(self._is_seen, np.maximum(found, 0.0), 0.0)

    def best(
        self, pose: Pose, visited: Sequence[tuple[float, float]], least: float, most_turn: float
    ) -> tuple[float, float] | None:
        """Heading, rad, and open length, m, of the way that leads farthest from the places visited so far.

        Args:
            pose: Of the robot. visited: Places, m, at least one.
            least: Least open length, m. most_turn: Largest turn that the robot can make, rad.

        Returns:
            None if no way is open.
        """
        lengths = self.lengths(pose[:2])
        turns = np.abs(np.mod(HEADINGS - pose[2] + math.pi, math.tau) - math.pi)
        far = np.minimum(lengths, REACH)[:, None] * np.stack([np.cos(HEADINGS), np.sin(HEADINGS)], axis=1) + pose[:2]
        new = np.hypot(*(far[:, None] - np.array(visited)).transpose(2, 0, 1)).min(axis=1)
        worth = np.minimum(new, REACH) + LONG * lengths - TURNED * turns / math.pi
        worth[(lengths < least) | (turns > most_turn)] = -math.inf
        way = int(np.argmax(worth))
        return None if worth[way] == -math.inf else (float(HEADINGS[way]), float(lengths[way]))

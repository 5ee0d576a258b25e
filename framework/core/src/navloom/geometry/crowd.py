"""The actors that give way: where each is, which goal it goes to next, and when one of a flow enters again."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from navloom.geometry.actors import Actor, Walk
from navloom.geometry.compiled import compiled

__all__ = ["ARRIVED", "Crowd"]

Floats = NDArray[np.float64]
Numbers = NDArray[np.int64]
Flags = NDArray[np.bool_]
ARRIVED = 0.3
"""A walking actor is at a goal within this distance, m."""
TURNS = 0.05
"""A walking actor that is slower keeps its heading, m/s."""
MARGIN = 0.05
"""Width that an actor adds to its radius to give way, m: more than bodies come too near where a dense crowd leaves no
velocity that avoids everybody."""
ROOM = 0.5
"""One of a flow enters when nothing that moves is within this distance of its body, m; it then stands for a moment."""


class Crowd:
    """State of the actors that give way, by number.

    Args:
        actors: Those of a world on a `Walk`.

    Attributes:
        places, velocities: (k, 2) m and m/s, map frame.
        radii: (k,) with which each gives way, m.
        max_speeds: (k,) m/s.
        sees_robots: (k,) whether each gives way to robots.
        is_there: (k,) whether each is in the world now.
    """

    def __init__(self, actors: Sequence[Actor]) -> None:
        walks = [actor.course for actor in actors if isinstance(actor.course, Walk)]
        self.places = np.array([walk.start for walk in walks], dtype=np.float64).reshape(-1, 2)
        self.velocities = np.zeros_like(self.places)
        self.radii = np.array([actor.body.radius + MARGIN for actor in actors])
        self.max_speeds = np.array([walk.most for walk in walks])
        self.sees_robots = np.array([walk.sees_robots for walk in walks], dtype=np.bool_)
        self._entries = np.array([walk.entry or walk.start for walk in walks], dtype=np.float64).reshape(-1, 2)
        self._speeds = np.array([walk.speed for walk in walks])
        self._loops = np.array([walk.loops for walk in walks], dtype=np.bool_)
        self._flows = np.array([walk.flows for walk in walks], dtype=np.bool_)
        self._appear = np.array([actor.appears_at for actor in actors])
        self.is_there = self._appear <= 0.0
        self._counts = np.array([len(walk.goals) for walk in walks], dtype=np.int64)
        self._goals = np.zeros((len(walks), max(self._counts, default=1), 2))
        for walk, row in zip(walks, self._goals, strict=True):
            row[: len(walk.goals)] = walk.goals
        self._next, self._walked = np.zeros(len(walks), dtype=np.int64), np.zeros(len(walks))
        ahead = self._goals[:, 0] - self.places
        self._headings = np.arctan2(ahead[:, 1], ahead[:, 0])
        nobody = np.zeros(0, dtype=np.int64)
        self.preferred(nobody, 1.0)  # no control tick compiles
        self.go(nobody, np.zeros((0, 2)), 1.0)

    def preferred(self, who: Numbers, step: float) -> Floats:
        """(n, 2) velocities towards their next goals, m/s, that do not overshoot them in a step of a duration, s."""
        found = np.zeros((len(who), 2))
        _prefer(who, self.places, self._goals, self._next, self._counts, self._speeds, step, found)
        return found

    def go(self, who: Numbers, velocities: Floats, step: float) -> None:
        """Walk for a step, s, at velocities, (n, 2), m/s; those that reach a goal take the next one, or leave."""
        self.velocities[who] = velocities
        _go(
            who, velocities, step, self.places, self._headings, self._walked, self._goals, self._next, self._counts,
            self._loops, self._flows, self.is_there,
        )  # fmt: skip

    def enter(self, time: float, others: Floats) -> None:
        """Let those enter who have not appeared until a run time, s, and those of a flow whose entry is free.

        Args:
            time: Run time, s.
            others: (m, 5) everything else that moves: x, y, m, velocity, m/s, map frame, and radius, m.
        """
        for k in np.flatnonzero(~self.is_there & (self._appear <= time)).tolist():
            if self._next[k] < self._counts[k]:  # it appears where the world places it, whatever is there
                self.is_there[k] = True
                continue
            x, y = self._entries[k]
            near = np.hypot(*(self.places - (x, y)).T) - self.radii < self.radii[k] + ROOM
            far = np.hypot(others[:, 0] - x, others[:, 1] - y) - others[:, 4] >= self.radii[k] + ROOM
            if (near & self.is_there).any() or not far.all():
                continue
            self.is_there[k], self.places[k], self.velocities[k], self._next[k] = True, (x, y), 0.0, 0
            ahead = self._goals[k, 0] - self.places[k]
            self._headings[k] = math.atan2(ahead[1], ahead[0])

    def motions(self, who: Numbers) -> Floats:
        """(n, 6) rows of `Motion`."""
        rows = np.empty((len(who), 6))
        rows[:, :2], rows[:, 2], rows[:, 3:5] = self.places[who], self._headings[who], self.velocities[who]
        rows[:, 5] = self._walked[who]
        return rows


@compiled
def _prefer(
    who: Numbers, places: Floats, goals: Floats, following: Numbers, counts: Numbers, speeds: Floats, step: float,
    found: Floats,
) -> None:  # fmt: skip
    """Fill in the velocities towards goals, (n, 2) m/s; rows of actors that have none left are not changed."""
    for row in range(who.size):
        k = who[row]
        if following[k] < counts[k]:
            x, y = goals[k, following[k], 0] - places[k, 0], goals[k, following[k], 1] - places[k, 1]
            distance = math.hypot(x, y)
            scale = min(speeds[k], distance / step) / max(distance, 1e-9)
            found[row, 0], found[row, 1] = x * scale, y * scale


@compiled
def _go(
    who: Numbers, velocities: Floats, step: float, places: Floats, headings: Floats, walked: Floats, goals: Floats,
    following: Numbers, counts: Numbers, loops: Flags, flows: Flags, is_there: Flags,
) -> None:  # fmt: skip
    """Move actors by their velocities, (n, 2) m/s, for a step, s; all arrays of state change in place."""
    for row in range(who.size):
        k, vx, vy = who[row], velocities[row, 0], velocities[row, 1]
        speed = math.hypot(vx, vy)
        places[k, 0] += step * vx
        places[k, 1] += step * vy
        walked[k] += step * speed
        if speed > TURNS:
            headings[k] = math.atan2(vy, vx)
        goal = following[k]
        if goal == counts[k] or not (
            math.hypot(goals[k, goal, 0] - places[k, 0], goals[k, goal, 1] - places[k, 1]) < ARRIVED
        ):
            continue
        following[k] = goal + 1
        if following[k] == counts[k]:
            is_there[k] = not flows[k]
            following[k] = 0 if loops[k] else following[k]

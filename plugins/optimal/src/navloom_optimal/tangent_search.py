"""The shortest path among many shapes: A* on a tangent graph that is built only where the search reaches it.

In the graph of all free tangents and arcs, the shortest path is exactly the shortest path of the disc. It turns around
each circle in one sense, so a vertex is a departure from a side: a circle with its sense of turning. A side's
departures are found when the search first arrives there.
"""

from __future__ import annotations

import heapq
import math
from array import array
from bisect import bisect_left
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from navloom_optimal.buckets import Buckets, arc_is_free
from navloom_optimal.circles import Circles, ShortestPath, on_arc
from navloom_optimal.visible_tangents import (
    ANGLE_SLACK,
    ARRIVES,
    ENDS,
    GOAL,
    LEAVES,
    LENGTH,
    SIDE,
    visible_tangents,
)

__all__ = ["TangentSearch"]

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class _Side:
    """A circle with a sense of turning, with its departures numbered from `first`, `leaves` rad along the arc."""

    circle: int
    turn: float
    first: int
    leaves: array[float]


@dataclass(eq=False)
class TangentSearch:
    """One search.

    Attributes:
        circles: The ends of the path, and the circles of all shapes.
        buckets: The shapes.
        sides: Sides with known departures, by number.
        side_of: Number of each departure's side.
        sides_there, arrives, lengths: For each departure's tangent: the side it arrives at, the arc to the arrival
            there, rad, and its length, m.
        segments: x1, y1, x2, y2, m, of each departure's tangent.
        costs: Length of the shortest path to each departure so far, m.
        before: Predecessor of each departure: 2 * departure on the same side, 2 * departure + 1 by its tangent, -1 at
            the start.
        looked_at: Number of tangents tested.
    """

    circles: Circles
    buckets: Buckets
    sides: dict[int, _Side] = field(default_factory=dict)
    side_of: array[int] = field(default_factory=lambda: array("q"))
    sides_there: array[int] = field(default_factory=lambda: array("q"))
    arrives: array[float] = field(default_factory=lambda: array("d"))
    lengths: array[float] = field(default_factory=lambda: array("d"))
    segments: array[float] = field(default_factory=lambda: array("d"))
    costs: array[float] = field(default_factory=lambda: array("d"))
    before: array[int] = field(default_factory=lambda: array("q"))
    looked_at: int = 0
    _heap: list[tuple[float, float, int]] = field(default_factory=list)
    _goal: list[float] = field(init=False)

    def __post_init__(self) -> None:
        self._goal = self.circles.places[GOAL, :2].tolist()

    def run(self) -> ShortestPath | None:
        """The shortest path; None if there is none."""
        start = self._side(0)
        for departure in range(start.first, start.first + len(start.leaves)):
            self._offer(departure, 0.0, -1)
        while self._heap:
            _, cost, entry = heapq.heappop(self._heap)
            departure, has_passed = divmod(entry, 2)
            if has_passed:
                if self.sides_there[departure] == 2 * GOAL:
                    return ShortestPath(cost, self._track(departure))
                self._arrive(departure, cost)
            elif cost == self.costs[departure]:
                self._push(departure, True, cost + self.lengths[departure])
                self._turn_on(departure, cost)
        return None

    def _arrive(self, departure: int, cost: float) -> None:
        """Continue at the side where a departure's tangent arrives, to its next departure."""
        side = self._side(self.sides_there[departure])
        at = self.arrives[departure]
        place = bisect_left(side.leaves, at - ANGLE_SLACK)
        self._turn(side, at, place, cost, 2 * departure + 1)

    def _turn_on(self, departure: int, cost: float) -> None:
        """Continue to the next departure of the same side."""
        side = self.sides[self.side_of[departure]]
        place = departure - side.first
        if self.circles.places[side.circle, 2] > 0.0:
            self._turn(side, side.leaves[place], place + 1, cost, 2 * departure)

    def _turn(self, side: _Side, at: float, place: int, cost: float, before: int) -> None:
        """Turn along the arc of a side, from a position `at` on it, rad, to the departure at index `place`."""
        full = 0.0
        if place == len(side.leaves):
            if not side.leaves or self.circles.usable[side.circle, 1] < 6.28:
                return
            place, full = 0, 2.0 * math.pi
        span = max(0.0, side.leaves[place] + full - at)
        x, y, r = self.circles.places[side.circle].tolist()
        reached = cost + span * r
        departure = side.first + place
        if reached < self.costs[departure]:
            first, extent = self.circles.usable[side.circle].tolist()
            low = first + at if side.turn > 0.0 else first + extent - at - span
            owner = int(self.circles.owners[side.circle])
            if arc_is_free(x, y, r, low, low + span, owner, self.buckets):
                self._offer(departure, reached, before)

    def _offer(self, departure: int, cost: float, before: int) -> None:
        self.costs[departure] = cost
        self.before[departure] = before
        self._push(departure, False, cost)

    def _push(self, departure: int, has_passed: bool, cost: float) -> None:
        at = 4 * departure + 2 * has_passed
        gx, gy = self._goal
        bound = cost + math.hypot(self.segments[at] - gx, self.segments[at + 1] - gy)
        heapq.heappush(self._heap, (bound, cost, 2 * departure + has_passed))

    def _side(self, number: int) -> _Side:
        """A side; its departures are found on first use."""
        side = self.sides.get(number)
        if side is None:
            circle, turn = number // 2, -1.0 if number % 2 else 1.0
            found, looked_at = visible_tangents(circle, turn, self.circles.places, self.circles.usable, self.buckets)
            side = _Side(circle, turn, len(self.costs), array("d", found[:, LEAVES].tobytes()))
            self.sides[number] = side
            self.looked_at += looked_at
            self.side_of.extend([number] * len(found))
            self.sides_there.frombytes(found[:, SIDE].astype(np.int64).tobytes())
            self.arrives.frombytes(found[:, ARRIVES].tobytes())
            self.lengths.frombytes(found[:, LENGTH].tobytes())
            self.segments.frombytes(found[:, ENDS].tobytes())
            self.costs.extend([math.inf] * len(found))
            self.before.extend([-1] * len(found))
        return side

    def _track(self, departure: int) -> Floats:
        """(n, 2) points of the path to a departure's arrival, m."""
        points = []
        while True:
            points.append(np.array(self.segments[4 * departure : 4 * departure + 4]).reshape(2, 2)[::-1])
            before = self.before[departure]
            while before >= 0 and before % 2 == 0:
                before = self.before[before // 2]
            if before < 0:
                return np.concatenate(points)[::-1]
            side = self.sides[self.side_of[departure]]
            points.append(self._arc(side, self.arrives[before // 2], side.leaves[departure - side.first])[::-1])
            departure = before // 2

    def _arc(self, side: _Side, arrives: float, leaves: float) -> Floats:
        """(n, 2) points of an arc of a side, between two positions along it, rad."""
        if leaves < arrives - ANGLE_SLACK:
            leaves += 2.0 * math.pi
        first, extent = self.circles.usable[side.circle].tolist()
        angles = np.array([arrives, leaves])
        angles = first + angles if side.turn > 0.0 else first + extent - angles
        return on_arc(self.circles.places[side.circle], angles)

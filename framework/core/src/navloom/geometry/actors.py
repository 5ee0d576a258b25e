"""Actors: what moves in a world by itself, as data. `moving_world` moves them, and every simulated platform reads it.

An actor is a body on a `Course`, which is a function of time alone (scripted way points, recorded people), or on a
`Walk`, which depends on what is around it (reactive people).
"""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import accumulate, pairwise
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Actor", "Body", "Course", "Walk"]

BodyKind = Literal["disc", "box", "legs", "trolley"]
Keys = Literal["linear", "spline", "gazebo"]
Part = tuple[float, float, float, float, float, float, float, float]
"""An upright cylinder or box: x, y of its centre, m; half its length, or its radius, m; half its width, m, or 0 for a
cylinder; yaw, rad; lowest and highest z, m; 1 if light passes it. Map frame."""

LEG_RADIUS, HIP, STEP, CROTCH = 0.07, 0.11, 0.6, 0.8
"""Of a walking person, m: radius of a leg, its distance from the middle, length of a step, height of the legs."""
POST_RADIUS, DECK = 0.02, 0.55
"""Of a trolley, m: radius of its corner posts, and height of its deck: a level laser below sees only the posts."""


@dataclass(frozen=True)
class Body:
    """The shape of an actor.

    Attributes:
        kind: "disc", an upright cylinder; "box"; "legs", two discs that walk, and a trunk above them; "trolley", four
            thin posts and a deck above them.
        length, width: Along and across its heading, m; of a disc both are its diameter, of legs that of the trunk.
        z: Lowest and highest point, m.
        is_glass: Light passes it.
    """

    kind: BodyKind = "disc"
    length: float = 0.5
    width: float = 0.5
    z: tuple[float, float] = (0.0, 1.8)
    is_glass: bool = False

    @property
    def radius(self) -> float:
        """Radius of the disc about it, m."""
        is_round = self.kind in ("disc", "legs")
        return 0.5 * (max(self.length, self.width) if is_round else math.hypot(self.length, self.width))


class Motion(NamedTuple):
    """Where an actor is: x, y, m, and heading, rad, map frame; velocity, m/s, map frame; and distance walked, m."""

    x: float
    y: float
    heading: float
    vx: float
    vy: float
    walked: float


@dataclass(frozen=True)
class Course:
    """Places over time: what is scripted, or recorded.

    Attributes:
        points: Time, s, rising, and x, y, m, map frame.
        keys: How it goes from point to point: "linear"; "spline", a cubic curve whose velocity does not jump; "gazebo",
            the Catmull-Rom spline over equal steps, whatever the times, by which Gazebo animates key frames.
        loops: It begins again, with the last time as its period.
        leaves: The actor is there from the first time to the last only; otherwise it stays at the ends.
        phase: Time of the course at the beginning of the run, s.
        heading: Its heading, rad, if it does not turn; otherwise it faces where it goes.
    """

    points: tuple[tuple[float, float, float], ...]
    keys: Keys = "linear"
    loops: bool = False
    leaves: bool = False
    phase: float = 0.0
    heading: float | None = None

    def at(self, time: float) -> Motion | None:
        """Where the actor is at a run time, s; None if it is not there."""
        points, time = self.points, time + self.phase
        last = points[-1][0]
        if self.loops and last > 0.0:
            time = math.fmod(time, last)
        if time < points[0][0] or time > last or len(points) == 1:
            if self.leaves and not points[0][0] <= time <= last:
                return None
            is_before = time <= points[0][0]
            _, x, y = points[0 if is_before else -1]
            return Motion(x, y, self._heads[0 if is_before else -1], 0.0, 0.0, 0.0 if is_before else self._ways[-1])
        # As `position_at` has it: a way point belongs to the piece that ends there.
        k = max(bisect_right(self._times, time) - 1, 0)
        if k and self._times[k] == time:
            k -= 1
        k = min(k, len(points) - 2)
        (t0, x0, y0), (t1, x1, y1) = points[k], points[k + 1]
        share, length = (time - t0) / (t1 - t0), t1 - t0
        walked = self._ways[k] + share * (self._ways[k + 1] - self._ways[k])
        if self.keys == "linear":
            x, y, vx, vy = x0 + share * (x1 - x0), y0 + share * (y1 - y0), (x1 - x0) / length, (y1 - y0) / length
            return Motion(x, y, self._heads[k], vx, vy, walked)
        (a0, b0), (a1, b1) = self._tangents[k]
        x, vx = _hermite(x0, x1, a0, a1, share, length)
        y, vy = _hermite(y0, y1, b0, b1, share, length)
        turns = self.heading is None and math.hypot(vx, vy) > 1e-9
        return Motion(x, y, math.atan2(vy, vx) if turns else self._heads[k], vx, vy, walked)

    @cached_property
    def _times(self) -> list[float]:
        return [point[0] for point in self.points]

    @cached_property
    def _ways(self) -> list[float]:
        """Distance walked up to each point, m, along chords."""
        steps = [math.hypot(x1 - x0, y1 - y0) for (_, x0, y0), (_, x1, y1) in pairwise(self.points)]
        return list(accumulate(steps, initial=0.0))

    @cached_property
    def _heads(self) -> list[float]:
        """Heading of each piece, rad; while it rests, that of the piece before, or else of the first that moves."""
        if self.heading is not None:
            return [self.heading] * max(1, len(self.points) - 1)
        moves = [(x1 - x0, y1 - y0) for (_, x0, y0), (_, x1, y1) in pairwise(self.points)]
        turns = [math.atan2(dy, dx) for dx, dy in moves if dx or dy]
        held, heads = turns[0] if turns else 0.0, []
        for dx, dy in moves:
            held = math.atan2(dy, dx) if dx or dy else held
            heads.append(held)
        return heads or [held]

    @cached_property
    def _tangents(self) -> list[tuple[tuple[float, float], tuple[float, float]]]:
        """At both ends of each piece, the change of place over the piece at the velocity there, m."""
        points, count = self.points, len(self.points)
        is_closed = count > 2 and points[0][1:] == points[-1][1:]
        around = []
        for k in range(count):
            before, after = points[max(k - 1, 0)], points[min(k + 1, count - 1)]
            if is_closed and k in (0, count - 1):
                before, after = points[-2], points[1]
            time = after[0] - before[0]
            around.append((after[1] - before[1], after[2] - before[2], time if time > 0.0 else time + points[-1][0]))
        if self.keys == "gazebo":
            slopes = [(0.5 * dx, 0.5 * dy, 1.0) for dx, dy, _ in around]
            return [((a[0], a[1]), (b[0], b[1])) for a, b in pairwise(slopes)]
        found = []
        for (a, b), (t0, t1) in zip(pairwise(around), pairwise(self._times), strict=True):
            found.append(
                ((a[0] * (t1 - t0) / a[2], a[1] * (t1 - t0) / a[2]), (b[0] * (t1 - t0) / b[2], b[1] * (t1 - t0) / b[2]))
            )
        return found


def _hermite(p0: float, p1: float, m0: float, m1: float, u: float, length: float) -> tuple[float, float]:
    """Value and velocity of the cubic from p0 to p1 with the slopes m0 and m1, at u in [0, 1]; it takes `length` s."""
    value = (
        p0 * (1.0 + 2.0 * u) * (1.0 - u) ** 2 + m0 * u * (1.0 - u) ** 2
        + p1 * u * u * (3.0 - 2.0 * u) + m1 * u * u * (u - 1.0)
    )  # fmt: skip
    slope = 6.0 * u * (1.0 - u) * (p1 - p0) + m0 * (1.0 - u) * (1.0 - 3.0 * u) + m1 * u * (3.0 * u - 2.0)
    return value, slope / length


@dataclass(frozen=True)
class Walk:
    """Goals that an actor walks to, and gives way on the way: reactive.

    Attributes:
        start: x, y, m, map frame.
        goals: x, y of each, m, in order.
        speed: At which it walks if nothing is in the way, m/s.
        most: Its highest speed, m/s.
        loops: After the last goal it goes to the first again.
        flows: After the last goal it leaves, and begins again at its entry as soon as that is free: one of a flow.
            Without either it stays at the last goal.
        entry: x, y of the place where one of a flow begins again, m; by default its start.
        sees_robots: It gives way to robots too. In crowds, half of the people do not.
    """

    start: tuple[float, float]
    goals: tuple[tuple[float, float], ...]
    speed: float = 1.2
    most: float = 1.8
    flows: bool = False
    sees_robots: bool = True
    loops: bool = False
    entry: tuple[float, float] | None = None


@dataclass(frozen=True)
class Actor:
    """What moves in a world by itself.

    Attributes:
        name: Its name in messages and errors.
        course: Where it goes.
        body: Its shape.
        appears_at: Run time from which on it is there, s.
    """

    name: str
    course: Course | Walk
    body: Body = Body()
    appears_at: float = 0.0

    @property
    def places(self) -> list[tuple[float, float]]:
        """Places that it goes to, m, map frame, its first one first."""
        course = self.course
        if isinstance(course, Walk):
            return [course.start, *course.goals, *([course.entry] if course.entry else [])]
        return [(x, y) for _, x, y in course.points]


@lru_cache(maxsize=256)
def _shape(body: Body) -> NDArray[np.float64]:
    """(p, 6) of each part, m: ahead and left of the body, half length or radius, half width, lowest and highest z."""
    (low, high), half, side = body.z, 0.5 * body.length, 0.5 * body.width
    if body.kind == "disc":
        shapes = [(0.0, 0.0, half, 0.0, low, high)]
    elif body.kind == "box":
        shapes = [(0.0, 0.0, half, side, low, high)]
    elif body.kind == "trolley":
        deck = min(low + DECK, high)
        shapes = [(i * (half - POST_RADIUS), j * (side - POST_RADIUS), POST_RADIUS, 0.0, low, deck)
                  for i in (-1.0, 1.0) for j in (-1.0, 1.0)]  # fmt: skip
        shapes += [(0.0, 0.0, half, side, deck, high)]
    else:
        top = min(low + CROTCH, high)
        shapes = [(0.0, HIP, LEG_RADIUS, 0.0, low, top), (0.0, -HIP, LEG_RADIUS, 0.0, low, top)]
        shapes += [(0.0, 0.0, half, 0.0, top, high)]
    # Without an upper part where the body ends below it.
    return np.array([shape for shape in shapes if shape[4] < shape[5]])


def parts_of(body: Body, motions: NDArray[np.float64]) -> NDArray[np.float64]:
    """The cylinders and boxes of one body in several places.

    Args:
        body: The body.
        motions: (n, 6) rows of `Motion`.

    Returns:
        (n, p, 8) rows of `Part`.
    """
    places, (x, y, heading, _, _, walked) = _shape(body), motions.T
    c, s = np.cos(heading), np.sin(heading)
    parts = np.empty((len(motions), len(places), 8))
    parts[:, :, 2:4], parts[:, :, 5:7], parts[:, :, 7] = places[:, 2:4], places[:, 4:6], body.is_glass
    swings: list[float | NDArray[np.float64]] = [0.0] * len(places)
    if body.kind == "legs":
        # One foot rests on the floor while the other swings ahead at twice the speed of the body.
        swing = STEP * (0.5 - np.abs(1.0 - np.fmod(walked / STEP, 2.0)))
        swings[:2] = -swing, swing
    for k, (ahead, left, _, side, _, _) in enumerate(places.tolist()):
        ahead += swings[k]
        parts[:, k, 0], parts[:, k, 1] = x + c * ahead - s * left, y + s * ahead + c * left
        parts[:, k, 4] = heading if side > 0.0 else 0.0
    return parts

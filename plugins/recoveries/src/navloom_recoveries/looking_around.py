"""Looks around for a robot that does not know where it is: turns round, then drives to where it has not been. Pure.

It works from echoes and from the odometry's velocity alone, since the pose in the map is not known meanwhile.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navloom_recoveries.driving_out import DrivingOut
from navloom_recoveries.motion import edges_of, margin_of
from navloom_recoveries.open_ways import OpenWays
from navloom_recoveries.surroundings import Surroundings

__all__ = ["LookRules", "LookingAround", "View"]

Floats = NDArray[np.float64]
Phase = Literal["look", "round", "face", "go", "out"]

FIRST_LOOK, LOOK, STUCK_LOOK = 1.0, 0.4, 2.0
"""Time stopped at first, at each place, and where no way is open, s: the localizer may find the robot meanwhile."""
HELD, MOVED, TURNED = 1.0, 0.02, 0.03
"""Time, s, distance, m, and angle, rad: a robot that makes less of a move within the time is held by the gate."""
BESIDE = 0.06
"""Gap on each side of an open way, m: echoes are noisy, and the gate keeps a margin."""
SHORTEST, NEXT_TO_NOTHING, BEFORE = 0.4, 0.1, 0.1
"""Shortest way that is driven, also where no other is open, and how much of an open way is left, m."""
FACED = math.radians(4.0)
"""Largest angle between the robot and its way at which it drives on."""
STRAIGHT = math.radians(15.0)
"""Largest turn of a robot that cannot turn on the spot."""
STEER, SLOWEST_TURN, CREEP = 1.5, 0.2, 0.03
"""Turn rate for an error of the heading, 1/s; least turn rate, rad/s, and least speed, m/s: wheels judder below."""
DRIVES_OUT = 2
"""Attempt, of `DrivingOut`, in which it looks for a way out at any gap."""
APART = 0.5
"""Distance of two places that count as visited, m."""
NO_MAP = np.empty((0, 2))


@dataclass(frozen=True)
class LookRules:
    """Limits of a look around.

    Attributes:
        speed, turn_rate, deceleration: m/s, rad/s, m/s².
        leg: Longest way between two looks, m.
        time, way: Longest time, s, and way, m, of an attempt.
        margin: Gap to keep to sensed points, m. noise: Largest error by which the nearest echo is too near, m.
        memory: How long an echo counts, s.
        delay: Lag and dead time of the motors, s.
    """

    speed: float
    turn_rate: float
    deceleration: float
    leg: float
    time: float
    way: float
    margin: float
    noise: float
    memory: float
    delay: float


class View(NamedTuple):
    """A scan: bearings and half angles of its beams, (n,) rad, and its echoes, (k, 2) m, base frame."""

    bearings: Floats
    half_angles: Floats
    points: Floats


class LookingAround:
    """One attempt after another; each starts with a turn round.

    Args:
        rules: Limits.
        footprint: (n, 2) m, base frame, convex, counter-clockwise.
    """

    def __init__(self, rules: LookRules, footprint: Floats) -> None:
        self.rules = rules
        edges = self._edges = edges_of(footprint)
        self._around = Surroundings(edges, rules.memory, rules.deceleration, rules.delay)
        half_width = float(np.abs(footprint[:, 1]).max()) + BESIDE
        self._ways = OpenWays(half_width, float(footprint[:, 0].max()))
        radius = float(np.hypot(footprint[:, 0], footprint[:, 1]).max())
        self._out = DrivingOut(edges, radius, rules.margin, rules.speed, rules.turn_rate, rules.delay)
        self.start(0.0)

    def start(self, time: float) -> None:
        """Start an attempt at a run time, s."""
        self._pose, self._speed, self._time, self._began, self._way = (0.0, 0.0, 0.0), 0.0, time, time, 0.0
        self._visited, self._side = [(0.0, 0.0)], 1
        self._around.clear()
        self._heading, self._leg = 0.0, 0.0
        self._look(FIRST_LOOK, turns_round=True)

    def _look(self, duration: float, turns_round: bool = False) -> None:
        self._begin("look")
        self._until, self._turns_round, self._has_turned = self._time + duration, turns_round, False
        self._ways.clear()

    def _begin(self, phase: Phase) -> None:
        self.phase = phase
        self._progress, self._moved_at, self._left = 0.0, self._time, math.tau
        self._is_held = {1: False, -1: False}

    def step(self, time: float, v: float, w: float, scans: Iterable[View]) -> tuple[float, float, bool]:
        """Speed, m/s, turn rate, rad/s, and whether the attempt is over.

        Args:
            time: Run time, s.
            v, w: Measured speed, m/s, and turn rate, rad/s.
            scans: New scans.
        """
        turned, driven = self._move(time, v, w)
        scans = list(scans)
        seen = self._around.remember(time, self._pose, [scan.points for scan in scans])
        if self.phase in ("look", "round"):
            for scan in scans:
                self._ways.look(self._pose, *scan)
        if time - self._began > self.rules.time or self._way > self.rules.way:
            return 0.0, 0.0, True
        self._margin = margin_of(seen, self._edges, self.rules.margin, self.rules.noise)
        command = {"look": self._while_looking, "round": self._while_round, "face": self._while_facing,
                   "go": self._while_going, "out": self._while_out}[self.phase](seen, turned, driven)  # fmt: skip
        return *command, False

    def _move(self, time: float, v: float, w: float) -> tuple[float, float]:
        """Integrate the motion since the last step; returns the turn, rad, and the way, m."""
        since = max(0.0, time - self._time)
        x, y, heading = self._pose
        middle = heading + 0.5 * w * since
        self._pose = x + v * since * math.cos(middle), y + v * since * math.sin(middle), heading + w * since
        self._time, self._speed, self._way = time, v, self._way + abs(v) * since
        if math.dist(self._pose[:2], self._visited[-1]) > APART:
            self._visited.append(self._pose[:2])
        return w * since, v * since

    def _while_looking(self, seen: Floats, turned: float, driven: float) -> tuple[float, float]:
        if self._time < self._until:
            return 0.0, 0.0
        if self._turns_round:
            self._begin("round")
        else:
            self._choose()
        return 0.0, 0.0

    def _choose(self) -> None:
        """Choose a way; where none is open, turn round once, and take a short one then, or wait."""
        least = NEXT_TO_NOTHING if self._has_turned else SHORTEST
        found = self._ways.best(self._pose, self._visited, least + BEFORE, math.pi)
        if found is not None:
            self._take(*found)
            self._begin("face")
            self._side = 1 if math.remainder(self._heading - self._pose[2], math.tau) > 0.0 else -1
        elif self._has_turned:
            self._look(STUCK_LOOK, turns_round=True)
        else:
            self._begin("round")

    def _take(self, heading: float, length: float) -> None:
        self._heading, self._leg = heading, min(self.rules.leg, length - BEFORE)

    def _while_round(self, seen: Floats, turned: float, driven: float) -> tuple[float, float]:
        self._left -= abs(turned)
        if self._left > 0.0:
            return self._turn(seen, turned, self.rules.turn_rate)
        self._has_turned = True
        self._choose()
        return 0.0, 0.0

    def _while_facing(self, seen: Floats, turned: float, driven: float) -> tuple[float, float]:
        off = abs(math.remainder(self._heading - self._pose[2], math.tau))
        if off < FACED:
            self._begin("go")
            return 0.0, 0.0
        return self._turn(seen, turned, min(self.rules.turn_rate, max(SLOWEST_TURN, STEER * off)))

    def _turn(self, seen: Floats, turned: float, rate: float) -> tuple[float, float]:
        """Turn to a side, to the other one where that is not free, and drive out where neither is."""
        self._follow_progress(abs(turned), TURNED)
        if self._time - self._moved_at > HELD + self.rules.delay:
            # For as long as this turn lasts: a robot that turned to and fro between two walls would go on for ever.
            self._is_held[self._side], self._moved_at, self._side = True, self._time, -self._side
        if not self._is_held[self._side]:
            w = self._side * rate
            return (0.0, w) if self._around.may(seen, 0.0, w, self._margin) else (0.0, 0.0)
        self._begin("out")
        self._out.start(self._time, DRIVES_OUT)
        return 0.0, 0.0

    def _while_out(self, seen: Floats, turned: float, driven: float) -> tuple[float, float]:
        command = self._out.step(self._time, self._pose, self._speed, seen, NO_MAP)
        if command is not None:
            return command
        # If it cannot turn here, it may still drive on to where it can.
        ahead = None if self._out.has_arrived else self._ways.best(self._pose, self._visited, SHORTEST, STRAIGHT)
        if ahead is None:
            self._look(LOOK if self._out.has_arrived else STUCK_LOOK, turns_round=not self._out.has_arrived)
        else:
            self._take(*ahead)
            self._begin("go")
        return 0.0, 0.0

    def _while_going(self, seen: Floats, turned: float, driven: float) -> tuple[float, float]:
        self._leg -= driven
        self._follow_progress(driven, MOVED)
        is_held = self._time - self._moved_at > HELD + self.rules.delay
        off = math.remainder(self._heading - self._pose[2], math.tau)
        w = min(max(STEER * off, -self.rules.turn_rate), self.rules.turn_rate)
        fastest = min(self.rules.speed, math.sqrt(max(0.0, self._leg * self.rules.deceleration)) + CREEP)
        for speed, turn in ((fastest, w), (0.5 * fastest, w), (CREEP, w), (CREEP, 0.0)):
            if not is_held and self._leg > 0.0 and self._around.may(seen, speed, turn, self._margin):
                return speed, turn
        if self._leg > 0.0:
            # A way that does not lead on counts as visited, or it would be chosen again.
            x, y, heading = self._pose
            self._visited.append((x + math.cos(heading), y + math.sin(heading)))
        self._look(LOOK)
        return 0.0, 0.0

    def _follow_progress(self, step: float, least: float) -> None:
        """Note when the robot last made a move of a least size."""
        self._progress += step
        if self._progress > least:
            self._progress, self._moved_at = 0.0, self._time

"""The hand-over from controller to avoider: one rule for every avoider, so that a comparison is not confounded."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Literal

import numpy as np
from numba import njit
from numpy.typing import NDArray

from navloom.geometry.footprints import circumscribed_radius
from navloom.messages import HandOver, OccupancyGrid, Pose2D, RangeScan, Twist2D
from navloom.navigation import echo_memory
from navloom.navigation.echo_memory import EchoMemory
from navloom.navigation.monitor_map import surfaces_without_echo
from navloom.navigation.monitor_rollout import first_touch

__all__ = ["HandOverRule", "own_turn", "own_way", "warm_up"]

Floats = NDArray[np.float64]

NOWHERE = np.empty((0, 2))
# With 2 s, the avoider would engage in doors that the robot fits through.
HORIZON = 1.0
"""How far ahead the robot's own way is checked, s."""
OWN_STEP = 0.1
"""Distance between two points of that way, m."""
MOST_TURN = 0.5 * math.pi
"""Largest turn along the robot's own way, rad."""
TURN_STEP = 0.02
"""Largest motion of a corner between two poses of a turn, m."""
NO_TURN = np.empty((0, 3))


def own_way(base: Pose2D, twist: Twist2D, reach: float) -> Floats:
    """The way of a robot that keeps a velocity: an arc.

    Args:
        base: Pose of the robot, map frame.
        twist: Commanded velocity.
        reach: Longest way, m.

    Returns:
        (k, 2) points, m, map frame, beginning at the robot; k = 0 if it does not drive forward.
    """
    if twist.vx <= 0.0:
        return NOWHERE
    way: Floats = _arc(base.x, base.y, base.heading, twist.vx, twist.wz, reach)
    return way


def own_turn(twist: Twist2D, footprint: Floats) -> Floats:
    """The poses of a robot that keeps a velocity with which it turns on the spot or drives back.

    A turn whose centre lies under the robot counts as one on the spot: no strip covers what its corners sweep.

    Args:
        twist: Commanded velocity.
        footprint: (n, 2) m, base frame.

    Returns:
        (k, 3) x, y, m, heading, rad, in the frame of the first pose, as far as HORIZON and MOST_TURN; k = 0 if the
        robot stops or drives forward.
    """
    v, w = twist.vx, twist.wz
    # The centre of the turn lies v / w beside the base: under the robot if that is less than its half width.
    if not len(footprint) or v > abs(w) * np.abs(footprint[:, 1]).max() or (v == 0.0 and w == 0.0):
        return NO_TURN
    time = min(HORIZON, MOST_TURN / abs(w)) if w != 0.0 else HORIZON
    radius = circumscribed_radius(footprint)
    steps = math.ceil(time * (abs(v) + radius * abs(w)) / TURN_STEP) + 1
    headings = np.linspace(0.0, w * time, steps)
    # Chord of an arc of length s that turns by a: s sin(a / 2) / (a / 2), which is finite for a straight way too.
    chords = np.linspace(0.0, v * time, steps) * np.sinc(headings / math.tau)
    return np.column_stack([chords * np.cos(0.5 * headings), chords * np.sin(0.5 * headings), headings])


@njit(cache=True, nogil=True, error_model="numpy")
def _arc(x, y, heading, v, w, reach):  # type: ignore[no-untyped-def]
    length = min(reach, v * HORIZON)
    if abs(w) * length > MOST_TURN * v:
        # Beyond a quarter turn the arc leads back beside the robot, which no command keeps up for that long.
        length = MOST_TURN * v / abs(w)
    last = max(2, math.ceil(length / OWN_STEP) + 1) - 1
    way = np.empty((last + 1, 2))
    for k in range(last + 1):
        along = length if k == last else k * (length / last)
        half = 0.5 * (along * (w / v))
        chord = along * _sinc(half / math.pi)
        way[k, 0], way[k, 1] = x + chord * math.cos(heading + half), y + chord * math.sin(heading + half)
    return way


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _sinc(turns):  # type: ignore[no-untyped-def]
    """sin(π t) / (π t), as numpy.sinc."""
    # The same guard as in numpy, so that ways are equal to those of `np.sinc` bit for bit.
    angle = math.pi * (turns if turns != 0.0 else 1e-20)
    return math.sin(angle) / angle


def warm_up() -> None:
    """Compile the kernels, also those of the echo memory."""
    echo_memory.warm_up()
    own_way(Pose2D(0.0, 0.0, 0.0), Twist2D(0.5, 0.0, 0.1), 1.0)
    outline = np.zeros((3, 2))
    outline.flags.writeable = False  # as that of a robot is
    first_touch(NO_TURN, 0, outline, NOWHERE, np.empty(0), 0.0)


class HandOverRule:
    """Engages the avoider when an obstacle lies on the way to the look-ahead point, and releases it with a delay.

    Args:
        mode: "when_blocked", or "always" or "never" for a fixed choice.
        release: How long the corridor must be free before the controller drives again, s.
        keep: How long an echo counts, s: a ring of sonars does not see everything in each tick.
        spread: Share of a sonar's arc that counts; see `EchoMemory`.
        margin: Part of the strip's half width that is room beside the robot, m. The robot's own way is checked
            without it: the next command changes that way, and a robot on a narrow trajectory swings a little.
        footprint: (n, 2) m, base frame, convex, counter-clockwise, for turns.
    """

    def __init__(
        self,
        mode: Literal["when_blocked", "always", "never"],
        release: float,
        keep: float = 0.5,
        spread: float = 0.5,
        margin: float = 0.0,
        footprint: Floats = NOWHERE,
    ) -> None:
        self.mode, self.release, self.margin = mode, release, margin
        self.engaged = mode == "always"
        self._blocked_at = 0.0
        self._memory = EchoMemory(keep, spread)
        self.footprint = np.ascontiguousarray(footprint)

    def reset(self) -> None:
        """Forget echoes and engagement."""
        self.engaged = self.mode == "always"
        self._memory.clear()

    def step(
        self,
        time: float,
        scans: Iterable[RangeScan],
        base: Pose2D,
        way: Floats,
        width: float,
        own: Floats = NOWHERE,
        turn: Floats = NO_TURN,
        grid: OccupancyGrid | None = None,
    ) -> HandOver:
        """Whether the avoider drives in this tick.

        It engages when the strip along the trajectory or the strip along the robot's own way is blocked; the two differ
        when the robot is beside the trajectory. It also engages when echoes, or surfaces of the map that no echo shows,
        lie in what the footprint sweeps in a turn. It releases when both strips and the straight strip to the target
        have been free for `release`.

        Args:
            time: Run time, s.
            scans: Scans of this tick.
            base: Pose of the robot, map frame.
            way: (k, 2) the trajectory from the reference point to the target, m, map frame.
            width: Half width of the strip, m.
            own: (k, 2) the robot's own way (see `own_way`), m, map frame; k = 0 for none.
            turn: (k, 3) the poses of a turn (see `own_turn`); k = 0 for none.
            grid: The map; None for none, and while the localizer does not track.
        """
        for scan in scans:
            self._memory.add(scan, base, time)
        nearest = self._memory.nearest(base, way, width, time)
        # A robot beside its trajectory drives towards obstacles that the strip along the trajectory misses. A planner
        # leaves 5 cm in a doorway, so this strip is no wider than the robot.
        if len(own) > 1:
            nearest = min(nearest, self._memory.nearest(base, own, width - self.margin, time))
        # No strip covers what the corners of a robot sweep that turns on the spot or drives back.
        if len(turn) > 1:
            nearest = min(nearest, self._nearest_in_turn(time, base, turn, grid))
        if self.mode == "when_blocked":
            # To engage, the strip along the trajectory decides: the straight line would cut through walls at each
            # corner. To release, the straight one counts as well, since the robot may have left its trajectory by then.
            straight = np.array([(base.x, base.y), way[-1]]) if self.engaged else way
            if math.isfinite(nearest) or (
                self.engaged and math.isfinite(self._memory.nearest(base, straight, width, time))
            ):
                self.engaged, self._blocked_at = True, time
            # With a delay: echoes come and go at the edge of the strip, and each change of driver costs speed.
            elif self.engaged and time - self._blocked_at >= self.release:
                self.engaged = False
        return HandOver(self.engaged, nearest)

    def _nearest_in_turn(self, time: float, base: Pose2D, turn: Floats, grid: OccupancyGrid | None) -> float:
        """Distance from base, m, of the first thing that the footprint touches in a turn; infinite if it is free."""
        radius = float(np.hypot(self.footprint[:, 0], self.footprint[:, 1]).max())
        reach = radius + float(np.hypot(turn[:, 0], turn[:, 1]).max())
        echoes = self._memory.near(base, reach, time)
        # A robot that drives back has its sensors in front: only the map shows what is behind it.
        mapped = NOWHERE if grid is None else surfaces_without_echo(grid, base, reach, echoes)
        for points in (echoes, mapped):
            hit = first_touch(turn, len(turn), self.footprint, points, np.zeros(len(points)), 0.0)
            if hit >= 0:
                return math.hypot(points[hit, 0], points[hit, 1])
        return math.inf

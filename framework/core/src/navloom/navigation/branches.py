"""Trajectories of paths with headings: branches between cusps, each driven forwards or backwards.

The robot slows down to the end of a branch, where the next one begins. Between two points the way is a cubic curve
along the headings at its ends; that of a holonomic robot is straight.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from navloom.navigation.trajectory import SpeedLimits, speed_profile

__all__ = ["Branch", "branches_of", "joined", "single"]

Floats = NDArray[np.float64]
Slows = Callable[[Floats], Floats]

CORNER = math.radians(30.0)
"""Turn of the way of a holonomic robot, rad, at which it stops: the direction of its velocity changes at once."""
IN_PLACE = math.radians(5.0)
"""Turn at a repeated point of a path, rad, for which a robot stops."""
SWING = 0.1
"""Length over which steered wheels may take the angle of the next part, in turn radii: a path's curvature jumps."""
SWINGING = 0.02
"""Least speed while they do, m/s."""


class Branch(NamedTuple):
    """A part of a trajectory on which the direction of driving does not change.

    Attributes:
        begin: Arc length at which it begins, m.
        samples: (n, 6) as `trajectory.SmoothPath`, along the way: arc length from 0, x, y, direction of the way, its
            curvature, and speed, > 0.
        away: Heading of base less the direction of the way, rad: 0 forwards, π backwards; holonomic: (n,).
        turns: (n,) turn of base per way, 1/m.
        is_sideways: The robot is holonomic: its heading differs from its way by any angle.
    """

    begin: float
    samples: Floats
    away: Floats | float
    turns: Floats
    is_sideways: bool = False

    @property
    def length(self) -> float:
        """Arc length, m."""
        return float(self.samples[-1, 0])

    def at(self, values: Floats | float, progress: float) -> float:
        """`away` or `turns` at an arc length of this branch, m."""
        return values if isinstance(values, float) else float(np.interp(progress, self.samples[:, 0], values))


def single(samples: Floats) -> Branch:
    """The only branch of a trajectory without headings."""
    return Branch(0.0, samples, 0.0, samples[:, 4])


def branches_of(
    points: Floats, headings: Floats, limits: SpeedLimits, slows: Slows, stops: Slows, spacing: float = 0.02
) -> list[Branch]:
    """The branches of a path with headings.

    Args:
        points: (n, 2) m. headings: (n,) of base, rad. Both in one frame.
        limits: Speeds, accelerations, and the robot.
        slows, stops: Make a branch slow enough to stop at its end: the last one, and those that end at a cusp.
        spacing: Largest arc length between samples, m.

    Returns:
        At least one branch; a path without length has one with one sample.
    """
    is_sideways = limits.robot.drive == "holonomic"
    # Repeated points have no direction; the last heading at a place is that of the way from there.
    moves = np.hypot(*np.diff(points, axis=0).T) > 1e-9
    if not moves.any():
        still = np.array([[0.0, *points[-1], float(_wrapped(headings[-1:])[0]), 0.0, limits.slowest]])
        return [single(still)]
    legs = np.flatnonzero(moves)
    ends = np.stack([points[legs], points[legs + 1]], axis=1)
    turned = np.stack([headings[legs], headings[legs] + _wrapped(headings[legs + 1] - headings[legs])], axis=1)
    along = ends[:, 1] - ends[:, 0]
    direction = np.arctan2(along[:, 1], along[:, 0])
    if is_sideways:
        is_cusp = np.abs(_wrapped(np.diff(direction))) > CORNER
        backs = np.zeros(len(legs), np.bool_)
    else:
        backs = np.cos(direction - turned.mean(axis=1)) < 0.0
        # A heading that differs between two legs is a turn in place: the robot stops for it as at a cusp.
        is_cusp = (backs[1:] != backs[:-1]) | (np.abs(_wrapped(turned[1:, 0] - turned[:-1, 1])) > IN_PLACE)
    branches: list[Branch] = []
    begin, steered = 0.0, None
    parts = np.split(np.arange(len(legs)), np.flatnonzero(is_cusp) + 1)
    for part in parts:
        is_back = bool(backs[part[0]])
        way = direction[part] if is_sideways else None
        samples, (heads, turns) = _sampled(ends[part], turned[part], way, is_back, spacing)
        step, steers = float(samples[1, 0]), -turns if is_back else turns
        bend = np.maximum(np.abs(samples[:, 4]), np.abs(turns))
        samples[:, 5] = speed_profile(step, bend, limits, most=_swing(step, steers, limits, steered))
        samples.flags.writeable = False
        away = _continuous(heads - samples[:, 3]) if is_sideways else math.pi * is_back
        slowed = slows(samples) if part is parts[-1] else stops(samples)
        branches.append(Branch(begin, slowed, away, turns, is_sideways))
        begin, steered = begin + branches[-1].length, float(steers[-1])
    return branches


def joined(branches: list[Branch]) -> Floats:
    """(n, 6) samples of a `Trajectory` message of all branches, read-only."""
    if len(branches) == 1 and isinstance(branches[0].away, float) and not branches[0].away:
        return branches[0].samples
    rows = []
    for branch in branches:
        samples, is_back = branch.samples.copy(), not branch.is_sideways and branch.away != 0.0
        samples[:, 0] += branch.begin
        samples[:, 3] = _wrapped(samples[:, 3] + branch.away)
        samples[:, 4] = branch.turns
        if is_back:
            samples[:, 4:] *= -1.0
        rows.append(samples)
    whole = np.concatenate(rows)
    whole.flags.writeable = False
    return whole


def _sampled(
    ends: Floats, turned: Floats, way: Floats | None, backs: bool, spacing: float
) -> tuple[Floats, tuple[Floats, Floats]]:
    """Samples of one branch with speed 0, and heading of base, rad, and its turn per way, 1/m, at each.

    Args:
        ends: (k, 2, 2) both ends of each leg, m. turned: (k, 2) headings of base there, rad, unwrapped.
        way: (k,) direction of straight legs, rad; None for curves along the headings.
        backs: Base drives backwards.
        spacing: Largest step, m.
    """
    chords = np.hypot(*(ends[:, 1] - ends[:, 0]).T)
    bends = turned[:, 1] - turned[:, 0]
    lengths = chords if way is not None else chords / np.sinc(0.5 * bends / math.pi)
    stations = np.append(0.0, np.cumsum(lengths))
    count = max(2, math.ceil(stations[-1] / spacing - 1e-9) + 1)
    along = np.linspace(0.0, stations[-1], count)
    leg = np.clip(np.searchsorted(stations, along, "right") - 1, 0, len(ends) - 1)
    share = ((along - stations[leg]) / lengths[leg])[:, None]
    headings, turns = turned[leg, 0] + share[:, 0] * bends[leg], bends[leg] / lengths[leg]
    if way is not None:
        places, direction = ends[leg, 0] + share * (ends[leg, 1] - ends[leg, 0]), way[leg]
        curvature = np.zeros(count)
    else:
        direction, curvature = headings + math.pi * backs, turns
        tangents = turned + math.pi * backs
        first, second = (
            lengths[leg, None] * np.stack([np.cos(tangents[leg, k]), np.sin(tangents[leg, k])], axis=1) for k in (0, 1)
        )
        u = share
        places = (
            (1.0 + 2.0 * u) * (1.0 - u) ** 2 * ends[leg, 0]
            + u * (1.0 - u) ** 2 * first
            + u * u * (3.0 - 2.0 * u) * ends[leg, 1]
            + u * u * (u - 1.0) * second
        )
    samples = np.column_stack([along, places, _wrapped(direction), curvature, np.zeros(count)])
    return samples, (headings, turns)


def _swing(step: float, steers: Floats, limits: SpeedLimits, before: float | None) -> Floats:
    """Largest speed (n,), m/s, at which steered wheels take the angles of a branch within `SWING`.

    Args:
        step: Arc length between samples, m.
        steers: (n,) curvature of the steered arc, 1/m, positive to the left.
        limits: Those of the robot.
        before: The last one of the branch before, 1/m; None for the first branch.
    """
    robot, count = limits.robot, len(steers)
    if robot.drive != "ackermann":
        return np.full(count, math.inf)
    # The wheels begin late, by the delays of the robot, which matter the more the larger the change is.
    per_angle = 1.0 / robot.max_steering_rate + (robot.dead_time + robot.motor_lag) / robot.max_steering
    angles = np.arctan(robot.wheelbase * np.append(steers[0] if before is None else before, steers))
    swing = SWING * robot.turn_radius
    reach = max(1, math.ceil(0.5 * swing / step))
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(angles, (reach - 1, reach), mode="edge"), 2 * reach)
    change = (windows.max(axis=1) - windows.min(axis=1))[:count]
    fastest: Floats = np.maximum(SWINGING, swing / np.maximum(change * per_angle, 1e-9))
    return fastest


def _continuous(angles: Floats) -> Floats:
    """The same angles, (n,) rad, without jumps, so that they can be interpolated."""
    turned: Floats = np.unwrap(_wrapped(angles))
    return turned


def _wrapped(angles: Floats) -> Floats:
    wrapped: Floats = (angles + math.pi) % math.tau - math.pi
    return wrapped

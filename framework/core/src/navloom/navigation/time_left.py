"""How long a goal will still take: its trajectory at the reference's speeds, corrected by the measured progress."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from navloom.messages import Goal, Point2D, Pose2D, Reference, Trajectory
from navloom.navigation.goal_rules import GoalRules, GoalView

__all__ = ["TimeLeft"]

PRIOR = 30.0
"""Drive at the reference's speeds, s, that the expected speed counts for beside the measured progress: longer than
it takes to pass one obstacle slowly, which says little about the rest of the way."""


class TimeLeft:
    """Estimates the remaining time of one goal.

    At first, the robot is expected to drive at `GoalRules.cruise` where the reference has its largest speed. The ratio
    of real time to reference time is then measured over the whole drive.

    Args:
        rules: Speeds of the reference and of the robot.
    """

    def __init__(self, rules: GoalRules) -> None:
        self._rules = rules
        self._spent = self._driven = 0.0
        self._last: tuple[int, float, float] | None = None
        self._trajectory: Trajectory | None = None
        self._times: NDArray[np.float64] = np.zeros(1)

    def look(self, seen: GoalView, reference: Reference | None) -> None:
        """Measure the progress since the previous tick; `reference` is None for a tick without a drive."""
        last, self._last = self._last, None
        if reference is None:
            return
        left = self._along(reference, seen.trajectory)
        # Another trajectory has another length, which is no progress.
        if last is not None and last[0] == reference.path_id:
            self._spent += max(0.0, seen.time - last[1])
            self._driven += max(0.0, last[2] - left)
        self._last = reference.path_id, seen.time, left

    def estimate(self, goal: Goal, legs: list[Point2D], seen: GoalView, reference: Reference | None) -> float:
        """Remaining time, s, at least 0: along the trajectory, then straight through the other legs.

        Args:
            goal: The goal.
            legs: Points that remain to be reached; the trajectory ends at the first one.
            seen: The tick.
            reference: Reference of the goal's own path; None before there is one: then all legs are straight.
        """
        rules, place = self._rules, None if seen.estimate is None else seen.estimate.pose
        pace = (self._spent + PRIOR * rules.fastest / rules.cruise) / (self._driven + PRIOR)
        points: list[Point2D | Pose2D] = [*legs] if reference is not None or place is None else [place, *legs]
        left = sum(math.hypot(b.x - a.x, b.y - a.y) for a, b in pairwise(points)) / rules.fastest
        turn = 0.0
        if reference is not None and place is not None:
            left += self._along(reference, seen.trajectory)
            turn = _turns(goal, legs, reference, place, seen.trajectory)
        return pace * left + turn / rules.braking.robot.max_angular

    def _along(self, reference: Reference, trajectory: Trajectory | None) -> float:
        """Time from the reference point to the end of its trajectory at the reference's speeds, s."""
        if trajectory is None or trajectory.path_id != reference.path_id:  # lost on the network
            return max(0.0, reference.remaining) / self._rules.fastest
        samples = trajectory.samples
        if trajectory is not self._trajectory:
            speeds = np.abs(samples[:, 5])  # negative backwards
            steps = np.diff(samples[:, 0]) / (0.5 * (speeds[1:] + speeds[:-1]))
            self._trajectory, self._times = trajectory, np.append(0.0, np.cumsum(steps))
        return float(self._times[-1] - np.interp(reference.progress, samples[:, 0], self._times))


def _turns(
    goal: Goal, legs: list[Point2D], reference: Reference, place: Pose2D, trajectory: Trajectory | None
) -> float:
    """Turns in place before and after the drive, rad."""
    if reference.turn_to is not None:
        return abs(math.remainder(reference.turn_to - place.heading, math.tau))
    turn = abs(math.remainder(reference.pose.heading - place.heading, math.tau))
    if goal.heading is not None and len(legs) == 1 and trajectory is not None:
        turn += abs(math.remainder(goal.heading - float(trajectory.samples[-1, 3]), math.tau))
    return turn

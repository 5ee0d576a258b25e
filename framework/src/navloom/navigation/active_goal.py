"""One goal on its way: what was asked for it, and whether its drive goes on as it should."""

from __future__ import annotations

import math
from dataclasses import dataclass

from navloom.messages import AvoiderStatus, Feedback, Goal, Message, Point2D, Pose2D
from navloom.navigation.gate import OBSTACLE
from navloom.navigation.goal_rules import GoalView

__all__ = ["ActiveGoal", "feedback_of"]

BLOCKED = 2.0
"""How long the gate may hold the robot before an obstacle until the goal recovers, s."""
UNFOLLOWED = 2.0
"""How long a new path may not be followed, s; then it was lost on its way."""
MISSED = 1.0
"""Time at the end of a trajectory, but not at the goal, after which another path is asked for, s."""
END = 0.01
"""What is left of a trajectory, m, at whose end the robot is."""
MISSES = 3
"""How often a goal, or a point on the way to it, may be missed like this before it counts as no progress."""
PROGRESS = 0.05
"""Least decrease of the way that is left that is progress, m."""


@dataclass
class ActiveGoal:
    """One goal on its way. The checks of a drive are made once a tick.

    Attributes:
        goal: As it was asked for.
        legs: Points that are left to drive to, the goal's own last.
        since: When the state under way began, or its request was made, s.
        deadline: Run clock at which it ends, s.
        recoveries: So far.
        best: Least way that was left on this path, m.
        moved_at, followed_at, free_at: When the robot last came nearer, when its path was last followed, and when the
            gate last let it drive, s.
        first_path: First path of this drive: what is left of an older one says nothing of it.
        ended_at: When the robot came to the end of its trajectory, s; None before.
        misses: How often it was at the end of a trajectory but not at the point driven to.
        asked_ns: Stamp from which on a map answers the request for it, ns.
        plan_id: Newest request for a path.
        asked: Port and request that has no answer yet.
        asked_at: When it was last published, s.
        heard: When the recovery last said something, s.
        why: Reason of the newest recovery.
        avoider: What the avoider said last before that: it says nothing of the drive after it.
        has_driven: A path of it was driven.
    """

    goal: Goal
    legs: list[Point2D]
    since: float
    deadline: float
    recoveries: int = 0
    best: float = math.inf
    moved_at: float = 0.0
    followed_at: float = 0.0
    free_at: float = 0.0
    first_path: int = 0
    ended_at: float | None = None
    misses: int = 0
    asked_ns: int = 0
    plan_id: int = 0
    asked: tuple[str, Message] | None = None
    asked_at: float = 0.0
    heard: float = -math.inf
    why: str = ""
    avoider: AvoiderStatus | None = None
    has_driven: bool = False

    def start_drive(self, path_id: int, time: float) -> None:
        """A path is driven from standstill."""
        self.best, self.has_driven = math.inf, True
        self.moved_at = self.followed_at = self.free_at = time
        self.first_path, self.ended_at = path_id, None

    def change_path(self, time: float) -> None:
        """Another path is driven without a stop."""
        self.best, self.followed_at = math.inf, time

    def next_place(self) -> Pose2D:
        """Where the next path ends; the heading counts for the last one only."""
        leg, heading = self.legs[0], self.goal.heading
        return Pose2D(leg.x, leg.y, heading if heading is not None and len(self.legs) == 1 else 0.0)

    def is_unfollowed(self, path_id: int, seen: GoalView) -> bool:
        """On a network that was cut a path may not reach who is to follow it."""
        if seen.reference is not None and seen.reference.path_id == path_id:
            self.followed_at = seen.time
        return seen.time - self.followed_at > UNFOLLOWED

    def has_missed(self, path_id: int, seen: GoalView) -> bool:
        """The robot came to the end of its trajectory beside the goal: off it by more than the tolerance.

        An avoider that drove until shortly before leaves it there. Nothing on this trajectory can bring it nearer.
        """
        reference = seen.reference
        if _is_held(seen) or reference is None or reference.path_id != path_id or reference.remaining > END:
            self.ended_at = None
        elif self.ended_at is None:
            self.ended_at = seen.time
        return self.ended_at is not None and seen.time - self.ended_at >= MISSED and self.misses < MISSES

    def is_blocked(self, seen: GoalView) -> bool:
        """The gate has been holding the robot for a while because of what the sensors see ahead."""
        if seen.gate is None or not (seen.gate.stopped and seen.gate.reason == OBSTACLE):
            self.free_at = seen.time
        return seen.time - self.free_at > BLOCKED

    def makes_no_progress(self, path_id: int, seen: GoalView, stuck_after: float) -> bool:
        """The way that is left has not become shorter for s."""
        reference = seen.reference
        if _is_held(seen) or reference is None:
            self.moved_at = seen.time
        elif reference.path_id == path_id and reference.remaining < self.best - PROGRESS:
            if math.isfinite(self.best):  # the first look at a path is no progress on it
                self.moved_at = seen.time
            self.best = reference.remaining
        return seen.time - self.moved_at > stuck_after


def feedback_of(active: ActiveGoal | None, state: str, seen: GoalView) -> Feedback:
    """What is said of a goal in a state; None is no goal."""
    reference, estimate = seen.reference if state == "driving" else None, seen.estimate
    if reference is not None and active is not None and reference.path_id < active.first_path:
        reference = None  # the new path is not followed yet
    left = reference.remaining if reference is not None else 0.0
    return Feedback(
        goal_id=active.goal.goal_id if active else 0,
        state=state,  # type: ignore[arg-type]
        distance=left,
        time_left=left / reference.speed if reference is not None else 0.0,
        cross_track=reference.cross_track if reference is not None else 0.0,
        recoveries=active.recoveries if active else 0,
        localizer="" if estimate is None or estimate.state == "tracking" else f"{estimate.state}: {estimate.reason}",
    )


def _is_held(seen: GoalView) -> bool:
    """An operator's stop holds the robot."""
    return seen.gate is not None and seen.gate.latched

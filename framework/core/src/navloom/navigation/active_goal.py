"""The active goal: its requests, and the checks of its drive."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from navloom.messages import (
    AvoiderStatus,
    Feedback,
    Goal,
    GoalResult,
    GoalState,
    Message,
    Outcome,
    Path,
    PlanFailure,
    Point2D,
    Pose2D,
    ReasonCode,
    Reference,
)
from navloom.navigation.goal_rules import GoalView
from navloom.navigation.time_left import TimeLeft

__all__ = ["ActiveGoal", "GoalEnd", "ending_of_plan", "feedback_of", "overdue", "result_of"]

BLOCKED = 2.0
"""How long the gate may stop the robot for an obstacle before the goal starts a recovery, s."""
UNFOLLOWED = 2.0
"""How long a path may stay without a reference before it counts as lost on the network, s."""
MISSED = 1.0
"""How long the robot may be at the end of a trajectory, but not at the goal, before another path is requested, s."""
END = 0.01
"""Remaining length of a trajectory at which the robot counts as being at its end, m."""
MISSES = 3
"""How often a goal or via point may be missed like this before it counts as no progress; also how often a robot that
stopped at the goal, and is not within its tolerances at rest, drives on."""
TRY_EVERY = 1.0
"""Time between the plans of a goal that waits for a way, s: a map is a scan or two old then."""
STEADY = 10.0
"""Time of tracking after which a search counts as over, s."""
SILENT_RECOVERY = 10.0
"""Longest silence of a recovery, s."""
PROGRESS = 0.05
"""Decrease of the remaining length that counts as progress, m."""
REJECTING = {"start_occupied", "goal_occupied", "outside_map"}


class GoalEnd(NamedTuple):
    """How and why a goal ends."""

    outcome: Outcome
    code: ReasonCode
    reason: str


@dataclass
class ActiveGoal:
    """The active goal. Each check of its drive is made once a tick.

    Attributes:
        goal: As requested.
        legs: Points that remain to be reached, the goal itself last.
        since: When the current state began or its request was made, s.
        deadline: Run clock at which the goal times out, s.
        time_left: Estimates the remaining time.
        recoveries: How many were started.
        best: Least remaining length on the current path, m.
        moved_at: When the remaining length last decreased, s.
        followed_at: When the path last had a reference, s.
        free_at: When the gate last did not stop the robot for an obstacle, s.
        first_path: Number of the first path of this drive; references of older paths are ignored.
        is_headed: The driven path has headings: near the goal, it may still lead away from it and back.
        ended_at: When the robot reached the end of its trajectory, s; None before.
        misses: How often it was at the end of a trajectory, but not at the goal or via point, or stopped at the goal
            outside its tolerances.
        asked_ns: Stamp from which on a map answers the newest request for one, ns.
        plan_id: Number of the newest request for a path.
        asked: Port and message of the newest request.
        asked_at: When that was last published, s.
        heard: When the recovery last published its status, s.
        why: Reason of the newest recovery.
        code: Why it recovers, waits or searches, or last did.
        avoider: Avoider status at the newest recovery: it is outdated for the drive after that.
        has_driven: A path of this goal was driven.
        no_way_since: When it first had no way and no recovery left, s.
        tries_at: When it plans again after that, s; None while it is not to.
        searched: How long the localizer was not tracking when it last found the robot, s.
        found_at: When that was, s.
        looks: How often the recovery was asked to look around.
        looks_since: When that was last requested, s; None while it is not.
    """

    goal: Goal
    legs: list[Point2D]
    since: float
    deadline: float
    time_left: TimeLeft
    recoveries: int = 0
    best: float = math.inf
    moved_at: float = 0.0
    followed_at: float = 0.0
    free_at: float = 0.0
    first_path: int = 0
    is_headed: bool = False
    ended_at: float | None = None
    misses: int = 0
    asked_ns: int = 0
    plan_id: int = 0
    asked: tuple[str, Message] | None = None
    asked_at: float = 0.0
    heard: float = -math.inf
    why: str = ""
    code: ReasonCode = ""
    avoider: AvoiderStatus | None = None
    has_driven: bool = False
    no_way_since: float | None = None
    tries_at: float | None = None
    searched: float = 0.0
    found_at: float = -math.inf
    looks: int = 0
    looks_since: float | None = None

    def start_drive(self, path: Path, time: float) -> None:
        """A drive along a path starts."""
        self.best, self.has_driven = math.inf, True
        self.moved_at = self.followed_at = self.free_at = time
        self.first_path, self.ended_at, self.is_headed = path.request_id, None, path.headings is not None

    def distance(self, pose: Pose2D) -> float:
        """Distance from the next point to be reached, m."""
        return math.hypot(self.legs[0].x - pose.x, self.legs[0].y - pose.y)

    def seen_from(self, pose: Pose2D) -> tuple[float, float]:
        """How far the next point to be reached is ahead and to the left of the robot, m."""
        dx, dy = self.legs[0].x - pose.x, self.legs[0].y - pose.y
        cos, sin = math.cos(pose.heading), math.sin(pose.heading)
        return cos * dx + sin * dy, cos * dy - sin * dx

    def heading_error(self, pose: Pose2D) -> float:
        """Difference from the heading asked for at the goal, rad; 0 for none."""
        wanted = self.goal.heading
        return 0.0 if wanted is None else abs(math.remainder(wanted - pose.heading, math.tau))

    def is_ending(self, pose: Pose2D, tolerance: float, heading_tolerance: float, reference: Reference | None) -> bool:
        """Whether a path with headings is driven to its end, within the tolerances, m and rad; other paths: always."""
        if not self.is_headed or reference is None:
            return True
        off = self.heading_error(pose) if len(self.legs) == 1 else 0.0
        return reference.remaining <= END or (reference.remaining <= tolerance and off <= 0.5 * heading_tolerance)

    # In words, because it ends up in the reason of a result, which an operator reads.
    def off_by(self, pose: Pose2D) -> str:
        """How far the robot is from the goal, in words."""
        turned = f" and {math.degrees(self.heading_error(pose)):.1f}°" if self.goal.heading is not None else ""
        return f"{self.distance(pose):.3f} m{turned}"

    def search_since(self, seen: GoalView) -> float:
        """Since when the localizer has not been tracking, s, as it is not now.

        While the robot looks around, a moment of tracking counts as none: it might be lost and found for ever.
        """
        is_again = seen.looks_around and seen.time - self.found_at < STEADY
        return seen.time - self.searched if is_again else seen.time

    def waits_for_way(self, patience: float, time: float) -> bool:
        """Whether it plans again at `tries_at`, as it has waited for a way for less than `patience`, s."""
        if self.no_way_since is None:
            self.no_way_since = time
        if time + TRY_EVERY > self.no_way_since + patience:
            return False
        self.tries_at = time + TRY_EVERY
        return True

    def end_search(self, seen: GoalView) -> None:
        """The localizer tracks again."""
        self.searched, self.found_at = seen.time - self.since, seen.time

    def hears_no_recovery(self, since: float, seen: GoalView) -> bool:
        """Whether the recovery that was requested at a time, s, has been silent for too long."""
        return seen.time - max(self.heard, since) > SILENT_RECOVERY

    def looks_again(self, seen: GoalView) -> bool:
        """Whether the recovery is to be asked to look around: for the first time, or since its last attempt ended."""
        since, step = self.looks_since, seen.recovery
        if since is not None and seen.time != since and step is not None:
            self.heard = seen.time
            is_over = step.state != "running"
        else:  # in the tick of a request, its status is of the attempt before
            is_over = since is None or self.hears_no_recovery(since, seen)
        if is_over:
            self.looks, self.looks_since = self.looks + 1, seen.time
        return is_over

    def change_path(self, path: Path, time: float) -> None:
        """Another path is taken without a stop."""
        self.is_headed = path.headings is not None
        # `moved_at` stays: a path that changes each second must not hide a robot that makes no progress.
        self.best, self.followed_at = math.inf, time

    def own_reference(self, seen: GoalView) -> Reference | None:
        """The reference on the path of this drive; None before the first."""
        reference = seen.reference
        return None if reference is None or reference.path_id < self.first_path else reference

    def look(self, seen: GoalView) -> None:
        """Measure the progress of a tick of its drive."""
        self.time_left.look(seen, None if _is_held(seen) else self.own_reference(seen))

    def next_place(self) -> tuple[Pose2D, bool]:
        """Where the next path ends, and whether with any heading. Only the last path has a heading."""
        leg, heading = self.legs[0], self.goal.heading if len(self.legs) == 1 else None
        return Pose2D(leg.x, leg.y, heading or 0.0), heading is None

    def is_unfollowed(self, path_id: int, seen: GoalView) -> bool:
        """Whether the reference node has not followed the path for too long: the network may have lost the path."""
        if seen.reference is not None and seen.reference.path_id == path_id:
            self.followed_at = seen.time
        return seen.time - self.followed_at > UNFOLLOWED

    def has_missed(self, path_id: int, seen: GoalView) -> bool:
        """Whether the robot stays at the end of its trajectory without being within the tolerance of the goal.

        This happens if an avoider drove until shortly before the end. This trajectory cannot bring the robot nearer.
        """
        reference = seen.reference
        # A latched stop holds the robot wherever it is, so it misses nothing while one lasts.
        if _is_held(seen) or reference is None or reference.path_id != path_id or reference.remaining > END:
            self.ended_at = None
        elif self.ended_at is None:
            self.ended_at = seen.time
        return self.ended_at is not None and seen.time - self.ended_at >= MISSED and self.misses < MISSES

    def is_trapped(self, seen: GoalView) -> bool:
        """Whether an avoider that drives is trapped, and has said so since the newest recovery."""
        said, handover = seen.avoider, seen.handover
        if said is None or said is self.avoider or handover is None:
            return False
        return said.status == "trapped" and handover.engaged

    def is_blocked(self, seen: GoalView) -> bool:
        """Whether the gate has stopped the robot for an obstacle for too long."""
        # Only stops for an obstacle count: a recovery cannot end a stop for silence or by an operator.
        if not (seen.gate is not None and seen.gate.stopped and seen.stop_kind in ("obstacle", "no_room")):
            self.free_at = seen.time
        return seen.time - self.free_at > BLOCKED

    def makes_no_progress(self, path_id: int, seen: GoalView, stuck_after: float) -> bool:
        """Whether the remaining length has not decreased for `stuck_after` s."""
        reference = seen.reference
        if _is_held(seen) or reference is None:
            self.moved_at = seen.time
        elif reference.path_id == path_id and reference.remaining < self.best - PROGRESS:
            if math.isfinite(self.best):  # the first reference of a path is no progress
                # Without a reference there is nothing to make progress on; `is_unfollowed` times that instead.
                self.moved_at = seen.time
            # Below the last best only: a robot that swings back and forth makes no progress, however far it drives.
            self.best = reference.remaining
        return seen.time - self.moved_at > stuck_after


def feedback_of(active: ActiveGoal | None, state: GoalState, seen: GoalView) -> Feedback:
    """The feedback on a goal in a state; None for no goal."""
    estimate = seen.estimate
    localizer = "" if estimate is None or estimate.state == "tracking" else f"{estimate.state}: {estimate.reason}"
    if active is None:
        return Feedback(0, state, 0.0, 0.0, 0.0, 0, localizer)
    reference = active.own_reference(seen) if state == "driving" else None
    return Feedback(
        goal_id=active.goal.goal_id,
        state=state,
        # While the robot maps or plans there is no length along a path, and the distance as the crow flies would jump.
        distance=reference.remaining if reference is not None else 0.0,
        time_left=active.time_left.estimate(active.goal, active.legs, seen, reference),
        cross_track=reference.cross_track if reference is not None else 0.0,
        recoveries=active.recoveries,
        localizer=localizer,
        code=active.code if state in ("recovering", "waiting", "searching") else "",
    )


def overdue(seen: GoalView) -> GoalEnd:
    """How a goal ends that is not reached at its deadline."""
    if _is_held(seen):
        # The goal did not fail: an operator held the robot until the time was over.
        return GoalEnd("stopped", "not_resumed", "an operator's stop was not resumed")
    return GoalEnd("timeout", "overdue", f"not there after {seen.time:g} s")


def ending_of_plan(failure: PlanFailure, has_driven: bool) -> GoalEnd:
    """How a goal ends for which there is no path."""
    outcome: Outcome = "rejected" if failure.kind in REJECTING and not has_driven else "no_path"
    reason = failure.detail if failure.kind == outcome else f"{failure.kind}: {failure.detail}"
    return GoalEnd(outcome, failure.kind, reason)


def result_of(active: ActiveGoal, end: GoalEnd, place: Point2D | None, seen: GoalView) -> GoalResult:
    """The result of a goal that ends; without a place, where the robot is."""
    if place is None:
        pose = seen.estimate.pose if seen.estimate is not None else Pose2D(0.0, 0.0, 0.0)
        # A failure that concerns a place (goal in an obstacle) names it; otherwise the reader wants to know where the
        # robot ended.
        place = Point2D(pose.x, pose.y)
    return GoalResult(active.goal.goal_id, end.outcome, end.reason, place, end.code)


def _is_held(seen: GoalView) -> bool:
    """Whether a latched stop holds the robot."""
    return seen.gate is not None and seen.gate.latched

"""The goal's state machine: from a request to a typed result. Pure: each step takes a view and returns messages."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from navloom.messages import (
    AvoiderStatus,
    ClearRequest,
    Drive,
    Feedback,
    Goal,
    GoalResult,
    Message,
    Path,
    PlanFailure,
    PlanRequest,
    Point2D,
    Pose2D,
    RecoveryRequest,
    SweepRequest,
)
from navloom.navigation.gate import OBSTACLE
from navloom.navigation.goal_rules import GoalRules, GoalView
from navloom.navigation.replanning import Replanning

__all__ = ["GoalMachine"]

NO_DRIVE = Drive(0, 0, None, False)
LOST = 30.0
"""How long a goal waits for a silent platform before it ends with an error, s."""
UNSURE = 5.0
"""How long a goal waits for a localizer that is not tracking before it ends lost, s."""
BLOCKED = 2.0
"""How long the gate may stop the robot for an obstacle before the goal starts a recovery, s."""
SILENT_RECOVERY = 10.0
"""Longest silence of a recovery, s."""
UNFOLLOWED = 2.0
"""How long a path may stay without a reference before it counts as lost on the network, s."""
MISSED = 1.0
"""How long the robot may be at the end of a trajectory, but not at the goal, before another path is requested, s."""
END = 0.01
"""Remaining length of a trajectory at which the robot counts as being at its end, m."""
MISSES = 3
"""How often a goal or via point may be missed like this before it counts as no progress."""
ASKS = 3
"""How often a map or a plan is requested within its timeout, live, where request and answer can be lost."""
REJECTING = {"start_occupied", "goal_occupied", "outside_map"}


@dataclass
class _Active:
    """The active goal."""

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
    """Number of the first path of this drive; references of older paths are ignored."""
    ended_at: float | None = None
    """When the robot reached the end of its trajectory, s; None before."""
    misses: int = 0
    asked_ns: int = 0
    plan_id: int = 0
    asked: tuple[str, Message] | None = None
    """Port and message of the newest request."""
    asked_at: float = 0.0
    heard: float = -math.inf
    why: str = ""
    avoider: AvoiderStatus | None = None
    """Avoider status at the newest recovery: it is outdated for the drive after that."""
    has_driven: bool = False


class GoalMachine:
    """Runs one goal at a time; a new goal pre-empts the old one.

    `step` returns the messages to publish as pairs of port and message. The ports are `sweep`, `clear`, `plan`,
    `recovery`, `drive`, `feedback` and `result`.
    """

    def __init__(self, rules: GoalRules) -> None:
        self.rules = rules
        self.state = "idle"
        self._active: _Active | None = None
        self._drive = NO_DRIVE
        self._requests = 0
        self._has_scanned = False
        self._scan: tuple[SweepRequest, int] | None = None
        self._selected = ("", "")
        self._pending: tuple[str, ...] = ()
        self._said: tuple[int, str, str] = (0, "idle", "tracking")
        self._out: list[tuple[str, Message]] = []
        self._replanning = Replanning(rules.replan)

    @property
    def is_idle(self) -> bool:
        """Whether no goal is active."""
        return self._active is None

    @property
    def goal_id(self) -> int:
        """Number of the active goal; 0 for none."""
        return 0 if self._active is None else self._active.goal.goal_id

    def submit(self, goal: Goal, seen: GoalView) -> None:
        """Accept a goal. An active goal is cancelled, but its trajectory is driven until the new plan arrives."""
        keeps = self._drive if self._active is not None and self.state in ("driving", "planning") else NO_DRIVE
        if self._active is not None:
            self._finish("cancelled", f"pre-empted by goal {goal.goal_id}", seen)
        legs = [*goal.via, Point2D(goal.x, goal.y)]
        deadline = self.rules.deadline + (seen.time if self.rules.is_live else 0.0)
        self._active = _Active(goal, legs, seen.time, deadline)
        if keeps.path_id:
            self._set_drive(replace(keeps, goal_id=goal.goal_id, turn_to=None, stop_here=False))
        self._need_map(seen)

    def cancel(self, seen: GoalView) -> None:
        """Cancel the active goal."""
        if self._active is not None:
            self._finish("cancelled", "by the operator", seen)

    def fail(self, reason: str, seen: GoalView) -> None:
        """End the active goal because a node failed."""
        if self._active is not None:
            self._finish("error", reason, seen)

    def begin(self, tick: int, unfinished: int) -> None:
        """Continue after an earlier goal node: keep request numbers increasing, and end its unfinished goal.

        Args:
            tick: The current tick, which is larger than all request numbers of the earlier node.
            unfinished: Number of its unfinished goal; 0 for none.
        """
        self._requests = tick
        self._said = (unfinished, "", "")  # so that the next report gives the current state
        self._out.append(("drive", NO_DRIVE))
        self._out.append(("recovery", RecoveryRequest(False, 0, "")))
        if unfinished:
            place = Point2D(0.0, 0.0)
            self._out.append(("result", GoalResult(unfinished, "error", "restarted: the goal node began anew", place)))

    def hold(self, seen: GoalView) -> None:
        """The platform is silent: stop the drive and wait for it."""
        if self._active is not None and self.state != "waiting":
            self._pause(self._active, "waiting", seen)

    def go_on(self, seen: GoalView) -> None:
        """The platform is no longer silent: plan again from the robot's current pose."""
        if self._active is not None and self.state == "waiting":
            self._need_map(seen)

    def restart_of(self, role: str, seen: GoalView) -> None:
        """Repeat the request to a restarted instance: a restarted mapper has no map, a restarted planner no request."""
        active = self._active
        if role == "mapper":
            self._has_scanned = False
        if active is None or self.state not in ("mapping", "planning", "driving"):
            return
        if role == "mapper" and self.rules.scans_on_request:
            self._need_map(seen)
        elif role == "planner" and self.state == "planning":
            self._ask_plan(active, seen)

    def step(self, seen: GoalView) -> list[tuple[str, Message]]:
        """Advance the active goal by one tick, and return the messages to publish."""
        active = self._active
        if active is not None and seen.estimate is not None:
            if seen.gate is not None and seen.gate.reason == "contact":
                self._finish("collision", "the robot touched something", seen)
            elif seen.time >= active.deadline:
                stopped = seen.gate is not None and seen.gate.latched
                self._finish(
                    "stopped" if stopped else "timeout",
                    "an operator's stop was not resumed" if stopped else f"not there after {seen.time:g} s",
                    seen,
                )
            elif seen.estimate.state != "tracking" and self.state not in ("waiting", "searching"):
                self._pause(active, "searching", seen)
            else:
                self._react_to_swaps(active, seen)
                getattr(self, f"_while_{self.state}")(active, seen)
        self._report(seen)
        out, self._out = self._out, []
        return out

    # --- the states -----------------------------------------------------------------------------------------------

    def _while_mapping(self, active: _Active, seen: GoalView) -> None:
        if seen.map is not None and seen.map.stamp_ns >= active.asked_ns:
            self._ask_plan(active, seen)
        elif seen.time - active.since > self.rules.map_timeout and seen.map is not None and active.recoveries:
            self._ask_plan(active, seen)  # the mapper has nothing new after it was cleared
        elif seen.time - active.since > self.rules.map_timeout:
            self._finish("error", f"no map within {self.rules.map_timeout:g} s", seen)
        else:
            self._ask_again(active, self.rules.map_timeout, seen)

    def _while_planning(self, active: _Active, seen: GoalView) -> None:
        answer = seen.answer
        if answer is None or answer.request_id != active.plan_id:
            if seen.time - active.since > self.rules.plan_timeout:
                self._finish("no_path", f"the planner gave no answer within {self.rules.plan_timeout:g} s", seen)
            else:
                self._ask_again(active, self.rules.plan_timeout, seen)
        elif isinstance(answer, PlanFailure):
            self._fail_plan(active, answer, seen)
        else:
            self._set_drive(Drive(active.goal.goal_id, answer.request_id, None, False))
            self.state = "driving"
            active.best, active.has_driven = math.inf, True
            active.moved_at = active.followed_at = active.free_at = seen.time
            active.first_path, active.ended_at = answer.request_id, None

    def _while_driving(self, active: _Active, seen: GoalView) -> None:
        assert seen.estimate is not None
        pose = seen.estimate.pose
        target = active.legs[0]
        if math.hypot(target.x - pose.x, target.y - pose.y) <= self.rules.tolerance or self._drive.stop_here:
            self._arrive(active, pose, seen)
            return
        said = seen.avoider if seen.avoider is not active.avoider else None
        trapped = said is not None and said.status == "trapped"
        if trapped and seen.handover is not None and seen.handover.engaged:
            self._recover(active, "trapped", seen)
        elif self._is_blocked(active, seen):
            self._recover(active, "blocked", seen)
        elif self._makes_no_progress(active, seen):
            self._recover(active, "no_progress", seen)
        elif self._is_unfollowed(active, seen):
            self._ask_plan(active, seen)
        elif self._has_missed(active, seen):
            active.misses += 1
            self._ask_plan(active, seen)
        else:
            self._replan(active, seen)

    def _while_recovering(self, active: _Active, seen: GoalView) -> None:
        step = seen.recovery
        if step is None or seen.time == active.since:
            if seen.time - max(active.heard, active.since) > SILENT_RECOVERY:
                self._recover(active, active.why, seen)  # the recovery died, or its last message was lost
            return
        active.heard = seen.time
        if step.state == "done":
            self._out.append(("recovery", RecoveryRequest(False, active.recoveries, "")))
            if step.clear_map:
                self._requests += 1
                self._out.append(("clear", ClearRequest(self._requests)))
                self._has_scanned = False
            self._need_map(seen, is_cleared=step.clear_map)
        elif step.state == "failed":
            self._recover(active, active.why, seen)

    def _while_waiting(self, active: _Active, seen: GoalView) -> None:
        if seen.time - active.since > LOST:
            self._finish("error", f"the platform has been silent for {LOST:g} s", seen)

    def _while_searching(self, active: _Active, seen: GoalView) -> None:
        """The localizer is not tracking: the robot stays stopped until it is, and then plans from there."""
        estimate = seen.estimate
        assert estimate is not None
        if estimate.state == "tracking":
            self._need_map(seen)
        elif seen.time - active.since > UNSURE:
            why = f"the localizer has not been tracking for {UNSURE:g} s: {estimate.reason}"
            self._finish("lost", why.removesuffix(": "), seen)

    def _replan(self, active: _Active, seen: GoalView) -> None:
        """Request another path without stopping, and take it if it is better."""
        watch = self._replanning
        watch.look(seen.map, seen.trajectory, seen.reference)
        if active.plan_id == self._drive.path_id:
            if watch.asks(seen.time):
                self._request_plan(active, seen)
            return
        answer = seen.answer
        if answer is None or answer.request_id != active.plan_id:
            if watch.is_blocked and seen.time - active.since > self.rules.plan_timeout:
                self._recover(active, "no_path: the planner gave no answer", seen)
            else:
                self._ask_again(active, self.rules.plan_timeout, seen)
        elif isinstance(answer, Path):
            if watch.takes(answer, seen.reference):
                self._set_drive(replace(self._drive, path_id=answer.request_id))
                active.best, active.followed_at = math.inf, seen.time
            active.plan_id = self._drive.path_id
        else:
            active.plan_id = self._drive.path_id
            if watch.is_blocked:
                self._fail_plan(active, answer, seen)

    # --- what they share ------------------------------------------------------------------------------------------

    def _pause(self, active: _Active, state: str, seen: GoalView) -> None:
        """Stop the drive, or the recovery, and wait."""
        if self.state == "recovering":
            self._out.append(("recovery", RecoveryRequest(False, active.recoveries, "")))
        self._set_drive(NO_DRIVE)
        active.since = seen.time
        self.state = state

    def _need_map(self, seen: GoalView, is_cleared: bool = False) -> None:
        """Request a sweep if the mapper depends on requested sweeps and has had none; else plan if there is a map.

        After a request to clear the map, wait for the mapper's next map.
        """
        active = self._active
        assert active is not None
        active.since, active.asked_ns, active.asked = seen.time, 0, None
        if self.rules.scans_on_request and not self._has_scanned:
            self._has_scanned = True
            self._requests += 1
            self._scan = SweepRequest(self._requests), seen.time_ns
        if self._scan is not None:  # of this goal, or of an earlier one that received no map
            self._set_drive(NO_DRIVE)
            request, active.asked_ns = self._scan
            self._ask(active, "sweep", request, seen)
        elif is_cleared:
            self._set_drive(NO_DRIVE)
            active.asked_ns = seen.time_ns
        elif seen.map is not None and seen.estimate is not None:
            self._ask_plan(active, seen)
            return
        self.state = "mapping"

    def _ask_plan(self, active: _Active, seen: GoalView) -> None:
        self._scan = None
        self._request_plan(active, seen)
        self.state = "planning"

    def _fail_plan(self, active: _Active, failure: PlanFailure, seen: GoalView) -> None:
        """End the goal; but recover if the robot has driven, since the obstacle may be gone from a cleared map."""
        if active.has_driven and active.recoveries < self.rules.max_recoveries:
            self._recover(active, f"{failure.kind}: {failure.detail}", seen)
            return
        outcome = "rejected" if failure.kind in REJECTING and not active.has_driven else "no_path"
        reason = failure.detail if failure.kind == outcome else f"{failure.kind}: {failure.detail}"
        self._finish(outcome, reason, seen, failure.place)

    def _request_plan(self, active: _Active, seen: GoalView) -> None:
        assert seen.estimate is not None
        self._requests += 1
        leg = active.legs[0]
        last = len(active.legs) == 1 and active.goal.heading is not None
        heading = active.goal.heading if last and active.goal.heading is not None else 0.0
        goal = Pose2D(leg.x, leg.y, heading)
        active.plan_id, active.since = self._requests, seen.time
        self._ask(active, "plan", PlanRequest(self._requests, seen.estimate.pose, goal), seen)

    def _ask(self, active: _Active, port: str, request: Message, seen: GoalView) -> None:
        active.asked, active.asked_at = (port, request), seen.time
        self._out.append((port, request))

    def _ask_again(self, active: _Active, patience: float, seen: GoalView) -> None:
        """Repeat a request under the same number: it or its answer may have been lost on the network."""
        if self.rules.is_live and active.asked is not None and seen.time - active.asked_at > patience / ASKS:
            self._ask(active, *active.asked, seen)

    def _arrive(self, active: _Active, pose: Pose2D, seen: GoalView) -> None:
        if len(active.legs) > 1:
            active.legs.pop(0)
            active.misses = 0
            self._ask_plan(active, seen)
            return
        wanted = active.goal.heading
        off = 0.0 if wanted is None else abs(math.remainder(wanted - pose.heading, math.tau))
        if off <= self.rules.heading_tolerance:
            self._finish("succeeded", "the goal was reached", seen)
        elif not self._drive.stop_here:
            self._set_drive(replace(self._drive, turn_to=wanted, stop_here=True))
            active.moved_at = seen.time
        elif seen.time - active.moved_at > self.rules.stuck_after:
            self._finish("stuck", "the heading asked for was not reached", seen)

    def _is_unfollowed(self, active: _Active, seen: GoalView) -> bool:
        """Whether the reference node has not followed the path for too long: the network may have lost the path."""
        if seen.reference is not None and seen.reference.path_id == self._drive.path_id:
            active.followed_at = seen.time
        return seen.time - active.followed_at > UNFOLLOWED

    def _has_missed(self, active: _Active, seen: GoalView) -> bool:
        """Whether the robot stays at the end of its trajectory without being within the tolerance of the goal.

        This happens if an avoider drove until shortly before the end. This trajectory cannot bring the robot nearer.
        """
        reference = seen.reference
        held = seen.gate is not None and seen.gate.latched
        if held or reference is None or reference.path_id != self._drive.path_id or reference.remaining > END:
            active.ended_at = None
        elif active.ended_at is None:
            active.ended_at = seen.time
        return active.ended_at is not None and seen.time - active.ended_at >= MISSED and active.misses < MISSES

    def _is_blocked(self, active: _Active, seen: GoalView) -> bool:
        """Whether the gate has stopped the robot for an obstacle for too long."""
        if seen.gate is None or not (seen.gate.stopped and seen.gate.reason == OBSTACLE):
            active.free_at = seen.time
        return seen.time - active.free_at > BLOCKED

    def _makes_no_progress(self, active: _Active, seen: GoalView) -> bool:
        held = seen.gate is not None and seen.gate.latched
        reference = seen.reference
        if held or reference is None:
            active.moved_at = seen.time
        elif reference.path_id == self._drive.path_id and reference.remaining < active.best - 0.05:
            if math.isfinite(active.best):  # the first reference of a path is no progress
                active.moved_at = seen.time
            active.best = reference.remaining
        return seen.time - active.moved_at > self.rules.stuck_after

    def _recover(self, active: _Active, why: str, seen: GoalView) -> None:
        if active.recoveries >= self.rules.max_recoveries:
            self._out.append(("recovery", RecoveryRequest(False, active.recoveries, "")))
            self._finish("stuck", why, seen)
            return
        active.recoveries += 1
        active.why, active.since, active.avoider = why, seen.time, seen.avoider
        self._set_drive(NO_DRIVE)
        self._out.append(("recovery", RecoveryRequest(True, active.recoveries, why)))
        self.state = "recovering"

    def _react_to_swaps(self, active: _Active, seen: GoalView) -> None:
        """Plan again after a swap of mapper or planner, and give a pending instance the input that warms it up."""
        pending = seen.gate.pending if seen.gate is not None else ()
        selected = self._selected
        self._selected = seen.selected
        if pending == self._pending and seen.selected == selected:
            return
        fresh = [entry for entry in pending if entry not in self._pending]
        self._pending = pending
        if (selected != ("", "") and seen.selected != selected and self.state in ("driving", "planning")) or (
            any(entry.startswith("planner ") for entry in fresh) and self.state == "driving"
        ):
            self._ask_plan(active, seen)
        elif (
            any(entry.startswith("mapper ") for entry in fresh)
            and self.rules.scans_on_request
            and self.state in ("driving", "planning")
        ):
            self._has_scanned = False
            self._need_map(seen)

    def _finish(self, outcome: str, reason: str, seen: GoalView, place: Point2D | None = None) -> None:
        active = self._active
        assert active is not None
        if place is None:
            pose = seen.estimate.pose if seen.estimate is not None else Pose2D(0.0, 0.0, 0.0)
            place = Point2D(pose.x, pose.y)
        self._out.append(("result", GoalResult(active.goal.goal_id, outcome, reason, place)))  # type: ignore[arg-type]
        if self.state == "recovering":
            self._out.append(("recovery", RecoveryRequest(False, active.recoveries, "")))
        self._active = None
        self.state = "idle"
        self._set_drive(NO_DRIVE)

    def _set_drive(self, drive: Drive) -> None:
        if drive != self._drive:
            self._drive = drive
            self._out.append(("drive", drive))

    def _report(self, seen: GoalView) -> None:
        active = self._active
        estimate = seen.estimate
        certainty = "tracking" if estimate is None else estimate.state
        now = (self.goal_id, self.state, certainty)
        if now == self._said and (active is None or seen.tick % self.rules.feedback_ticks):
            return
        self._said = now
        reference = seen.reference if self.state == "driving" else None
        if reference is not None and active is not None and reference.path_id < active.first_path:
            reference = None  # the new path has no reference yet
        left = reference.remaining if reference is not None else 0.0
        feedback = Feedback(
            goal_id=now[0],
            state=self.state,  # type: ignore[arg-type]
            distance=left,
            time_left=left / reference.speed if reference is not None else 0.0,
            cross_track=reference.cross_track if reference is not None else 0.0,
            recoveries=active.recoveries if active else 0,
            localizer="" if estimate is None or certainty == "tracking" else f"{certainty}: {estimate.reason}",
        )
        self._out.append(("feedback", feedback))

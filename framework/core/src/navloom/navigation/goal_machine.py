"""The goal's state machine: from a request to a typed result. Pure: each step takes a view and returns messages."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, ClassVar

from navloom.messages import (
    ClearRequest,
    Drive,
    Goal,
    GoalResult,
    GoalState,
    Message,
    Path,
    PlanFailure,
    PlanRequest,
    Point2D,
    Pose2D,
    ReasonCode,
    RecoveryRequest,
    SweepRequest,
)
from navloom.messages.stop_reasons import STOPS
from navloom.navigation.active_goal import ActiveGoal, GoalEnd, ending_of_plan, feedback_of, overdue, result_of
from navloom.navigation.arrival import Arrival
from navloom.navigation.goal_rules import GoalRules, GoalView
from navloom.navigation.replanning import Replanning
from navloom.navigation.time_left import TimeLeft

__all__ = ["GoalMachine"]

NO_DRIVE = Drive(0, 0, None, False)
LOST = 30.0
"""How long a goal waits for a silent platform before it ends with an error, s."""
ASKS = 3
"""How often a map or a plan is requested within its timeout, live, where request and answer can be lost."""


class GoalMachine:
    """Runs one goal at a time; a new goal pre-empts the old one.

    `step` returns the messages to publish as pairs of port and message. The ports are `sweep`, `clear`, `plan`,
    `recovery`, `drive`, `feedback` and `result`.
    """

    def __init__(self, rules: GoalRules) -> None:
        self.rules = rules
        self.state: GoalState = "idle"
        self._active: ActiveGoal | None = None
        self._drive = NO_DRIVE
        self._requests = 0
        self._has_scanned = False
        self._scan: tuple[SweepRequest, int] | None = None
        self._selected = ("", "")
        self._pending: tuple[str, ...] = ()
        self._said: tuple[int, str, str] = (0, "idle", "tracking")
        self._out: list[tuple[str, Message]] = []
        self._replanning = Replanning(rules.replan)
        self._placed_ns = 0
        self._arrival = Arrival(rules)

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
        # The robot does not stop for a new goal: the old trajectory stays authorised until the new plan is there.
        keeps = self._drive if self._active is not None and self.state in ("driving", "planning") else NO_DRIVE
        self._finish(GoalEnd("cancelled", "preempted", f"pre-empted by goal {goal.goal_id}"), seen)
        legs = [*goal.via, Point2D(goal.x, goal.y)]
        deadline = self.rules.deadline + (seen.time if self.rules.is_live else 0.0)
        self._active = ActiveGoal(goal, legs, seen.time, deadline, TimeLeft(self.rules))
        if keeps.path_id:
            self._set_drive(replace(keeps, goal_id=goal.goal_id, turn_to=None, stop_here=False))
        self._need_map(seen)

    def cancel(self, seen: GoalView) -> None:
        """Cancel the active goal."""
        self._finish(GoalEnd("cancelled", "by_operator", "by the operator"), seen)

    def fail(self, reason: str, seen: GoalView) -> None:
        """End the active goal because a node failed."""
        self._finish(GoalEnd("error", "node_failed", reason), seen)

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
            why, place = "restarted: the goal node began anew", Point2D(0.0, 0.0)
            self._out.append(("result", GoalResult(unfinished, "error", why, place, "node_restarted")))

    def hold(self, seen: GoalView) -> None:
        """The platform is silent: stop the drive and wait for it."""
        if self._active is not None and self.state != "waiting":
            self._pause(self._active, "waiting", "platform_silent", seen)

    def go_on(self, seen: GoalView) -> None:
        """The platform is no longer silent: plan again from the robot's current pose."""
        if self._active is not None and self.state == "waiting":
            self._need_map(seen)

    def place(self, seen: GoalView) -> None:
        """An operator has told the localizer where the robot is: stop, and plan from the first pose after that."""
        self._placed_ns = seen.time_ns
        if self._active is not None and self.state not in ("waiting", "searching"):
            self._pause(self._active, "searching", "placed", seen)

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
        self._arrival.look(seen)
        if active is not None and seen.estimate is not None:
            if seen.stop_kind == "contact":
                self._finish(GoalEnd("collision", "contact", "the robot touched something"), seen)
            elif seen.time >= active.deadline and self._arrival.since is None:
                self._finish(overdue(seen), seen)
            elif seen.estimate.state != "tracking" and self.state not in ("waiting", "searching"):
                self._pause(active, "searching", "not_tracking", seen)
            else:
                self._react_to_swaps(active, seen)
                self.steps[self.state](self, active, seen)
        self._report(seen)
        out, self._out = self._out, []
        return out

    def _while_mapping(self, active: ActiveGoal, seen: GoalView) -> None:
        if self._scan is not None and active.asked is None:
            self._ask_scan(active, self._scan[0], seen)
        elif seen.map is not None and seen.map.stamp_ns >= active.asked_ns:
            self._ask_plan(active, seen)
        elif seen.time - active.since <= self.rules.map_timeout:
            self._ask_again(active, self.rules.map_timeout, seen)
        elif seen.map is not None and (active.recoveries or active.no_way_since is not None):
            self._ask_plan(active, seen)  # the mapper has nothing new after it was cleared
        else:
            self._finish(GoalEnd("error", "no_map", f"no map within {self.rules.map_timeout:g} s"), seen)

    def _while_planning(self, active: ActiveGoal, seen: GoalView) -> None:
        answer = seen.answer
        if active.tries_at is not None:
            if seen.time >= active.tries_at:
                active.tries_at = None
                # What opened behind the robot is on the map as it was: a cleared map lets it go there to look.
                self._clear_map()
                self._need_map(seen, is_cleared=True)
        elif answer is None or answer.request_id != active.plan_id:
            if seen.time - active.since > self.rules.plan_timeout:
                why = f"the planner gave no answer within {self.rules.plan_timeout:g} s"
                self._finish(GoalEnd("no_path", "no_answer", why), seen)
            else:
                self._ask_again(active, self.rules.plan_timeout, seen)
        elif isinstance(answer, PlanFailure):
            self._fail_plan(active, answer, seen)
        else:
            self._set_drive(Drive(active.goal.goal_id, answer.request_id, None, False))
            self.state = "driving"
            active.start_drive(answer, seen.time)

    def _while_driving(self, active: ActiveGoal, seen: GoalView) -> None:
        assert seen.estimate is not None
        active.look(seen)
        if self._arrival.is_due(active, self._drive, seen):
            self._arrive(active, seen.estimate.pose, seen)
            return
        path_id = self._drive.path_id
        if active.is_trapped(seen):
            self._recover(active, "trapped", "trapped", seen)
        elif active.is_blocked(seen):
            self._recover(active, "blocked", "blocked", seen)
        elif active.makes_no_progress(path_id, seen, self.rules.stuck_after):
            self._recover(active, "no_progress", "no_progress", seen)
        elif active.is_unfollowed(path_id, seen):
            self._ask_plan(active, seen)
        elif active.has_missed(path_id, seen):
            active.misses += 1
            self._ask_plan(active, seen)
        else:
            self._replan(active, seen)

    def _while_recovering(self, active: ActiveGoal, seen: GoalView) -> None:
        step = seen.recovery
        if step is None or seen.time == active.since:
            if active.hears_no_recovery(active.since, seen):
                self._recover(active, active.why, active.code, seen)  # the recovery died, or its last message was lost
            return
        active.heard = seen.time
        if step.state == "done":
            self._out.append(("recovery", RecoveryRequest(False, active.recoveries, "")))
            if step.clear_map:
                self._clear_map()
            self._need_map(seen, is_cleared=step.clear_map)
        elif step.state == "failed":
            self._recover(active, active.why, active.code, seen)

    def _while_waiting(self, active: ActiveGoal, seen: GoalView) -> None:
        if seen.time - active.since > LOST:
            self._finish(GoalEnd("error", "platform_silent", f"the platform has been silent for {LOST:g} s"), seen)

    def _while_searching(self, active: ActiveGoal, seen: GoalView) -> None:
        """The localizer is not tracking: look around, or stay stopped, until it is, and then plan from there."""
        estimate = seen.estimate
        assert estimate is not None
        if estimate.state == "tracking" and estimate.stamp_ns >= self._placed_ns:
            self._end_recovery(active)
            active.end_search(seen)
            self._need_map(seen)
        elif seen.time - active.since > (longest := self.rules.localizer_timeout):
            why = f"the localizer has not been tracking for {longest:g} s: {estimate.reason}"
            self._finish(GoalEnd("lost", "not_tracking", why.removesuffix(": ")), seen)
        elif seen.looks_around and estimate.state != "tracking" and active.looks_again(seen):
            self._out.append(("recovery", RecoveryRequest(True, active.looks, "searching")))

    def _replan(self, active: ActiveGoal, seen: GoalView) -> None:
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
                self._recover(active, "no_path: the planner gave no answer", "no_answer", seen)
            else:
                self._ask_again(active, self.rules.plan_timeout, seen)
        elif isinstance(answer, Path):
            if not seen.is_through_seen and watch.takes(answer, seen.reference):
                # A path through what is seen must not replace one that is driven, or each map would restart the watch
                # for progress.
                self._set_drive(replace(self._drive, path_id=answer.request_id))
                active.change_path(answer, seen.time)
            active.plan_id = self._drive.path_id
        else:
            active.plan_id = self._drive.path_id
            if watch.is_blocked:
                self._fail_plan(active, answer, seen)

    def _pause(self, active: ActiveGoal, state: GoalState, code: ReasonCode, seen: GoalView) -> None:
        """Stop the drive, or the recovery, and wait."""
        self._end_recovery(active)
        self._set_drive(NO_DRIVE)
        active.since = active.search_since(seen) if code == "not_tracking" else seen.time
        active.code, self._arrival.since, self.state = code, None, state

    def _end_recovery(self, active: ActiveGoal) -> None:
        if self.state == "recovering" or active.looks_since is not None:
            self._out.append(("recovery", RecoveryRequest(False, active.recoveries, "")))
        active.looks_since = None

    def _need_map(self, seen: GoalView, is_cleared: bool = False) -> None:
        """Request a sweep if the mapper depends on requested sweeps and has had none; else plan if there is a map.

        After a request to clear the map, wait for the mapper's next map.
        """
        active = self._active
        assert active is not None
        active.since, active.asked_ns, active.asked, self._arrival.since = seen.time, 0, None, None
        if self.rules.scans_on_request and not self._has_scanned:
            self._has_scanned = True
            self._requests += 1
            self._scan = SweepRequest(self._requests), seen.time_ns
        if self._scan is not None:  # of this goal, or of an earlier one that received no map
            self._set_drive(NO_DRIVE)
            active.asked_ns = self._scan[1]
            self._ask_scan(active, self._scan[0], seen)
        elif is_cleared:
            self._set_drive(NO_DRIVE)
            active.asked_ns = seen.time_ns
        elif seen.map is not None and seen.estimate is not None:
            self._ask_plan(active, seen)
            return
        self.state = "mapping"

    def _clear_map(self) -> None:
        self._requests += 1
        self._out.append(("clear", ClearRequest(self._requests)))
        self._has_scanned = False

    def _ask_scan(self, active: ActiveGoal, request: SweepRequest, seen: GoalView) -> None:
        """Request a sweep once the robot stands."""
        if self._arrival.is_at_rest(active.since, seen):
            self._ask(active, "sweep", request, seen)

    def _ask_plan(self, active: ActiveGoal, seen: GoalView) -> None:
        self._scan, self._arrival.since = None, None
        self._request_plan(active, seen)
        self.state = "planning"

    def _fail_plan(self, active: ActiveGoal, failure: PlanFailure, seen: GoalView) -> None:
        """End the goal; but recover if the robot has driven, since the obstacle may be gone from a cleared map."""
        if active.has_driven and active.recoveries < self.rules.max_recoveries:
            self._recover(active, f"{failure.kind}: {failure.detail}", failure.kind, seen)
            return
        if not self._waits_for_way(active, seen):
            self._finish(ending_of_plan(failure, active.has_driven), seen, failure.place)

    def _waits_for_way(self, active: ActiveGoal, seen: GoalView) -> bool:
        """Whether a goal without a way is to wait, stopped, and to plan again: what blocks it may move."""
        if not active.waits_for_way(self.rules.patience, seen.time):
            return False
        self._set_drive(NO_DRIVE)
        self.state = "planning"
        return True

    def _request_plan(self, active: ActiveGoal, seen: GoalView) -> None:
        assert seen.estimate is not None
        self._requests += 1
        active.plan_id, active.since = self._requests, seen.time
        self._ask(active, "plan", PlanRequest(self._requests, seen.estimate.pose, *active.next_place()), seen)

    def _ask(self, active: ActiveGoal, port: str, request: Message, seen: GoalView) -> None:
        active.asked, active.asked_at = (port, request), seen.time
        self._out.append((port, request))

    def _ask_again(self, active: ActiveGoal, patience: float, seen: GoalView) -> None:
        """Repeat a request under the same number: it or its answer may have been lost on the network."""
        if self.rules.is_live and active.asked is not None and seen.time - active.asked_at > patience / ASKS:
            self._ask(active, *active.asked, seen)

    def _arrive(self, active: ActiveGoal, pose: Pose2D, seen: GoalView) -> None:
        if len(active.legs) > 1:
            active.legs.pop(0)
            active.misses = 0
            self._ask_plan(active, seen)
            return
        move = self._arrival.step(active, pose, self._drive, seen)
        if move.drive is not None:
            self._set_drive(move.drive)
        if move.plans:
            self._ask_plan(active, seen)
        elif move.end is not None:
            self._finish(move.end, seen)

    def _recover(self, active: ActiveGoal, why: str, code: ReasonCode, seen: GoalView) -> None:
        if code == "blocked" and seen.stop_kind == "no_room":
            why, code = f"blocked: {STOPS['no_room'].text}", "no_room"
        if active.recoveries >= self.rules.max_recoveries:
            self._out.append(("recovery", RecoveryRequest(False, active.recoveries, "")))
            if not self._waits_for_way(active, seen):
                self._finish(GoalEnd("stuck", code, why), seen)
            return
        active.recoveries += 1
        active.why, active.code, active.since, active.avoider = why, code, seen.time, seen.avoider
        self._set_drive(NO_DRIVE)
        self._out.append(("recovery", RecoveryRequest(True, active.recoveries, why)))
        self.state = "recovering"

    def _react_to_swaps(self, active: ActiveGoal, seen: GoalView) -> None:
        """Plan again after a swap of mapper or planner, and give a pending instance the input that warms it up."""
        pending = seen.gate.pending if seen.gate is not None else ()
        selected, self._selected = self._selected, seen.selected
        if pending == self._pending and seen.selected == selected:
            return
        fresh, self._pending = [entry for entry in pending if entry not in self._pending], pending
        is_under_way = self.state in ("driving", "planning")
        if (selected != ("", "") and seen.selected != selected and is_under_way) or (
            any(entry.startswith("planner ") for entry in fresh) and self.state == "driving"
        ):
            self._ask_plan(active, seen)
        elif self.rules.scans_on_request and any(entry.startswith("mapper ") for entry in fresh) and is_under_way:
            self._has_scanned = False
            self._need_map(seen)

    def _finish(self, end: GoalEnd, seen: GoalView, place: Point2D | None = None) -> None:
        active = self._active
        if active is None:
            return
        self._out.append(("result", result_of(active, end, place, seen)))
        self._end_recovery(active)
        self._active, self._arrival.since = None, None
        self.state = "idle"
        self._set_drive(NO_DRIVE)

    def _set_drive(self, drive: Drive) -> None:
        if drive != self._drive:
            self._drive = drive
            self._out.append(("drive", drive))

    def _report(self, seen: GoalView) -> None:
        now = (self.goal_id, self.state, "tracking" if seen.estimate is None else seen.estimate.state)
        if now != self._said or (self._active is not None and seen.tick % self.rules.feedback_ticks == 0):
            self._said = now
            self._out.append(("feedback", feedback_of(self._active, self.state, seen)))

    steps: ClassVar[dict[GoalState, Callable[[Any, ActiveGoal, GoalView], None]]] = {
        "mapping": _while_mapping, "planning": _while_planning, "driving": _while_driving,
        "recovering": _while_recovering, "waiting": _while_waiting, "searching": _while_searching,
    }  # fmt: skip
    """What an active goal does in a tick, by its state; without a goal the state is "idle"."""

"""The stop at the goal: whether the goal was reached is decided at rest, after the final turn."""

from __future__ import annotations

from typing import NamedTuple

from navloom.messages import Drive, Pose2D, PoseEstimate
from navloom.navigation.active_goal import MISSES, ActiveGoal, GoalEnd
from navloom.navigation.braking import ACROSS, Standstill
from navloom.navigation.goal_rules import GoalRules, GoalView

__all__ = ["Arrival", "Move"]


class Move(NamedTuple):
    """What the goal does next; the default is to wait.

    Attributes:
        drive: The drive from now on; None for the same as before.
        plans: Drive on: request another path.
        end: The goal ends like this; None if it does not.
    """

    drive: Drive | None = None
    plans: bool = False
    end: GoalEnd | None = None


class Arrival:
    """Stops the robot at the goal, and looks at rest whether it is there.

    Args:
        rules: Tolerances, and how the robot comes to rest.

    Attributes:
        since: When the stop at the goal began, s; None while the robot does not stop there.
    """

    def __init__(self, rules: GoalRules) -> None:
        self.rules = rules
        self.since: float | None = None
        self._path_id = 0
        self._standstill = Standstill(rules.braking)

    def look(self, seen: GoalView) -> None:
        """Take the gate's status, once a tick."""
        self._standstill.note(seen.gate is not None and not seen.gate.stopped, seen.time)

    def is_at_rest(self, since: float, seen: GoalView) -> bool:
        """Whether the robot stands, or has had more than enough time for it since a run time, s."""
        estimate = seen.estimate
        if estimate is not None and self._standstill.stands(estimate.twist, estimate.stamp_ns * 1e-9):
            return True
        # Some odometry never reports rest (noise, a drifting gyro): the goal must end with it, too.
        return seen.time - since > self.rules.braking.patience

    def is_due(self, active: ActiveGoal, drive: Drive, seen: GoalView) -> bool:
        """Whether the robot is within the tolerance of its next point, or turns or stops at the goal.

        An avoider does not follow the reference, and may come too fast to stop within the tolerance of the goal. Then
        the robot begins to brake where it needs to, if it drives straight at the goal.
        """
        assert seen.estimate is not None
        pose, tolerance = seen.estimate.pose, self.rules.tolerance
        if self.since is not None or drive.stop_here:
            return True
        if active.distance(pose) <= tolerance:
            return active.is_ending(pose, tolerance, self.rules.heading_tolerance, seen.reference)
        is_engaged, reference = seen.handover is not None and seen.handover.engaged, seen.reference
        # The controller needs no such check: its reference is already slow enough where the tolerance begins.
        if not is_engaged or reference is None or len(active.legs) > 1 or seen.speed <= 0.0 or self._fits(seen):
            return False
        ahead, left = active.seen_from(pose)
        # Beside the goal, or with a bend before it, braking now would end the drive away from the goal.
        is_straight = abs(left) <= tolerance and reference.remaining <= ahead + tolerance
        return is_straight and ahead <= self.rules.braking.way(seen.speed)

    def _fits(self, seen: GoalView) -> bool:
        """Whether a robot that comes within the tolerance with its present speed stops within it."""
        return self.rules.braking.way(abs(seen.speed)) <= ACROSS * self.rules.tolerance

    def step(self, active: ActiveGoal, pose: Pose2D, drive: Drive, seen: GoalView) -> Move:
        """The next move of a robot that is within the tolerance of the goal, turns there, or stops there."""
        if self.since is None:
            return self._stop_or_turn(active, pose, drive, seen)
        if not self.is_at_rest(self.since, seen):
            return Move()
        self.since = None
        is_near = active.distance(pose) <= self.rules.tolerance
        if is_near and active.heading_error(pose) <= self.rules.heading_tolerance:
            return Move(end=GoalEnd("succeeded", "reached", "the goal was reached"))
        # A robot that cannot stop where it aims would otherwise turn and drive at its goal for ever.
        cannot_turn = is_near and self.rules.braking.robot.turn_radius > 0.0
        if cannot_turn and not active.is_headed:
            why = f"{active.off_by(pose)} off, but this robot cannot turn in place: take a planner that plans headings"
            return Move(end=GoalEnd("stuck", "heading_missed", why))
        if active.misses >= MISSES:
            why = f"missed the goal {MISSES + 1} times, the last time by {active.off_by(pose)}"
            return Move(end=GoalEnd("stuck", "missed", why))
        active.misses += 1
        # Within the tolerance only the heading is missing, and a new path of some millimetres would turn the robot away
        # first.
        return self._turn(active, self._path_id, seen) if is_near and not cannot_turn else Move(plans=True)

    def _stop_or_turn(self, active: ActiveGoal, pose: Pose2D, drive: Drive, seen: GoalView) -> Move:
        assert seen.estimate is not None
        if self._is_turned(active, seen.estimate) or not (drive.stop_here or self._fits(seen)):
            self.since, self._path_id = seen.time, drive.path_id
            self._standstill.note(True, seen.time)  # the status of the drive that ends here may still be on its way
            # The decision waits for rest: a robot that is within the tolerance at speed may stop outside it.
            return Move(Drive(0, 0, None, False))
        if not drive.stop_here:
            return self._turn(active, drive.path_id, seen)
        if seen.time - active.moved_at > self.rules.stuck_after:
            why = f"the heading asked for was not reached: {active.off_by(pose)} off"
            return Move(end=GoalEnd("stuck", "heading_missed", why))
        return Move()

    def _is_turned(self, active: ActiveGoal, estimate: PoseEstimate) -> bool:
        """Whether no turn is left to make: the heading is right, or the robot must slow down now to stop there."""
        off, way = active.heading_error(estimate.pose), self.rules.braking.turn(estimate.twist.wz)
        if self.rules.braking.robot.turn_radius > 0.0:  # what is missing cannot be turned here
            return True
        return off <= self.rules.heading_tolerance or (way > ACROSS * self.rules.heading_tolerance and off <= way)

    def _turn(self, active: ActiveGoal, path_id: int, seen: GoalView) -> Move:
        """Turn in place, at the end of a path."""
        # A turn has no remaining length to decrease; it gets the whole `stuck_after` for itself.
        active.moved_at = seen.time
        return Move(Drive(active.goal.goal_id, path_id, active.goal.heading, True))

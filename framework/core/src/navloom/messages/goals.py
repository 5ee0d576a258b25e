"""Goals, operators' requests and their results."""

from __future__ import annotations

from typing import Annotated, Literal, get_args

from navloom.messages.motion import Point2D
from navloom.messages.schema import Message, Most, Name, Words, message

__all__ = ["OUTCOMES", "Drive", "Feedback", "Goal", "GoalResult", "GoalState", "OperatorRequest", "Outcome",
           "ReasonCode"]  # fmt: skip

Outcome = Literal[
    "succeeded", "cancelled", "rejected", "no_path", "stuck", "lost", "collision", "timeout", "stopped", "error"
]
OUTCOMES: tuple[str, ...] = get_args(Outcome)
GoalState = Literal["idle", "mapping", "planning", "driving", "recovering", "waiting", "searching"]
"""State of a goal; "waiting" for a silent platform, "searching" while the localizer is not tracking."""
ReasonCode = Literal[
    "", "reached", "preempted", "by_operator", "contact", "overdue", "not_resumed",  # how a goal ends
    "start_occupied", "goal_occupied", "outside_map", "no_path", "no_answer", "no_map",  # there is no path
    "trapped", "blocked", "no_room", "no_progress", "missed", "heading_missed",  # the robot does not get on
    "placed", "not_tracking", "platform_silent", "node_failed", "node_restarted", "robot_down", "refused",  # the robot
]  # fmt: skip
"""Why a goal ended, recovers, waits or searches; empty if it is not known, as in messages of version 1."""


@message()
class Goal(Message):
    """Where to go.

    Attributes:
        goal_id: Increases with each goal.
        x, y: Position, m, map frame.
        heading: Heading at the goal, rad, map frame, or None for any.
        via: Points to pass on the way, in order, map frame.
    """

    goal_id: int
    x: float
    y: float
    heading: float | None
    via: Annotated[tuple[Point2D, ...], Most(512)]


@message(2)
class OperatorRequest(Message):
    """A request of an operator, in either executor.

    Attributes:
        do: What to do; "release" ends teleoperation, "enter_unseen" lets the operator drive into space
            that no sensor has seen, and "relocalise" has the localizer search for the robot anywhere.
        goal: For "goal"; for "place", the pose where the robot is, with its heading.
        role, instance: For "swap", the role and its new active instance; for "set", whose parameters change.
        values: For "set", TOML assignments `name = value`, one per string.
        spread, heading_spread: For "place", standard deviations of the pose, of x and of y, m, and of the heading,
            rad, if it is a guess; both None for an exact one, as in version 1.
    """

    do: Literal["goal", "cancel", "swap", "set", "stop", "resume", "release", "enter_unseen", "place", "relocalise"]
    goal: Goal | None = None
    role: Name = ""
    instance: Name = ""
    values: Annotated[tuple[str, ...], Most(256)] = ()
    spread: float | None = None
    heading_spread: float | None = None


@message(1, now=OperatorRequest)
class OperatorRequest1(Message):
    """`OperatorRequest` until a place could be a guess; for its fields see there."""

    do: Literal["goal", "cancel", "swap", "set", "stop", "resume", "release", "enter_unseen", "place"]
    goal: Goal | None = None
    role: Name = ""
    instance: Name = ""
    values: Annotated[tuple[str, ...], Most(256)] = ()

    def upgraded(self) -> OperatorRequest:
        """The present version."""
        return OperatorRequest(*self.read_fields())


@message()
class Drive(Message):
    """The goal's authorisation to follow a trajectory, without which the reference publishes nothing.

    Attributes:
        goal_id: Number of the goal.
        path_id: Number of the plan to follow; 0 for none.
        turn_to: Heading to turn to in place at the end of the plan, rad, map frame, or None.
        stop_here: The end position has been reached: only turn.
    """

    goal_id: int
    path_id: int
    turn_to: float | None
    stop_here: bool


@message(2)
class Feedback(Message):
    """Progress of a goal.

    Attributes:
        goal_id: Number of the goal; 0 for none.
        state: State of its state machine; `waiting`: the platform is silent; `searching`: the localizer is not
            tracking.
        distance: Remaining distance along the trajectory, m.
        time_left: Estimated remaining time, s: along the trajectory and the straight way through the points behind it,
            at the speeds of the reference, corrected by the measured progress.
        cross_track: Distance from the trajectory, m, positive to the left.
        recoveries: Number of recoveries so far.
        localizer: State and reason of a localizer that is not tracking; otherwise empty.
        code: Why it recovers, waits or searches; otherwise empty.
    """

    goal_id: int
    state: GoalState
    distance: float
    time_left: float
    cross_track: float
    recoveries: int
    localizer: Words = ""
    code: Annotated[ReasonCode, Most(32)] = ""


@message(1, now=Feedback)
class Feedback1(Message):
    """`Feedback` until it had a code; for its fields see there."""

    goal_id: int
    state: GoalState
    distance: float
    time_left: float
    cross_track: float
    recoveries: int
    localizer: Words = ""

    def upgraded(self) -> Feedback:
        """The present version."""
        return Feedback(*self.read_fields())


@message(2)
class GoalResult(Message):
    """How a goal ended.

    Attributes:
        goal_id: Number of the goal.
        outcome: How it ended.
        reason: Why, in one phrase.
        place: Where the robot was, or where the planner failed, map frame.
        code: Why, for programs, as `blocked` or `goal_occupied`; `navloom messages GoalResult` lists them. Empty if it
            is not known, as in version 1.
    """

    goal_id: int
    outcome: Outcome
    reason: Words
    place: Point2D
    code: Annotated[ReasonCode, Most(32)] = ""


@message(1, now=GoalResult)
class GoalResult1(Message):
    """`GoalResult` until it had a code; for its fields see there."""

    goal_id: int
    outcome: Outcome
    reason: Words
    place: Point2D

    def upgraded(self) -> GoalResult:
        """The present version."""
        return GoalResult(*self.read_fields())

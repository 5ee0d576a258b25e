"""Goals, operators' requests and their results."""

from __future__ import annotations

from typing import Annotated, Literal

from navloom.messages.motion import Point2D
from navloom.messages.schema import Message, Most, Name, Words, message

__all__ = ["OUTCOMES", "Drive", "Feedback", "Goal", "GoalResult", "OperatorRequest", "Outcome"]

Outcome = Literal[
    "succeeded", "cancelled", "rejected", "no_path", "stuck", "lost", "collision", "timeout", "stopped", "error"
]
OUTCOMES: tuple[str, ...] = (
    "succeeded", "cancelled", "rejected", "no_path", "stuck", "lost", "collision", "timeout", "stopped", "error"
)  # fmt: skip


@message()
class Goal(Message):
    """Where to go.

    Attributes:
        goal_id: Increases with each goal.
        x, y: Position, m, map frame.
        heading: Heading at the goal, rad, or None for any.
        via: Points to pass on the way, in order.
    """

    goal_id: int
    x: float
    y: float
    heading: float | None
    via: Annotated[tuple[Point2D, ...], Most(512)]


@message()
class OperatorRequest(Message):
    """A request of an operator, in either executor.

    Attributes:
        do: The action; "release" ends the operator's driving, and "enter_unseen" lets the operator drive into space
            that no sensor has seen.
        goal: For "goal"; for "place", the pose where the robot is, with its heading.
        role, instance: For "swap", the role and its new active instance; for "set", whose parameters change.
        values: For "set", TOML assignments `name = value`, one per string.
    """

    do: Literal["goal", "cancel", "swap", "set", "stop", "resume", "release", "enter_unseen", "place"]
    goal: Goal | None = None
    role: Name = ""
    instance: Name = ""
    values: Annotated[tuple[str, ...], Most(256)] = ()


@message()
class Drive(Message):
    """The goal's authorisation to follow a trajectory, without which the reference publishes nothing.

    Attributes:
        goal_id: Number of the goal.
        path_id: Number of the plan to follow; 0 for none.
        turn_to: Heading to turn to in place at the end of the plan, rad, or None.
        stop_here: The end position has been reached: only turn.
    """

    goal_id: int
    path_id: int
    turn_to: float | None
    stop_here: bool


@message()
class Feedback(Message):
    """Progress of a goal.

    Attributes:
        goal_id: Number of the goal; 0 for none.
        state: State of its state machine; "waiting" for a silent platform, "searching" while the localizer is not
            tracking.
        distance: Remaining distance along the trajectory, m.
        time_left: Estimated remaining time, s.
        cross_track: Distance from the trajectory, m, positive to the left.
        recoveries: Number of recoveries so far.
        localizer: State and reason of a localizer that is not tracking; otherwise empty.
    """

    goal_id: int
    state: Literal["idle", "mapping", "planning", "driving", "recovering", "waiting", "searching"]
    distance: float
    time_left: float
    cross_track: float
    recoveries: int
    localizer: Words = ""


@message()
class GoalResult(Message):
    """How a goal ended.

    Attributes:
        goal_id: Number of the goal.
        outcome: One of `OUTCOMES`.
        reason: The reason in one phrase.
        place: Where the robot was, or where the planner failed, map frame.
    """

    goal_id: int
    outcome: Outcome
    reason: Words
    place: Point2D

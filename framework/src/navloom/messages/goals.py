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
        goal_id: Rises with each goal.
        x, y: Position, m, map frame.
        heading: Heading to end with, rad, or None for any.
        via: Points to pass on the way, in order.
    """

    goal_id: int
    x: float
    y: float
    heading: float | None
    via: Annotated[tuple[Point2D, ...], Most(512)]


@message()
class OperatorRequest(Message):
    """One request of an operator, in lockstep or live.

    Attributes:
        do: What to do; "release" ends teleoperation, and "enter_unseen" lets it enter space that no sensor has seen.
        goal: For "goal".
        role, instance: For "swap", the role and the instance to select; for "set", those whose parameters change.
        values: For "set", TOML assignments `name = value`, one a string.
    """

    do: Literal["goal", "cancel", "swap", "set", "stop", "resume", "release", "enter_unseen"]
    goal: Goal | None = None
    role: Name = ""
    instance: Name = ""
    values: Annotated[tuple[str, ...], Most(256)] = ()


@message()
class Drive(Message):
    """Authorises one trajectory; without it, the reference node publishes nothing.

    Attributes:
        goal_id: The goal it serves.
        path_id: The plan to follow; 0 for none.
        turn_to: Heading, rad, to turn to in place at the end of the plan, or None.
        stop_here: The position at the end has been reached: turn only.
    """

    goal_id: int
    path_id: int
    turn_to: float | None
    stop_here: bool


@message()
class Feedback(Message):
    """Progress of a goal.

    Attributes:
        goal_id: Number of the goal; 0 while there is none.
        state: State of its state machine; "waiting": the platform is silent; "searching": the localizer does not track.
        distance: Left along the trajectory, m.
        time_left: Estimate, s.
        cross_track: Distance from the trajectory, m, left positive.
        recoveries: Attempts so far.
        localizer: State and reason of a localizer that is not tracking; else empty.
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
        reason: One phrase.
        place: Where the robot was, map frame.
    """

    goal_id: int
    outcome: Outcome
    reason: Words
    place: Point2D

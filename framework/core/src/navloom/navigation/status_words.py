"""What the gate's status and a goal's feedback say, in words for people."""

from __future__ import annotations

import math
from dataclasses import replace

from navloom.messages import Feedback, GateStatus, GoalResult, GoalState

__all__ = ["NO_GOAL", "WAITS", "WHERE_IT_IS", "has_no_path", "progress", "what_limits", "who_drives", "why_stopped"]

NO_GOAL = Feedback(0, "idle", 0.0, 0.0, 0.0, 0)
"""Feedback that stands for a goal node without any goal so far."""
WHERE_IT_IS = (
    "`navloom place X Y HEADING` tells it where it is; if it sees little of the map, drive it with `navloom teleop` to "
    "where it sees more"
)
"""Remedy for a robot that does not know where it is."""
WAITS: dict[GoalState, str] = {
    "mapping": "it waits for a map",
    "planning": "it waits for a path",
    "driving": "its new path is not followed yet",
    "recovering": "it waits for its recovery",
    "waiting": "it waits for the platform",
    "searching": "it does not know where it is",
}
"""Why the robot is stopped, by the state of the goal."""


def progress(feedback: Feedback, pace: str = "") -> str:
    """State of a goal in words, with the remaining distance and time, localizer, pace, recoveries, cross-track error.

    Until the path is followed there is no remaining distance, so the state is shown as planning.
    """
    has_way = bool(feedback.distance or feedback.cross_track)
    parts: list[str] = ["planning" if feedback.state == "driving" and not has_way else feedback.state]
    if has_way:
        parts.append(f"{feedback.distance:.2f} m and {feedback.time_left:.0f} s left")
    if feedback.localizer:
        parts.append(f"localizer {feedback.localizer}")
    if pace:
        parts.append(pace)
    if feedback.recoveries:
        parts.append(f"recoveries {feedback.recoveries}")
    if has_way:
        parts.append(f"cross-track {feedback.cross_track:+z.2f} m")
    return ", ".join(parts)


def who_drives(status: GateStatus, feedback: Feedback | None = None, result: GoalResult | None = None) -> str:
    """The source that drives the robot, or why it is stopped, in a few words; see `why_stopped`."""
    if status.stopped:
        return f"stopped: {why_stopped(status, feedback, result)[0]}"
    if status.source == "none":
        return f"brakes: {why_stopped(replace(status, stopped=True), feedback, result)[0]}"
    who = "an operator drives" if status.source == "operator" else f"{status.source} {status.instance} drives"
    if status.limit == "overridden":
        return f"{who}, also into space that no sensor has seen"
    return f"{who}, slowed: {what_limits(status)}" if status.limit else who


def what_limits(status: GateStatus) -> str:
    """Why the gate's monitor slows or stops the robot, and where; empty if it does not."""
    what = {"obstacle": "obstacle", "unseen": "space that no sensor has seen"}.get(status.limit, "")
    if not what or status.place is None:
        return what
    bearing = math.degrees(math.atan2(status.place.y, status.place.x))
    side = f"{'left' if bearing > 0.0 else 'right'} ({abs(bearing):.0f}°)"
    if abs(bearing) < 15.0 or abs(bearing) > 165.0:
        side = "ahead" if abs(bearing) < 90.0 else "behind"
    if status.limit == "unseen" or status.distance is None:
        return f"{what} {side}"
    return f"{what} {status.distance:.2f} m away, {side}"


def why_stopped(
    status: GateStatus, feedback: Feedback | None = None, result: GoalResult | None = None
) -> tuple[str, str]:
    """Why the robot is stopped, in words that follow "stopped:", and what to do; both empty if it is not stopped.

    Args:
        status: Status of the gate.
        feedback: Last feedback of the goal; None if it is not known, `NO_GOAL` if there was none so far.
        result: Result of the last goal, if there was one.
    """
    if not status.stopped or status.why is None:
        return "", ""
    words, remedy = status.why.in_words(what_limits(status))
    if feedback is None or not has_no_path(status):
        return words, remedy
    if feedback.goal_id:
        return WAITS.get(feedback.state, words), WHERE_IT_IS if feedback.state == "searching" else ""
    is_reached = result is not None and result.outcome == "succeeded"
    return ("goal reached" if is_reached else "no goal"), remedy


def has_no_path(status: GateStatus) -> bool:
    """Whether there is nothing to drive; not a fault if the robot has no goal."""
    return status.why is not None and status.why.kind == "no_trajectory"

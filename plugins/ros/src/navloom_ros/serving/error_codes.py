"""Nav2's error codes for the reasons why a goal of navloom ended."""

from __future__ import annotations

__all__ = ["COMPUTE_PATH", "NAVIGATE_THROUGH_POSES", "NAVIGATE_TO_POSE", "error_code"]

NAVIGATE_TO_POSE, NAVIGATE_THROUGH_POSES = 9000, 9100
"""First code of each action: the failure is unknown. 2 more: a transform is missing. 3 more: it took too long."""
COMPUTE_PATH = 200
"""First code of ComputePathToPose."""
_LACKS_TRANSFORM, _OVERDUE = 2, 3
_NONE = 0
_CODES = {
    "reached": _NONE,
    # As Nav2's action servers end a goal for a newer one, and for a cancel.
    "preempted": _NONE,
    "by_operator": _NONE,
    # ComputePathToPose
    "no_map": 200,
    "outside_map": 204,
    "start_occupied": 205,
    "goal_occupied": 206,
    "no_answer": 207,
    "no_path": 208,
    # FollowPath
    "blocked": 105,
    "no_progress": 105,
    "missed": 105,
    "heading_missed": 105,
    "contact": 106,
    "no_room": 106,
    "trapped": 106,
    "platform_silent": 107,
}
"""Codes of the server whose task failed, which Nav2's navigator passes on (nav2_msgs, actions of these names)."""


def error_code(code: str, action: int) -> int:
    """The `error_code` of an action's result.

    Args:
        code: The reason, a `navloom.messages.ReasonCode`.
        action: NAVIGATE_TO_POSE, NAVIGATE_THROUGH_POSES or COMPUTE_PATH.
    """
    own = {"not_tracking": action + _LACKS_TRANSFORM, "overdue": action + _OVERDUE}
    return own[code] if code in own else _CODES.get(code, action)

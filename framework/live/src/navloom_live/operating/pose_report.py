"""Where a live robot is, how fast, and how sure that is."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from navloom.messages import Hypotheses, PoseEstimate

from navloom_live.live.description import Description
from navloom_live.live.mailbox import Mailbox
from navloom_live.operating.client import Client
from navloom_live.operating.introspection import last, tap
from navloom_live.operating.robot_nodes import Node, answering

__all__ = ["hypotheses_now", "place_fields", "pose_fields", "pose_now"]

POSE_WAIT = 1.0
"""Longest wait for a pose, s: longer than a localizer's usual period."""


def pose_now(client: Client, nodes: Sequence[Node], timeout: float = POSE_WAIT) -> PoseEstimate | None:
    """The next pose of the active localizer; None if none comes within `timeout`, s."""
    active = _localizer(nodes)
    if active is None:
        return None
    name = active.instance
    mailbox, limit = Mailbox(), time.monotonic() + timeout
    (inlet,) = tap(client, [f"localizer/{name}/pose"], mailbox).values()
    seen = 0
    while (left := limit - time.monotonic()) > 0.0:
        seen = mailbox.wait(seen, left)
        for message, _ in inlet.take():
            if isinstance(message, PoseEstimate):
                return message
    return None


def hypotheses_now(client: Client, nodes: Sequence[Node]) -> Hypotheses | None:
    """The places where the active localizer says that the robot may be; None if it keeps one only."""
    active = _localizer(nodes)
    if active is None or not active.published.get("hypotheses"):
        return None
    found = last(client, "localizer", active.instance, "hypotheses")
    return found if isinstance(found, Hypotheses) else None


def _localizer(nodes: Sequence[Node]) -> Description | None:
    return next((one for one in answering(nodes) if one.role == "localizer" and one.active), None)


def place_fields(found: Hypotheses) -> list[dict[str, float]]:
    """The places, the likeliest first, as plain values."""
    return [
        {"x": x, "y": y, "heading_deg": math.degrees(heading), "weight": weight}
        for (x, y, heading), weight in zip(found.poses.tolist(), found.weights.tolist(), strict=True)
    ]


def pose_fields(estimate: PoseEstimate) -> dict[str, Any]:
    """Where a robot is, how fast, and how sure that is, as plain values; a standard deviation is None if not known."""
    pose, twist, covariance = estimate.pose, estimate.twist, estimate.covariance
    place, heading = float(np.linalg.eigvalsh(covariance[:2, :2])[-1]), float(covariance[2, 2])
    is_known = bool(covariance.any())  # a localizer that cannot tell leaves it zero
    return {
        "x": pose.x,
        "y": pose.y,
        "heading_deg": math.degrees(pose.heading),
        "speed": math.hypot(twist.vx, twist.vy),
        "turn_rate_deg": math.degrees(twist.wz),
        "position_std": math.sqrt(max(0.0, place)) if is_known else None,
        "heading_std_deg": math.degrees(math.sqrt(max(0.0, heading))) if is_known else None,
        "state": estimate.state,
        "reason": estimate.reason,
    }

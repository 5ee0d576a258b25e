"""Where a live robot is, how fast, and how sure that is."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from navloom.messages import PoseEstimate

from navloom_live.live.mailbox import Mailbox
from navloom_live.operating.client import Client
from navloom_live.operating.introspection import tap
from navloom_live.operating.robot_nodes import Node, answering

__all__ = ["pose_fields", "pose_now"]

POSE_WAIT = 1.0
"""Longest wait for a pose, s: longer than a localizer's usual period."""


def pose_now(client: Client, nodes: Sequence[Node], timeout: float = POSE_WAIT) -> PoseEstimate | None:
    """The next pose of the active localizer; None if none comes within `timeout`, s."""
    name = next((one.instance for one in answering(nodes) if one.role == "localizer" and one.active), None)
    if name is None:
        return None
    mailbox, limit = Mailbox(), time.monotonic() + timeout
    (inlet,) = tap(client, [f"localizer/{name}/pose"], mailbox).values()
    seen = 0
    while (left := limit - time.monotonic()) > 0.0:
        seen = mailbox.wait(seen, left)
        for message, _ in inlet.take():
            if isinstance(message, PoseEstimate):
                return message
    return None


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

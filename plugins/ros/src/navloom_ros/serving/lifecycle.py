"""States of Nav2's nodes, which its scripts and RViz wait for before they send a goal."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from navloom_ros.node import Node
from navloom_ros.services import Call

__all__ = ["LOCALIZATION", "NAVIGATION", "offer_states"]

NAVIGATION = (
    "bt_navigator", "planner_server", "controller_server", "smoother_server", "behavior_server", "waypoint_follower",
    "velocity_smoother", "collision_monitor",
)  # fmt: skip
"""Nodes of Nav2 that are active while the robot can be driven."""
LOCALIZATION = ("map_server", "amcl")
"""Nodes of Nav2 that are active while the robot has a pose."""
_INACTIVE, _ACTIVE = {"id": 2, "label": "inactive"}, {"id": 3, "label": "active"}
"""States of lifecycle_msgs/msg/State."""


def offer_states(node: Node, can_drive: Callable[[], bool], has_pose: Callable[[], bool]) -> None:
    """Offer `NAME/get_state` of each node, and `is_active` of both lifecycle managers."""
    for manager, names, is_active in (
        ("lifecycle_manager_navigation", NAVIGATION, can_drive),
        ("lifecycle_manager_localization", LOCALIZATION, has_pose),
    ):
        for name in names:
            node.service(f"{name}/get_state", "lifecycle_msgs/srv/GetState", partial(_tell_state, is_active))
        node.service(f"{manager}/is_active", "std_srvs/srv/Trigger", partial(_tell, is_active))


def _tell_state(is_active: Callable[[], bool], call: Call) -> None:
    call.answer(current_state=_ACTIVE if is_active() else _INACTIVE)


def _tell(is_active: Callable[[], bool], call: Call) -> None:
    call.answer(success=is_active())

"""ROS 2 over Zenoh without a ROS installation: messages, the wire protocol of rmw_zenoh, services and actions.

Plugins built on it: the command `navloom ros` (`cli`), the platform `ros2_base` (`base`), and the mapper `ros_map` and
the planner `ros_path` (`elsewhere`). The names below are public and usable without a navloom robot.
"""

from navloom import Registry, hookimpl

from navloom_ros.actions import ActionClient, ActionServer, Goal
from navloom_ros.errors import BadDefinition, BadName, MalformedMessage, RosError, UnfitMessage, UnknownType
from navloom_ros.message_types import Types
from navloom_ros.nav2.adapter import Nav2Navigator
from navloom_ros.node import Node
from navloom_ros.qos import DEFAULT, LATCHED, SENSOR, Qos
from navloom_ros.services import NoAnswer
from navloom_ros.topics import Received
from navloom_ros.wire import NoRouter

__all__ = [
    "DEFAULT",
    "LATCHED",
    "SENSOR",
    "ActionClient",
    "ActionServer",
    "BadDefinition",
    "BadName",
    "Goal",
    "MalformedMessage",
    "Nav2Navigator",
    "NoAnswer",
    "NoRouter",
    "Node",
    "Qos",
    "Received",
    "RosError",
    "Types",
    "UnfitMessage",
    "UnknownType",
]


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Register the command `ros`."""
    from navloom_ros.cli import app

    registry.command("ros", app)

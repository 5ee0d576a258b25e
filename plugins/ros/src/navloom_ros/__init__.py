"""ROS 2 over Zenoh without ROS: messages, the wire of rmw_zenoh, services and actions."""

from navloom import Registry, hookimpl

from navloom_ros.actions import ActionClient, ActionServer, Goal
from navloom_ros.errors import BadDefinition, BadName, MalformedMessage, RosError, UnfitMessage, UnknownType
from navloom_ros.message_types import Types
from navloom_ros.nav2.adapter import Nav2Navigator
from navloom_ros.node import NoAnswer, Node, Received
from navloom_ros.qos import DEFAULT, LATCHED, SENSOR, Qos
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
    """Add the command `ros`."""
    from navloom_ros.cli import app

    registry.command("ros", app)

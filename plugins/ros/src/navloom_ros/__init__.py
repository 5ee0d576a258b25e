"""ROS 2 over Zenoh without ROS: messages, the wire of rmw_zenoh, services and actions."""

from navloom_ros.errors import BadDefinition, BadName, MalformedMessage, RosError, UnfitMessage, UnknownType
from navloom_ros.message_types import Types

__all__ = ["BadDefinition", "BadName", "MalformedMessage", "RosError", "Types", "UnfitMessage", "UnknownType"]

"""Errors of this distribution: one base class, so that a caller catches all of them in one line."""

from __future__ import annotations

__all__ = ["BadDefinition", "BadName", "BadToken", "MalformedMessage", "RosError", "UnfitMessage", "UnknownType"]


class RosError(ValueError):
    """Something of ROS that cannot be used; its text is one sentence for the user."""


class UnknownType(RosError):
    """A type that the distribution does not have and that nobody has given."""


class BadDefinition(RosError):
    """A `.msg`, `.srv` or `.action` text that cannot be used."""


class BadName(RosError):
    """A name of a node, topic, service or action that ROS does not allow."""


class BadToken(RosError):
    """A liveliness token, QoS text or attachment that cannot be read."""


class MalformedMessage(RosError):
    """Bytes that are not a message of their type."""


class UnfitMessage(RosError):
    """A message whose values do not fit its type's fields."""

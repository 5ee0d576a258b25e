"""Errors of this distribution. One base class, so that a caller can catch all of them at once."""

from __future__ import annotations

from navloom import NavloomError

__all__ = [
    "BadDefinition",
    "BadName",
    "BadToken",
    "MalformedMessage",
    "RosError",
    "UnfitMessage",
    "UnknownType",
    "Unusable",
]


class RosError(NavloomError, ValueError):
    """Base class: a ROS network, file or message that cannot be used. The text is one sentence for the user."""


class UnknownType(RosError):
    """A type that neither the distribution nor the user's own folders define."""


class BadDefinition(RosError):
    """A `.msg`, `.srv` or `.action` text that is invalid or not supported."""


class BadName(RosError):
    """An invalid name of a node, topic, service or action, or an invalid option."""


class BadToken(RosError):
    """A liveliness token, QoS text or attachment that cannot be read."""


class MalformedMessage(RosError):
    """Bytes that cannot be decoded as a message of the expected type."""


class UnfitMessage(RosError):
    """A message whose values do not match the fields of its type."""


class Unusable(RosError):
    """A message of the right type whose values cannot be used, such as NaN, or no message in time."""

"""Moves inputs to a later time, or by a little: new objects with later stamps and higher request numbers."""

from __future__ import annotations

import math
from dataclasses import fields, is_dataclass, replace
from typing import Any, TypeVar

import numpy as np
from navloom.engine.nodes.node_base import Tick
from navloom.messages import Message, Odometry, PoseEstimate, PoseTrack, RangeScan

from navloom_check.messages import ns
from navloom_check.plugin_player import rebuilt

__all__ = ["nudged", "restamped"]

T = TypeVar("T")
STAMPS = ("stamp_ns", "time_ns")
REQUESTS = ("request_id",)
NUDGE = 1e-8
"""Change of poses and ranges in one step, m and rad: too small for another answer, and enough for another key."""


def restamped(given: T, later: float, higher: int = 0) -> T:
    """A copy of an input with stamps `later` by some time, s, and request numbers `higher`; it shares no array."""
    shift = ns(later)
    moved = rebuilt(given, lambda one: _message(one, shift, higher), np.array)
    if is_dataclass(moved) and not isinstance(moved, type):
        values = {field.name: getattr(moved, field.name) for field in fields(moved)}
        if isinstance(values.get("tick"), Tick):
            tick = values["tick"]
            time_ns = tick.time_ns + shift
            values["tick"] = tick._replace(number=tick.number + 1000 * higher, time=time_ns * 1e-9, time_ns=time_ns)
        moved = type(moved)(**{name: value + shift if name in STAMPS else value for name, value in values.items()})
    result: T = moved
    return result


def nudged(given: T, step: int) -> T:
    """A copy of an input whose measured poses and ranges differ a little from those of other steps."""

    def leaf(message: Message) -> Message:
        if isinstance(message, (PoseEstimate, Odometry)):
            at = message.pose
            heading = at.heading - math.copysign(step * NUDGE, at.heading)
            return replace(message, pose=replace(at, x=at.x + step * NUDGE, y=at.y + step * NUDGE, heading=heading))
        if isinstance(message, RangeScan):
            return replace(message, ranges=message.ranges * (1.0 - step * NUDGE))
        return message

    moved: T = rebuilt(given, leaf, lambda array: array)
    return moved


def _message(message: Message, shift: int, higher: int) -> Message:
    values: list[Any] = []
    for name, kind in message.kinds.items():
        value = getattr(message, name)
        if isinstance(value, Message):
            value = _message(value, shift, higher)
        elif kind.form == "tuple":
            value = tuple(_message(one, shift, higher) if isinstance(one, Message) else one for one in value)
        elif kind.rule == "stamp":
            value += shift
        elif name in REQUESTS and value:
            value += higher
        elif isinstance(message, PoseTrack) and name == "stamps_ns":
            value = value + shift
        elif isinstance(value, np.ndarray):
            value = value.copy()
        values.append(value)
    return type(message)(*values)

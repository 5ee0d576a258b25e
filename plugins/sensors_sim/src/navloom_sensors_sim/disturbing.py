"""Disturbances of the simulated robot at run time: it is moved from outside, or its wheels slip."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

__all__ = ["Disturbances", "Effect", "Pose", "compose"]

Pose = tuple[float, float, float]
"""x, y, m, and heading, rad."""


class Effect(NamedTuple):
    """What disturbances do to one tick.

    Attributes:
        pose: Where the robot is held at the end of the tick, map frame; None if it drives.
        is_in_hand: It is in the hands of someone who moves it, and not yet down again.
        put_down: The displacement that ends in this tick, as text; empty for none.
        slip: Motion that the wheels report beside their own: x, y, m, and turn, rad, in the odometry's base frame.
        takes_time: The slip takes longer than one tick, so that it has a velocity.
    """

    pose: Pose | None = None
    is_in_hand: bool = False
    put_down: str = ""
    slip: Pose = (0.0, 0.0, 0.0)
    takes_time: bool = False


class Disturbances:
    """The disturbances that are not over yet.

    Args:
        events: With the attributes of navloom's Disturbance, by their beginning.
    """

    def __init__(self, events: Sequence[Any]) -> None:
        self._left = list(events)
        self._first_ns = self._since_ns = -1
        self._from: dict[int, Pose] = {}

    def act(self, time_ns: int, pose: Pose) -> Effect:
        """What they do in the tick that ends at run clock `time_ns` and begins with the robot at its true `pose`."""
        if self._first_ns < 0:
            self._first_ns = time_ns
        time_ns -= self._first_ns
        before, self._since_ns = self._since_ns, time_ns
        effect = Effect()
        for event in [event for event in self._left if event.begin_ns <= time_ns]:
            done = _share(event, time_ns)
            if event.do == "displace":
                begin = self._from.setdefault(id(event), pose)
                at = _between(begin, event, done)
                effect = effect._replace(pose=at, is_in_hand=done < 1.0, put_down=_named(event) if done == 1.0 else "")
            elif event.by is None:
                effect = effect._replace(pose=effect.pose or pose)
            else:
                share = done - (_share(event, before) if before >= event.begin_ns else 0.0)
                part = (share * event.by[0], share * event.by[1], share * event.by[2])
                effect = effect._replace(slip=compose(effect.slip, part), takes_time=event.end_ns > event.begin_ns)
            if done == 1.0:
                self._left.remove(event)
        return effect


def _share(event: Any, time_ns: int) -> float:
    """The share of a disturbance that is over at a time."""
    whole = event.end_ns - event.begin_ns
    return 1.0 if time_ns >= event.end_ns else (time_ns - event.begin_ns) / whole


def _between(begin: Pose, event: Any, share: float) -> Pose:
    """Pose after a share of a displacement from `begin`, map frame."""
    if event.to is not None:
        x, y = begin[0] + share * (event.to[0] - begin[0]), begin[1] + share * (event.to[1] - begin[1])
        turn = math.remainder(event.to[2] - begin[2], math.tau)
        # The exact target at the end, without rounding.
        return tuple(event.to) if share == 1.0 else (x, y, _wrapped(begin[2] + share * turn))
    return compose(begin, (share * event.by[0], share * event.by[1], share * event.by[2]))


def compose(pose: Pose, motion: Pose) -> Pose:
    """The pose after a motion in the frame of the pose; heading in [-π, π)."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    x, y = pose[0] + c * motion[0] - s * motion[1], pose[1] + s * motion[0] + c * motion[1]
    return x, y, _wrapped(pose[2] + motion[2])


def _wrapped(heading: float) -> float:
    return heading - math.tau * math.floor((heading + math.pi) / math.tau)


def _named(event: Any) -> str:
    return f"displace at {event.begin_ns * 1e-9:g} s"

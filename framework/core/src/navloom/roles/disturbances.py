"""Disturbances: what happens to a simulated robot from outside, by the events of its config."""

from __future__ import annotations

from typing import Literal

from navloom.roles.struct import struct

__all__ = ["Disturbance"]


@struct
class Disturbance:
    """A displacement of a simulated robot, or a slip of its wheels. It acts from the first tick at or after `begin_ns`.

    Times count from the platform's first tick, which a live robot has some time after run clock 0.

    Attributes:
        do: "displace": the robot is moved, and its wheels turn freely as commanded. "slip": with `by`, the wheels
            report this motion beside the robot's own; otherwise they turn as commanded, and the robot does not move.
        begin_ns, duration_ns: When it begins, and how long it takes, ns; 0 for one tick.
        to: For a displacement to a place: the true x, y, m, and heading, rad, at its end, map frame.
        by: Otherwise the motion: x, y, m, and turn, rad, in the frame of the base at its beginning.
    """

    do: Literal["displace", "slip"]
    begin_ns: int
    duration_ns: int = 0
    to: tuple[float, float, float] | None = None
    by: tuple[float, float, float] | None = None

    @property
    def end_ns(self) -> int:
        """When it is over, ns."""
        return self.begin_ns + self.duration_ns

"""The latest state of a live robot from its topics: motion, contact, clock, frames and range readings.

The platform `ros2_base` polls these objects in each tick; the messages come from `link`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from navloom_ros.base.frames import Frames, heading_of
from navloom_ros.base.readings import (
    Anchor,
    Beams,
    Motion,
    Unusable,
    beams_of_laser,
    beams_of_ranges,
    is_set,
    motion_of,
    stamp_ns_of,
)
from navloom_ros.base.stamps import Delays

__all__ = ["CLOCK", "CONTACT", "ODOMETRY", "STATIC", "TF", "Heard", "Laser", "Ranges", "Robot"]

ODOMETRY, TF, STATIC, CONTACT, CLOCK = "odometry", "tf", "tf static", "contact", "clock"
"""Names in `Link` of the topics that belong to no sensor."""
PAUSED_NS = 500_000_000
"""Time without a change of /clock after which the simulator counts as paused, ns."""

Floats = NDArray[np.float64]


class Heard(Protocol):
    """The fields of `navloom_ros.topics.Received` that are read here."""

    @property
    def message(self) -> Any: ...
    @property
    def source_ns(self) -> int: ...
    @property
    def gid(self) -> bytes: ...
    @property
    def arrived_ns(self) -> int: ...


class Reads(Protocol):
    """Source of messages, as `Link`: `take` yields those of a topic since the last call."""

    def take(self, name: str) -> Iterator[Heard]: ...


@dataclass
class Robot:
    """The robot's state except for its range sensors.

    Args:
        reads: Source of the messages.
        frame, odometry_frame: Base frame, and the odometry frame if odometry comes from /tf.
        anchor: Keeps the odometry frame continuous.
        is_simulated: Stamps are those of /clock.
        contact_field: Field of the contact message that tells of a contact.

    Attributes:
        measured_ns: When the newest motion was measured, on this host's monotonic clock; None before the first.
        pose, twist: Newest pose, m and rad, in the frame of `anchor`, and velocity in the base frame, m/s and rad/s.
        is_touching: The robot is in contact.
        unusable: Why the last invalid odometry was invalid; empty before the first.
    """

    reads: Reads
    frame: str
    odometry_frame: str
    anchor: Anchor
    is_simulated: bool = False
    contact_field: str = "data"
    frames: Frames = field(default_factory=Frames)
    measured_ns: int | None = None
    pose: tuple[float, float, float] = (0.0, 0.0, 0.0)
    twist: tuple[float, float, float] = (0.0, 0.0, 0.0)
    is_touching: bool = False
    unusable: str = ""
    _delays: dict[str, Delays] = field(default_factory=dict)
    _clock: tuple[int, int] | None = None
    _sent: tuple[int, int] | None = None
    _moved: tuple[tuple[float, float, float], int] | None = None

    def listen(self, from_tf: bool) -> None:
        """Read all new messages.

        Args:
            from_tf: Odometry comes from /tf.
        """
        for heard in self.reads.take(CLOCK):
            shown_ns = stamp_ns_of(heard.message.clock)
            if self._clock is None or shown_ns != self._clock[0]:
                self._clock = shown_ns, heard.arrived_ns
        for name in (STATIC, TF):
            for heard in self.reads.take(name):
                self.frames.add(heard.message)
                if from_tf and name == TF:
                    self._move_by_frames(heard)
        for heard in self.reads.take(ODOMETRY):
            try:
                self._move(motion_of(heard.message), heard, stamp_ns_of(heard.message.header.stamp))
            except Unusable as error:
                self.unusable = str(error)
        for heard in self.reads.take(CONTACT):
            self.is_touching = is_set(heard.message, self.contact_field)

    def clock_problem(self, now_ns: int) -> str:
        """Why the clock of a simulated robot cannot be used; empty if it can."""
        if not self.is_simulated:
            return ""
        if self._clock is None:
            return "/clock has no message yet, and simulated = true"
        is_paused = now_ns - self._clock[1] > PAUSED_NS
        return "/clock has stopped: the simulator is paused or has ended" if is_paused else ""

    def clock_ns(self, now_ns: int) -> int | None:
        """Time on the robot's clock, ns, for the stamps of commands; None if it is not known."""
        known = self._clock if self.is_simulated else self._sent
        return None if known is None else known[0] + now_ns - known[1]

    def when_ns(self, name: str, heard: Heard, stamp_ns: int) -> int:
        """When the data of a message were measured, on this host's monotonic clock.

        Args:
            name: Of its topic; delays are estimated for each.
            heard: The message.
            stamp_ns: Stamp of its header.
        """
        delays = self._delays.setdefault(name, Delays())
        if self.is_simulated and self._clock is not None:
            return delays.measured_by_clock_ns(stamp_ns, self._clock[0], heard.arrived_ns)
        return delays.measured_ns(stamp_ns, heard.source_ns, heard.arrived_ns)

    def _move(self, motion: Motion, heard: Heard, stamp_ns: int) -> None:
        self.anchor.check(motion.twist)
        at_ns = self.when_ns(ODOMETRY, heard, stamp_ns)
        self._sent = heard.source_ns, heard.arrived_ns
        if self.measured_ns is None or at_ns >= self.measured_ns:
            self.pose, self.twist = self.anchor.place(motion.pose, heard.gid, at_ns), motion.twist
            self.measured_ns = at_ns

    def _move_by_frames(self, heard: Heard) -> None:
        """Odometry from /tf; the velocity is that between the last two poses."""
        own = [one for one in heard.message.transforms if one.header.frame_id.lstrip("/") == self.odometry_frame]
        found = self.frames.find(self.odometry_frame, self.frame)
        if not own or found is None:
            return
        stamp_ns = stamp_ns_of(own[-1].header.stamp)
        pose = (float(found[0, 3]), float(found[1, 3]), heading_of(found))
        if self._moved is None or stamp_ns > self._moved[1]:
            twist = self.twist if self._moved is None else _twist_between(*self._moved, pose, stamp_ns)
            self._moved = pose, stamp_ns
            self._move(Motion(pose, twist), heard, stamp_ns)
        elif stamp_ns < self._moved[1] - PAUSED_NS:  # the clock was set back or restarted
            self._moved = pose, stamp_ns


@dataclass
class Laser:
    """A laser scanner.

    Args:
        topic: Its topic.
        mount: (4, 4) from its frame to base; None to take it from /tf.
        short_is_nothing: `is_far_below` of `beams_of_laser`.

    Attributes:
        lacks: Frame that /tf does not connect to the base; empty if there is none.
        unusable: Why the newest scan cannot be used; empty if it can.
    """

    topic: str
    mount: Floats | None
    short_is_nothing: bool
    lacks: str = ""
    unusable: str = ""

    def read(self, robot: Robot, now_ns: int) -> tuple[Beams, int] | None:
        """The newest usable scan since the last call and when it was measured, ns; None if there is none."""
        newest: tuple[Beams, int] | None = None
        for heard in robot.reads.take(self.topic):
            header = heard.message.header
            mount = robot.frames.find(robot.frame, header.frame_id) if self.mount is None else self.mount
            self.lacks = header.frame_id if mount is None else ""
            at_ns = robot.when_ns(self.topic, heard, stamp_ns_of(header.stamp))
            if mount is None:
                continue
            try:
                beams = beams_of_laser(heard.message, mount, self.short_is_nothing)
                self.unusable = "" if len(beams.ranges) else "no beam of the scan is a measurement"
            except Unusable as error:
                self.unusable = str(error)
            else:
                newest = (beams, at_ns) if len(beams.ranges) else newest
        return newest


@dataclass
class Ranges:
    """A ring of single-beam range sensors. It has a reading only while all of them have one.

    Args:
        topics: One for each sensor.
        mounts: (4, 4) from each sensor's frame to base; None to take them from /tf.
        stale_ns: Age from which a reading is stale.

    Attributes:
        lacks, unusable: See `Laser`.
    """

    topics: tuple[str, ...]
    mounts: tuple[Floats, ...] | None
    stale_ns: int
    lacks: str = ""
    unusable: str = ""
    _last: dict[str, tuple[Any, Floats, int]] = field(default_factory=dict)

    def read(self, robot: Robot, now_ns: int) -> tuple[Beams, int] | None:
        """All readings as one scan and when the newest was measured, ns; None without a new one or with a stale one."""
        has_news = False
        for number, topic in enumerate(self.topics):
            for heard in robot.reads.take(topic):
                header = heard.message.header
                mount = robot.frames.find(robot.frame, header.frame_id) if self.mounts is None else self.mounts[number]
                self.lacks = header.frame_id if mount is None else ""
                if mount is not None:
                    self._last[topic] = heard.message, mount, robot.when_ns(topic, heard, stamp_ns_of(header.stamp))
                    has_news = True
        fresh = [last for last in self._last.values() if now_ns - last[2] <= self.stale_ns]
        if not has_news or len(fresh) < len(self.topics):
            return None
        ordered = [self._last[topic] for topic in self.topics]
        try:
            beams = beams_of_ranges([one[0] for one in ordered], [one[1] for one in ordered])
        except Unusable as error:
            self.unusable = str(error)
            return None
        self.unusable = ""
        return beams, max(one[2] for one in ordered)


def _twist_between(
    before: tuple[float, float, float], before_ns: int, after: tuple[float, float, float], after_ns: int
) -> tuple[float, float, float]:
    """Mean velocity in the base frame between two poses, m/s and rad/s."""
    seconds = (after_ns - before_ns) * 1e-9
    turn = math.remainder(after[2] - before[2], math.tau)
    heading = before[2] + 0.5 * turn
    x, y = after[0] - before[0], after[1] - before[1]
    cos, sin = math.cos(heading), math.sin(heading)
    return (cos * x + sin * y) / seconds, (-sin * x + cos * y) / seconds, turn / seconds

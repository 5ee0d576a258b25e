"""The latest state of a live robot from its topics: motion, contact, clock, frames and range readings.

The platform `ros2_base` polls these objects in each tick; the messages come from `link`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from navloom_ros.base.frames import Frames, heading_of
from navloom_ros.base.readings import (
    Anchor,
    Beams,
    Motion,
    beams_of_laser,
    beams_of_ranges,
    check_child,
    check_level,
    check_range,
    is_set,
    motion_of,
)
from navloom_ros.base.stamps import Delays
from navloom_ros.errors import Unusable
from navloom_ros.times import ns_of

__all__ = ["CLOCK", "CONTACT", "ODOMETRY", "STATIC", "TF", "Feed", "Heard", "Laser", "Ranges", "Robot"]

ODOMETRY, TF, STATIC, CONTACT, CLOCK = "odometry", "tf", "tf static", "contact", "clock"
"""Names in `Link` of the topics that belong to no sensor."""
PAUSED_NS = 500_000_000
"""Time without a change of /clock after which the simulator counts as paused, ns."""
NO_BEAM = "no beam of the scan is a measurement; if it reports 0 for no echo, set short_is_nothing = true"

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
        heard_ns: When the newest valid odometry arrived, on the same clock; None before the first.
        contact_ns: When the newest contact message arrived, on the same clock; None before the first.
        is_touching: The robot is in contact, by the newest message.
        unusable: Why the newest odometry is invalid; empty if it is valid, and before the first.
    """

    reads: Reads
    frame: str
    odometry_frame: str
    anchor: Anchor
    is_simulated: bool = False
    contact_field: str = "data"
    frames: Frames = field(default_factory=Frames)
    measured_ns: int | None = None
    heard_ns: int | None = None
    contact_ns: int | None = None
    pose: tuple[float, float, float] = (0.0, 0.0, 0.0)
    twist: tuple[float, float, float] = (0.0, 0.0, 0.0)
    is_touching: bool = False
    unusable: str = ""
    _delays: dict[str, Delays] = field(default_factory=dict)
    _clock: tuple[int, int] | None = None
    _sent: tuple[int, int] | None = None
    _has_touched: bool = False
    _moved: tuple[tuple[float, float, float], int] | None = None

    def listen(self, from_tf: bool) -> None:
        """Read all new messages.

        Args:
            from_tf: Odometry comes from /tf.
        """
        for heard in self.reads.take(CLOCK):
            shown_ns = ns_of(heard.message.clock)
            # A paused simulator may repeat the same time.
            if self._clock is None or shown_ns != self._clock[0]:
                self._clock = shown_ns, heard.arrived_ns
        # Static ones first: moving frames hang on them.
        for name in (STATIC, TF):
            for heard in self.reads.take(name):
                self.frames.add(heard.message)
                if from_tf and name == TF:
                    self._try(self._move_by_frames, heard)
        for heard in self.reads.take(ODOMETRY):
            self._try(self._move_by_message, heard)
        for heard in self.reads.take(CONTACT):
            self.is_touching, self.contact_ns = is_set(heard.message, self.contact_field), heard.arrived_ns
            # A contact between two ticks must not be missed.
            self._has_touched = self._has_touched or self.is_touching

    def contact(self) -> bool:
        """Whether the robot is in contact now, or was since the last call."""
        was_touching, self._has_touched = self._has_touched, False
        return was_touching or self.is_touching

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

    def _try(self, move: Callable[[Heard], None], heard: Heard) -> None:
        try:
            move(heard)
        except Unusable as error:
            self.unusable = str(error)

    def _move_by_message(self, heard: Heard) -> None:
        check_child(heard.message.child_frame_id, self.frame, self.frames)
        self._move(motion_of(heard.message), heard, ns_of(heard.message.header.stamp))

    def _move(self, motion: Motion, heard: Heard, stamp_ns: int) -> None:
        self.anchor.check(motion)
        at_ns = self.when_ns(ODOMETRY, heard, stamp_ns)
        self._sent, self.heard_ns, self.unusable = (heard.source_ns, heard.arrived_ns), heard.arrived_ns, ""
        # Best-effort messages may overtake each other.
        if self.measured_ns is None or at_ns >= self.measured_ns:
            self.pose, self.twist = self.anchor.place(motion.pose, heard.gid, at_ns), motion.twist
            self.measured_ns = at_ns

    def _move_by_frames(self, heard: Heard) -> None:
        """Odometry from /tf; the velocity is that between the last two poses."""
        own = [
            transform
            for transform in heard.message.transforms
            if transform.header.frame_id.lstrip("/") == self.odometry_frame
        ]
        found = self.frames.find(self.odometry_frame, self.frame)
        if not own or found is None:
            return
        stamp_ns = ns_of(own[-1].header.stamp)
        pose = (float(found[0, 3]), float(found[1, 3]), heading_of(found))
        if self._moved is None or stamp_ns > self._moved[1]:
            twist = self.twist if self._moved is None else _twist_between(*self._moved, pose, stamp_ns)
            self._moved = pose, stamp_ns
            self._move(Motion(pose, twist), heard, stamp_ns)
        elif stamp_ns < self._moved[1] - PAUSED_NS:  # the clock was set back or restarted
            self._moved = pose, stamp_ns


@dataclass
class Feed:
    """The messages of one topic of a range sensor.

    Args:
        topic: Its name.
        mount: (4, 4) from the sensor's frame to base; None to take it from /tf.

    Attributes:
        why: Why the newest message cannot be used; empty if it can, and before the first.
        usable_ns: When the newest usable message came, ns; None before the first.
    """

    topic: str
    mount: Floats | None
    why: str = ""
    usable_ns: int | None = None

    def take(self, robot: Robot) -> Iterator[tuple[Any, Floats, int]]:
        """The messages since the last call whose mount is known, each with its mount and when it was measured, ns."""
        for heard in robot.reads.take(self.topic):
            header = heard.message.header
            mount = robot.frames.find(robot.frame, header.frame_id) if self.mount is None else self.mount
            at_ns = robot.when_ns(self.topic, heard, ns_of(header.stamp))
            if mount is None:
                self.why = (
                    f"no transform from its frame {header.frame_id!r} to {robot.frame!r}: publish it, give the sensor "
                    "a mount, or set base_frame"
                )
            else:
                yield heard.message, mount, at_ns

    def judge(self, why: str, now_ns: int) -> None:
        """Note why the newest message cannot be used; empty if it can."""
        self.why = why
        if not why:
            self.usable_ns = now_ns


class Laser:
    """A laser scanner.

    Args:
        topic: Its topic.
        mount: (4, 4) from its frame to base; None to take it from /tf.
        short_is_nothing: `is_far_below` of `beams_of_laser`.

    Attributes:
        feeds: Its topic.
    """

    def __init__(self, topic: str, mount: Floats | None, short_is_nothing: bool) -> None:
        self.feeds = (Feed(topic, mount),)
        self._short_is_nothing = short_is_nothing
        self._read_ns = 0

    def read(self, robot: Robot, now_ns: int) -> tuple[Beams, int] | None:
        """The newest usable scan since the last call and when it was measured, ns; None if there is none newer."""
        newest: tuple[Beams, int] | None = None
        (feed,) = self.feeds
        for message, mount, at_ns in feed.take(robot):
            try:
                beams = beams_of_laser(message, mount, self._short_is_nothing)
            except Unusable as error:
                feed.judge(str(error), now_ns)
            else:
                feed.judge("" if len(beams.ranges) else NO_BEAM, now_ns)
                if len(beams.ranges) and at_ns >= self._read_ns:
                    newest, self._read_ns = (beams, at_ns), at_ns
        return newest


class Ranges:
    """A ring of single-beam range sensors. It has a reading only while all of them have one.

    Args:
        topics: One for each sensor.
        mounts: (4, 4) from each sensor's frame to base; None to take them from /tf.
        stale_ns: Age from which a reading is stale.
        short_is_nothing: `is_far_below` of `beams_of_ranges`.

    Attributes:
        feeds: The topics.
    """

    def __init__(
        self, topics: Sequence[str], mounts: Sequence[Floats] | None, stale_ns: int, short_is_nothing: bool
    ) -> None:
        self.feeds = tuple(
            Feed(topic, None if mounts is None else mounts[number]) for number, topic in enumerate(topics)
        )
        self._stale_ns, self._short_is_nothing = stale_ns, short_is_nothing
        self._last: dict[str, tuple[Any, Floats, int]] = {}

    def read(self, robot: Robot, now_ns: int) -> tuple[Beams, int] | None:
        """All readings as one scan and when the newest was measured, ns; None without a new one or with a stale one."""
        has_news = False
        for feed in self.feeds:
            for message, mount, at_ns in feed.take(robot):
                try:
                    check_range(message)
                    check_level(mount)
                except Unusable as error:
                    feed.judge(str(error), now_ns)
                else:
                    feed.judge("", now_ns)
                    if feed.topic not in self._last or at_ns >= self._last[feed.topic][2]:
                        self._last[feed.topic] = message, mount, at_ns
                        has_news = True
        fresh = [last for last in self._last.values() if now_ns - last[2] <= self._stale_ns]
        # With a part of the ring, silent sonars would look like free space.
        if not has_news or len(fresh) < len(self.feeds):
            return None
        ordered = [self._last[feed.topic] for feed in self.feeds]
        beams = beams_of_ranges([one[0] for one in ordered], [one[1] for one in ordered], self._short_is_nothing)
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

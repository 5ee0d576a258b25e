"""The platform plugin `ros2_base`: a robot on a ROS 2 network behind the role interface of a platform.

It joins the parts of this package: `link` has the network, `sources` what the robot reported last.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from navloom import (
    Contact,
    Context,
    InputError,
    Message,
    Odometry,
    Params,
    Platform,
    PlatformInput,
    PlatformOutput,
    Pose2D,
    RangeScan,
    SensorSpec,
    Twist2D,
)

from navloom_ros.base.frames import planar
from navloom_ros.base.link import FLOWING, TRANSFORMS, Link, Settings, Topic
from navloom_ros.base.params import LaserSettings, Mount, RangeSettings, Ros2BaseParams
from navloom_ros.base.readings import Anchor, Beams, check_field
from navloom_ros.base.sources import CLOCK, CONTACT, ODOMETRY, STATIC, TF, Laser, Ranges, Robot
from navloom_ros.errors import RosError
from navloom_ros.params import network_of
from navloom_ros.qos import DEFAULT
from navloom_ros.wire import monotonic_ns

__all__ = ["Ros2Base"]

STILL = Twist2D(0.0, 0.0, 0.0)
UNUSABLE_NS = 1_000_000_000
"""Time without a usable message of a sensor after which the robot is stopped with the reason, ns."""


class Ros2Base(Platform):
    """Drives a base through its velocity topic, and reads odometry, scans and contact from its ROS network.

    While the robot cannot be driven, `advance` raises with the reason, and the gate keeps the robot stopped.
    """

    name = "ros2_base"
    sensor_kinds: ClassVar[Mapping[str, type[Message]]] = {"laser_scan": RangeScan, "ranges": RangeScan}
    sensor_settings: ClassVar[Mapping[str, type[Params]]] = {"laser_scan": LaserSettings, "ranges": RangeSettings}
    Params = Ros2BaseParams

    def __init__(self, params: Any, context: Context) -> None:
        super().__init__(params, context)
        if 0.0 < params.base_timeout_s < 2.0 * context.period:
            raise InputError(
                f"base_timeout_s: {params.base_timeout_s:g} s is less than two ticks of {context.period:g} s: the base "
                "would stop between commands; set a shorter run.period"
            )
        self._sensors = {spec.name: _sensor(spec) for spec in context.sensors}
        self._read_ns: int | None = None
        anchor = Anchor(params.odometry_origin == "first", context.robot.max_linear, context.robot.max_angular)
        try:
            topics = self._topics()
            self._link = Link(_settings(params, context.period), topics)
            self._full_names = {topic.name: network_of(params).full_name(topic.name) for topic in topics.values()}
            if params.contact_topic:
                check_field(self._link.types, params.contact_type, params.contact_field)
        except RosError as error:
            raise InputError(str(error)) from None
        self._robot = Robot(
            self._link, params.base_frame, params.odometry_frame, anchor, params.simulated, params.contact_field
        )
        self._command = STILL
        self._zero_ns: int | None = None
        self._newest = dict.fromkeys((ODOMETRY, *self._sensors), 0)

    def drive(self, command: Twist2D, time_ns: int) -> None:
        """Send a velocity now, without waiting for the next tick."""
        self._command = command
        self._link.send(command.vx, command.vy, command.wz, self._robot.clock_ns(monotonic_ns()))

    def advance(self, given: PlatformInput) -> PlatformOutput:
        """Send the command again, and return what the robot has reported since the last tick.

        Raises:
            RosError: The robot cannot be driven now; the text says why.
        """
        self.drive(given.command, given.time_ns)  # a base times out when no command arrives
        now, robot, given_ns = monotonic_ns(), self._robot, given.time_ns
        if self._zero_ns is None or now - given_ns < self._zero_ns or now - given_ns > self._zero_ns + 10**9:
            # The run clock may lag behind by a late tick; only a shift by more means another clock.
            self._zero_ns = now - given_ns
        robot.listen(self.params.odometry == "tf")
        # In this order: the first problem causes those after it.
        if why := self._link.problem() or robot.clock_problem(now) or self._silence(now) or self._contact_problem(now):
            raise RosError(why)
        odometry = Odometry(
            self._stamp(ODOMETRY, robot.measured_ns or 0, given_ns), Pose2D(*robot.pose), Twist2D(*robot.twist)
        )
        scans = dict(self._scans(now, given_ns))
        if why := self._sensor_problem(now):
            raise RosError(why)
        return PlatformOutput(odometry, scans, Contact(robot.contact()), None)

    def close(self) -> None:
        """Leave the network."""
        self._link.close()

    def _scans(self, now: int, time_ns: int) -> Any:
        for name, sensor in self._sensors.items():
            found = sensor.read(self._robot, now)
            if found is not None:
                yield name, _scan(found[0], self._stamp(name, found[1], time_ns))

    def _stamp(self, name: str, measured_ns: int, time_ns: int) -> int:
        """Converts a time on this host's monotonic clock to the run clock, ns; never decreases for the same stream."""
        assert self._zero_ns is not None
        # After a restart of the run clock, earlier stamps lie ahead.
        newest = min(self._newest[name], time_ns)
        self._newest[name] = max(newest, min(time_ns, measured_ns - self._zero_ns))
        return self._newest[name]

    def _silence(self, now: int) -> str:
        """Why there is no current odometry; empty if there is."""
        by_frames = self.params.odometry == "tf"
        what = self._full_names[self.params.tf_topic if by_frames else self.params.odometry_topic]
        measured_ns, heard_ns = self._robot.measured_ns, self._robot.heard_ns
        if self._robot.anchor.is_unsteady(now):
            return f"{what} keeps jumping: does it have more than one publisher?"
        longest_ns = self.params.odometry_timeout * 1e9
        if measured_ns is not None and now - measured_ns <= longest_ns:
            return ""
        if measured_ns is not None and heard_ns is not None and now - heard_ns <= longest_ns:
            age = (now - measured_ns) * 1e-9
            return f"{what} has messages, but the newest was measured {age:.2f} s ago: the robot or its link is slow"
        why = self._robot.unusable or self._link.why_silent(TF if by_frames else ODOMETRY)
        since = (
            "has no message yet" if measured_ns is None else f"has been silent for {(now - measured_ns) * 1e-9:.2f} s"
        )
        return f"{what} {since}{': ' * bool(why)}{why}"

    def _contact_problem(self, now: int) -> str:
        """Why a contact would not be noticed now; empty if it would, and without a contact topic."""
        topic, longest, heard_ns = self.params.contact_topic, self.params.contact_timeout, self._robot.contact_ns
        is_fresh = heard_ns is not None and now - heard_ns <= longest * 1e9
        if not topic or is_fresh:
            return ""
        why = self._link.why_silent(CONTACT)
        if not longest and not why:
            return ""
        since = "has no message yet" if heard_ns is None else f"has been silent for {(now - heard_ns) * 1e-9:.1f} s"
        return f"{self._full_names[topic]} {since}: {why or 'if it sends changes only, set contact_timeout = 0'}"

    def _sensor_problem(self, now: int) -> str:
        """Why a sensor gives nothing, if the reason is known; the gate notices one that merely falls silent."""
        if self._read_ns is None:
            self._read_ns = now
        for name, sensor in self._sensors.items():
            for feed in sensor.feeds:
                since_ns = self._read_ns if feed.usable_ns is None else feed.usable_ns
                if now - since_ns <= UNUSABLE_NS:
                    continue
                why = feed.why or ("" if feed.usable_ns is not None else self._link.why_silent(feed.topic))
                if feed.why and feed.mount is None and (untold := self._link.why_silent(STATIC)):
                    why = f"{why}; {self._full_names[f'{self.params.tf_topic}_static']}: {untold}"
                if why:
                    return f"sensor {name}: {self._full_names[feed.topic]}: {why}"
        return ""

    def _topics(self) -> dict[str, Topic]:
        params = self.params
        transform = "tf2_msgs/msg/TFMessage"
        topics = {
            TF: Topic(params.tf_topic, transform, FLOWING),
            STATIC: Topic(f"{params.tf_topic}_static", transform, TRANSFORMS),
        }
        if params.odometry == "topic":
            topics[ODOMETRY] = Topic(params.odometry_topic, "nav_msgs/msg/Odometry")
        if params.contact_topic:
            topics[CONTACT] = Topic(params.contact_topic, params.contact_type, DEFAULT)
        if params.simulated:
            topics[CLOCK] = Topic("/clock", "rosgraph_msgs/msg/Clock", FLOWING)
        for sensor in self._sensors.values():
            kind = "sensor_msgs/msg/LaserScan" if isinstance(sensor, Laser) else "sensor_msgs/msg/Range"
            topics |= {feed.topic: Topic(feed.topic, kind) for feed in sensor.feeds}
        return topics


def _sensor(spec: SensorSpec) -> Laser | Ranges:
    if spec.kind == "laser_scan":
        laser = LaserSettings.model_validate(dict(spec.settings))
        return Laser(laser.topic, None if laser.mount is None else _mount(laser.mount), laser.short_is_nothing)
    ranges = RangeSettings.model_validate(dict(spec.settings))
    mounts = None if ranges.mounts is None else tuple(map(_mount, ranges.mounts))
    return Ranges(tuple(ranges.topics), mounts, round(ranges.stale_after * 1e9), ranges.short_is_nothing)


def _mount(mount: Mount) -> Any:
    return planar(mount.x, mount.y, mount.heading)


def _settings(params: Ros2BaseParams, period: float) -> Settings:
    # Less than two ticks, and a late tick would stop the base.
    silence = max(params.guard_silence, 2.0 * period)
    return Settings(network_of(params), params.command_topic, params.stamped, params.base_frame, silence)


def _scan(beams: Beams, stamp_ns: int) -> RangeScan:
    return RangeScan(stamp_ns, *beams)

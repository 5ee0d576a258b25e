"""Parameters of the platform `ros2_base` and of its sensors."""

from __future__ import annotations

import math
from typing import Literal

from navloom import Params
from pydantic import ConfigDict, Field, model_validator

from navloom_ros.params import Ros2Network

__all__ = ["LaserSettings", "Mount", "RangeSettings", "Ros2BaseParams"]


class Ros2BaseParams(Ros2Network):
    """A wheeled robot on a ROS 2 network."""

    base_timeout_s: float = Field(
        ge=0.0, le=5.0,
        description="Time without a command after which the base stops by itself, s; 0 if it never does. Measure it: "
        "when the link is cut, nothing else stops the robot.",
    )  # fmt: skip
    without_base_timeout: bool = Field(False, description="Drive a base that never stops by itself.")
    command_topic: str = Field("cmd_vel", description="Velocity topic of the base.")
    stamped: bool = Field(False, description="The base takes TwistStamped instead of Twist.")
    base_frame: str = Field("base_link", description="Frame on the floor between the wheels.")
    odometry: Literal["topic", "tf"] = Field("topic", description="Take odometry from odometry_topic, or from /tf.")
    odometry_topic: str = Field("odom", description="nav_msgs/msg/Odometry.")
    odometry_frame: str = Field("odom", description='Parent of base_frame on /tf, for odometry = "tf".')
    odometry_origin: Literal["robot", "first"] = Field(
        "robot",
        description="navigation.start is the pose of the robot's odometry frame (robot), or of the robot at the first "
        "odometry that this process receives (first), so that a restart of the process changes it.",
    )
    odometry_timeout: float = Field(
        0.25, gt=0.0, le=2.0, description="Time without odometry after which the robot is stopped, s."
    )
    tf_topic: str = Field("tf", description="tf2_msgs/msg/TFMessage; NAME_static is also read.")
    contact_topic: str = Field("", description="Topic of a bumper or contact sensor; empty for none.")
    contact_type: str = Field("std_msgs/msg/Bool", description="Type of contact_topic.")
    contact_field: str = Field("data", description="Field that is true, nonzero or nonempty during contact.")
    contact_timeout: float = Field(
        1.0, ge=0.0, le=60.0,
        description="Time without a message on contact_topic after which the robot is stopped, s; 0 for a topic that "
        "sends changes only.",
    )  # fmt: skip
    simulated: bool = Field(False, description="The robot's stamps are those of /clock.")
    guard_silence: float = Field(
        0.1, ge=0.05, le=1.0, description="Time without a tick until the guardian stops the base, s; at least 2 ticks."
    )

    @model_validator(mode="after")
    def _base_stops_by_itself(self) -> Ros2BaseParams:
        if self.base_timeout_s == 0.0 and not self.without_base_timeout:
            raise ValueError(
                "base_timeout_s: is 0: when the link to the base is cut, it continues with its last command; give the "
                "base a command timeout, or set without_base_timeout = true"
            )
        return self


class Mount(Params):
    """Where a sensor is on the base."""

    model_config = ConfigDict(frozen=True)

    x: float = Field(0.0, description="Forward offset, m.")
    y: float = Field(0.0, description="Offset to the left, m.")
    heading_deg: float = Field(0.0, ge=-360.0, le=360.0, description="Heading, counter-clockwise, degrees.")

    @property
    def heading(self) -> float:
        """Heading on the base, rad."""
        return math.radians(self.heading_deg)


class LaserSettings(Params):
    """Settings of a sensor of kind `laser_scan`."""

    topic: str = Field("scan", description="sensor_msgs/msg/LaserScan.")
    mount: Mount | None = Field(None, description="Pose on the base; by default from /tf.")
    short_is_nothing: bool = Field(
        False, description="A range below range_min, as 0, means no echo; otherwise the beam is ignored."
    )


class RangeSettings(Params):
    """Settings of a sensor of kind `ranges`: sonars or infrared sensors, each with its own topic."""

    topics: list[str] = Field(
        min_length=1, max_length=64, description="sensor_msgs/msg/Range, one topic for each beam."
    )
    mounts: list[Mount] | None = Field(None, description="Pose on the base for each topic; by default from /tf.")
    stale_after: float = Field(0.5, gt=0.0, le=5.0, description="Age from which a reading is stale, s.")
    short_is_nothing: bool = Field(
        False, description="A range below min_range, as 0, means no echo; otherwise something may be that close."
    )

    @model_validator(mode="after")
    def _mounts_fit(self) -> RangeSettings:
        if self.mounts is not None and len(self.mounts) != len(self.topics):
            raise ValueError(
                f"mounts: there are {len(self.mounts)}; expected one for each of {len(self.topics)} topics"
            )
        return self

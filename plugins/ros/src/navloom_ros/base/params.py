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
        description="s without a command after which the base stops by itself; 0 where it never does. Look it up: "
        "where the link is cut, nothing else stops the robot.",
    )  # fmt: skip
    without_base_timeout: bool = Field(False, description="Drive a base that never stops by itself.")
    command_topic: str = Field("/cmd_vel", description="Where the base takes velocities.")
    stamped: bool = Field(False, description="The base takes TwistStamped instead of Twist.")
    base_frame: str = Field("base_link", description="Frame on the floor between the wheels.")
    odometry: Literal["topic", "tf"] = Field("topic", description="Take odometry from odometry_topic, or from /tf.")
    odometry_topic: str = Field("/odom", description="nav_msgs/msg/Odometry.")
    odometry_frame: str = Field("odom", description="Parent of base_frame on /tf, where odometry is taken from there.")
    odometry_origin: Literal["robot", "first"] = Field(
        "robot",
        description="navigation.start is the place of the robot's odometry frame (robot), or of the robot when this "
        "process first hears it (first), which a restart of the process changes.",
    )
    odometry_timeout: float = Field(0.25, gt=0.0, le=2.0, description="s without odometry that stop the robot.")
    tf_topic: str = Field("/tf", description="tf2_msgs/msg/TFMessage; NAME_static is read as well.")
    contact_topic: str = Field("", description="Bumper or contact sensor; none where empty.")
    contact_type: str = Field("std_msgs/msg/Bool", description="Type of contact_topic.")
    contact_field: str = Field("data", description="Field that is true, not zero or not empty in contact.")
    simulated: bool = Field(False, description="The robot's stamps are those of /clock.")
    guard_silence: float = Field(
        0.1, ge=0.05, le=1.0, description="s without a tick after which the guardian stops the base; at least 2 ticks."
    )

    @model_validator(mode="after")
    def _base_stops_by_itself(self) -> Ros2BaseParams:
        if self.base_timeout_s == 0.0 and not self.without_base_timeout:
            raise ValueError(
                "base_timeout_s: is 0: where the link to the base is cut, it drives on with its last command; give the "
                "base a command timeout, or say without_base_timeout = true"
            )
        return self


class Mount(Params):
    """Where a sensor is on the base."""

    model_config = ConfigDict(frozen=True)

    x: float = Field(0.0, description="m, forward.")
    y: float = Field(0.0, description="m, to the left.")
    heading_deg: float = Field(0.0, description="degrees, counter-clockwise.")

    @property
    def heading(self) -> float:
        """Heading on the base, rad."""
        return math.radians(self.heading_deg)


class LaserSettings(Params):
    """Settings of a sensor of kind `laser_scan`."""

    topic: str = Field("/scan", description="sensor_msgs/msg/LaserScan.")
    mount: Mount | None = Field(None, description="On the base; by default as /tf says.")
    short_is_nothing: bool = Field(
        False, description="A range below range_min, as 0, means that nothing is within reach; else it means nothing."
    )


class RangeSettings(Params):
    """Settings of a sensor of kind `ranges`: sonars or infrared sensors, each with its own topic."""

    topics: list[str] = Field(min_length=1, max_length=64, description="sensor_msgs/msg/Range, one a beam.")
    mounts: list[Mount] | None = Field(None, description="On the base, one a topic; by default as /tf says.")
    stale_after: float = Field(0.5, gt=0.0, le=5.0, description="s after which a reading counts no more.")

    @model_validator(mode="after")
    def _mounts_fit(self) -> RangeSettings:
        if self.mounts is not None and len(self.mounts) != len(self.topics):
            raise ValueError(
                f"mounts: there are {len(self.mounts)}; expected one for each of {len(self.topics)} topics"
            )
        return self

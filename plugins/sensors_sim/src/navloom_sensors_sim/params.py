"""Parameters of the simulated robot and settings of its sensors, with bounds and units."""

from __future__ import annotations

import math
from typing import Literal, TypeVar

import numpy as np
from navloom import Params
from numpy.typing import NDArray
from pydantic import Field, model_validator

__all__ = ["LaserSettings", "PitchedLaserSettings", "SensorsSimParams", "SonarSettings"]

Settings = TypeVar("Settings", bound=Params)
_STAMP_DELAY = Field(
    0.0, ge=0.0, le=1.0, description="From a measurement to its stamp, s: a driver that stamps what has arrived."
)


class SensorsSimParams(Params):
    """Parameters of the drive and wheel odometry. The nominal wheel radius and half track are those of `[robot]`."""

    wheel_radius_error: float = Field(
        0.0, gt=-0.5, lt=0.5, description="True wheel radius divided by the nominal one, minus 1."
    )
    half_track_error: float = Field(
        0.0, gt=-0.5, lt=0.5, description="True half track divided by the nominal one, minus 1."
    )
    max_wheel_speed: float = Field(20.0, gt=0.0, le=1000.0, description="Highest wheel speed, rad/s.")
    motor_time_constant: float = Field(0.0, ge=0.0, le=5.0, description="First-order lag of a wheel, s; 0 is none.")
    max_wheel_acceleration: float = Field(0.0, ge=0.0, le=1e5, description="Wheel acceleration, rad/s²; 0 is no limit.")
    dead_time: float = Field(0.0, ge=0.0, le=2.0, description="Delay from a command to the wheels, s.")
    steering_time_constant: float = Field(
        0.0, ge=0.0, le=5.0, description="Ackermann: first-order lag of the steering angle, s; 0 is none."
    )
    odometry_right_radius_error: float = Field(
        0.0,
        gt=-0.5,
        lt=0.5,
        description="Right wheel radius that odometry assumes divided by the nominal one, minus 1.",
    )
    odometry_left_radius_error: float = Field(
        0.0, gt=-0.5, lt=0.5, description="Left wheel radius that odometry assumes divided by the nominal one, minus 1."
    )
    odometry_half_track_error: float = Field(
        0.0, gt=-0.5, lt=0.5, description="Half track that odometry assumes divided by the nominal one, minus 1."
    )
    slip: float = Field(
        0.002, ge=0.0, le=0.5, description="Standard deviation of a wheel's distance after 1 m, m/sqrt(m)."
    )
    encoder_counts: int = Field(
        0, ge=0, le=10_000_000, description="Encoder counts per wheel turn; 0 is a continuous encoder."
    )
    noise: bool = Field(True, description="Slip is simulated; calibration errors and encoder counts always are.")

    def drive_constants(self, wheel_radius: float, half_track: float) -> NDArray[np.float64]:
        """(8,) `drive` of `motion.drive_tick` from the nominal wheel radius and half track, m; the time is still 0."""
        true = (wheel_radius * (1.0 + self.wheel_radius_error), half_track * (1.0 + self.half_track_error))
        limits = (self.max_wheel_speed, self.motor_time_constant, self.max_wheel_acceleration or math.inf)
        return np.array([wheel_radius, half_track, *true, *limits, 0.0])

    def steering_constants(self, wheelbase: float, largest: float, rate: float) -> NDArray[np.float64]:
        """(4,) end of `drive` of `motion.steer_tick`, from wheelbase, m, largest angle, rad, and rate, rad/s."""
        return np.array([wheelbase, largest, rate, self.steering_time_constant])

    def odometry_constants(self, wheel_radius: float, half_track: float) -> NDArray[np.float64]:
        """(5,) `odometry` of `motion.drive_tick` from the nominal wheel radius and half track, m."""
        right = wheel_radius * (1.0 + self.odometry_right_radius_error)
        left = wheel_radius * (1.0 + self.odometry_left_radius_error)
        count = 2.0 * math.pi / self.encoder_counts if self.encoder_counts else 0.0
        slip = self.slip if self.noise else 0.0
        return np.array([right, left, half_track * (1.0 + self.odometry_half_track_error), slip, count])


class _Mounted(Params):
    """Settings of a mounted sensor: its mount in the base frame and its noise switch."""

    x: float = Field(0.0, ge=-10.0, le=10.0, description="Mount ahead of the base's origin, m.")
    y: float = Field(0.0, ge=-10.0, le=10.0, description="Mount to the left of the base's origin, m.")
    noise: bool = Field(True, description="Every random and systematic error of this sensor is simulated.")


class PitchedLaserSettings(_Mounted):
    """An LMS-211 on a pitching mount: `kind = "pitched_laser"`."""

    z: float = Field(0.4, gt=0.0, le=10.0, description="Mount above the floor, m.")
    mode: Literal["on_request", "continuous"] = Field(
        "on_request", description="Stop-and-scan, or pitching up and down."
    )
    geometry: Literal["paper", "rigid_pitch"] = Field("paper", description="Eq. (1), or a plane pitched as a whole.")
    frames: int = Field(94, ge=1, le=2000, description="Frames of a sweep.")
    beams: int = Field(101, ge=1, le=2000, description="Beams of a frame.")
    field_of_view_deg: float = Field(100.0, gt=0.0, lt=180.0, description="From the first beam to the last, degrees.")
    first_pitch_deg: float = Field(
        -5.0, gt=-90.0, lt=90.0, description="Pitch of the first frame, up positive, degrees."
    )
    pitch_step_deg: float = Field(0.266, gt=-10.0, lt=10.0, description="Pitch between frames, degrees.")
    sweep_time: float = Field(1.25, gt=0.0, le=60.0, description="Duration of a sweep, s.")
    range_min: float = Field(0.1, ge=0.0, le=10.0, description="Lowest range, m; nearer returns read this.")
    range_max: float = Field(80.0, gt=0.0, le=1000.0, description="Highest range, m; farther returns are no echo.")
    sigma: float = Field(0.01, ge=0.0, le=1.0, description="Standard deviation of a range, m.")
    systematic: float = Field(
        0.0,
        ge=0.0,
        le=1.0,
        description="Bound of the systematic error, m, drawn uniformly once per run; LMS-211: 0.035.",
    )

    @model_validator(mode="after")
    def _ranges_rise(self) -> PitchedLaserSettings:
        return _check_ranges(self, self.range_min, self.range_max)


class LaserSettings(_Mounted):
    """A planar laser: `kind = "laser_2d"`."""

    z: float = Field(0.3, gt=0.0, le=10.0, description="Scan plane above the floor, m.")
    heading_deg: float = Field(0.0, ge=-180.0, le=180.0, description="Middle of the field of view, degrees.")
    beams: int = Field(181, ge=1, le=10_000, description="Beams of a scan.")
    field_of_view_deg: float = Field(180.0, gt=0.0, le=360.0, description="From the first beam to the last, degrees.")
    range_min: float = Field(0.05, ge=0.0, le=10.0, description="Lowest range, m; nearer returns read this.")
    range_max: float = Field(30.0, gt=0.0, le=1000.0, description="Highest range, m; farther returns are no echo.")
    sigma: float = Field(0.01, ge=0.0, le=1.0, description="Standard deviation of a range, m.")
    dropout: float = Field(0.0, ge=0.0, le=1.0, description="Probability that a beam gives no echo.")
    stuck_beam: int | None = Field(
        None, ge=0, lt=10_000, description="Index of a beam that always reads `stuck_range`."
    )
    stuck_range: float = Field(0.5, ge=0.0, le=1000.0, description="What a stuck beam reads, m.")
    rate_hz: float | None = Field(None, gt=0.0, le=10_000.0, description="Scan rate, Hz; none: one scan per tick.")
    stamp_delay: float = _STAMP_DELAY

    @model_validator(mode="after")
    def _ranges_rise(self) -> LaserSettings:
        if self.stuck_beam is not None and self.stuck_beam >= self.beams:
            raise ValueError(f"stuck_beam = {self.stuck_beam}, expected one of 0 to {self.beams - 1}")
        return _check_ranges(self, self.range_min, self.range_max)


class SonarSettings(Params):
    """A ring of eight cone sonars on the rim of the footprint: `kind = "sonar_ring"`."""

    layout: Literal["p3dx", "pairs"] = Field("p3dx", description="Bearings ±90, ±50, ±30, ±10°; or two on each side.")
    z: float = Field(0.25, gt=0.0, le=10.0, description="Axes above the floor, m.")
    half_angle_deg: float = Field(15.0, gt=0.0, le=45.0, description="Half the opening of a cone, degrees.")
    columns: int = Field(13, ge=1, le=101, description="Rays over the width of a cone.")
    rows: int = Field(1, ge=1, le=101, description="Rays over the height of a cone.")
    floor_echoes: bool = Field(False, description="Rays of lower rows can meet the floor; smooth floors give no echo.")
    range_min: float = Field(0.3, ge=0.0, le=10.0, description="Lowest range, m; nearer echoes read this.")
    range_max: float = Field(4.0, gt=0.0, le=100.0, description="Highest range, m; farther echoes are not received.")
    sigma: float = Field(0.01, ge=0.0, le=1.0, description="Standard deviation of a range, m.")
    critical_angle_deg: float | None = Field(
        None, gt=0.0, lt=90.0, description="Incidence beyond which a ray is reflected away, degrees; none: never."
    )
    dropout: float = Field(0.0, ge=0.0, le=1.0, description="Probability that a sonar gives no echo.")
    crosstalk: float = Field(
        0.0, ge=0.0, le=1.0, description="Probability of crosstalk per reading and pair of neighbours."
    )
    rate_hz: float | None = Field(
        None, gt=0.0, le=10_000.0, description="Reading rate, Hz; none: one reading per tick."
    )
    noise: bool = Field(True, description="Range noise and crosstalk are simulated.")
    stamp_delay: float = _STAMP_DELAY

    @model_validator(mode="after")
    def _ranges_rise(self) -> SonarSettings:
        return _check_ranges(self, self.range_min, self.range_max)


def _check_ranges(settings: Settings, low: float, high: float) -> Settings:
    if not low < high:
        raise ValueError(f"range_min = {low:g} m, expected less than range_max = {high:g} m")
    return settings

"""Faults of parts that should agree: scans and poses, twist and motion, attempts, run clocks, declarations and code."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

import numpy as np
from navloom import (
    Array,
    Avoidance,
    AvoiderInput,
    Context,
    ControllerInput,
    MapperInput,
    MapUpdate,
    Message,
    Metric,
    Params,
    PlatformInput,
    PlatformOutput,
    RangeScan,
    Recovery,
    RecoveryInput,
    RecoveryStep,
    Stamp,
    TrackingCommand,
    Trail,
    Twist2D,
    message,
)
from navloom_sensors_sim.adapter import SensorsSim
from navloom_sensors_sim.params import SensorsSimParams
from numpy.typing import NDArray
from pydantic import Field

from planted import Entries
from planted.seeing import Robot
from planted.sound import STILL, Gap, GapParams, Hits, Pause, Proportional

ENTRIES = Entries()


# --- platforms --------------------------------------------------------------------------------------------------------


@ENTRIES.plant("not_displaced", caught_by="disturbed")
class NotDisplaced(SensorsSim):
    """Says that it takes disturbances, and does not."""

    def __init__(self, params: SensorsSimParams, context: Context) -> None:
        super().__init__(params, replace(context, disturbances=()))

    def advance(self, given: PlatformInput) -> PlatformOutput:
        return super().advance(given)


@ENTRIES.plant("scans_of_last_tick", caught_by="aligned")
class ScansOfLastTick(SensorsSim):
    """Measures before it moves the robot, and stamps the scan after."""

    _last: PlatformOutput | None = None

    def reset(self) -> None:
        super().reset()
        self._last = None

    def advance(self, given: PlatformInput) -> PlatformOutput:
        report = super().advance(given)
        before, self._last = self._last, report
        if before is None:
            return report
        scans = {
            name: replace(before.scans.get(name, scan), stamp_ns=scan.stamp_ns) if isinstance(scan, RangeScan) else scan
            for name, scan in report.scans.items()
        }
        return replace(report, scans=scans)


@ENTRIES.plant("turned_mount", caught_by="aligned")
class TurnedMount(Robot):
    """Leaves the yaw of the mount out."""

    def faulty(self, scan: RangeScan) -> RangeScan:
        return replace(scan, bearings=scan.bearings + 0.06)


@ENTRIES.plant("moved_mount", caught_by="aligned")
class MovedMount(Robot):
    """Leaves the place of the mount out."""

    def faulty(self, scan: RangeScan) -> RangeScan:
        return replace(scan, origins=scan.origins + (0.0, 0.2))


class LaggingParams(SensorsSimParams):
    motor_time_constant: float = Field(0.15, ge=0.0, le=5.0, description="First-order lag of a wheel, s.")


@ENTRIES.plant("commanded_twist", caught_by="odometry_twist")
class CommandedTwist(SensorsSim):
    """Reports what it was commanded, though its motors lag."""

    Params = LaggingParams

    def advance(self, given: PlatformInput) -> PlatformOutput:
        report = super().advance(given)
        return replace(report, odometry=replace(report.odometry, twist=given.command))


@ENTRIES.plant("clearance_of_centre", caught_by="true_clearance")
class ClearanceOfCentre(SensorsSim):
    """Forgets the footprint."""

    def advance(self, given: PlatformInput) -> PlatformOutput:
        report = super().advance(given)
        assert report.truth is not None
        return replace(report, truth=replace(report.truth, clearance=report.truth.clearance + 0.25))


# --- parameters and run clocks ----------------------------------------------------------------------------------------


class IdleParams(GapParams):
    weight_of_last: float = Field(0.5, ge=0.0, le=1.0, description="Weight of the last command, no unit.")


@ENTRIES.plant("idle_parameter", caught_by="parameters_used")
class IdleParameter(Gap):
    """Declares a parameter that nothing uses."""

    Params = IdleParams


@ENTRIES.plant("clock_in_32_bits", caught_by="later_start")
class ClockIn32Bits(Gap):
    """Keeps times in milliseconds, in 32 bits."""

    def avoid(self, given: AvoiderInput) -> Avoidance:
        np.array([given.stamp_ns // 1_000_000], dtype=np.int32)
        return super().avoid(given)


@ENTRIES.plant("patience_from_zero", caught_by="later_start")
class PatienceFromZero(Pause):
    """Takes the run to begin when it begins."""

    def recover(self, given: RecoveryInput) -> RecoveryStep:
        is_over = given.stamp_ns >= self.params.pause * 1e9
        return RecoveryStep(STILL, "done" if is_over else "running", is_over)


# --- controllers and mappers ------------------------------------------------------------------------------------------


@ENTRIES.plant("speed_of_start", caught_by="reference_speed")
class SpeedOfStart(Proportional):
    """Drives as fast as the trajectory begins."""

    def control(self, given: ControllerInput) -> TrackingCommand:
        answer = super().control(given)
        return replace(answer, twist=replace(answer.twist, vx=float(given.trajectory.samples[0, 5])))


@ENTRIES.plant("errors_of_robot", caught_by="error_signs")
class ErrorsOfRobot(Proportional):
    """Reports the robot's errors, not those of the reference."""

    def control(self, given: ControllerInput) -> TrackingCommand:
        answer = super().control(given)
        return replace(answer, e2=-answer.e2, e3=-answer.e3)


@ENTRIES.plant("never_clears", caught_by="clears")
class NeverClears(Hits):
    """Keeps every echo."""

    def update(self, given: MapperInput) -> MapUpdate | None:
        return super().update(replace(given, clear=False))


# --- recoveries -------------------------------------------------------------------------------------------------------


class Back(Recovery):
    """Sound: backs up for 2 s."""

    accepts = ()
    share_of_second = 1e9

    def __init__(self, params: Params, context: Context) -> None:
        super().__init__(params, context)
        self.until_ns = 0

    def reset(self) -> None:
        self.until_ns = 0

    def recover(self, given: RecoveryInput) -> RecoveryStep:
        if self.is_new(given):
            self.until_ns = given.stamp_ns + round(2.0 * self.share_of_second)
        is_over = given.stamp_ns >= self.until_ns
        return RecoveryStep(STILL if is_over else Twist2D(-0.1, 0.0, 0.0), "done" if is_over else "running", is_over)

    def is_new(self, given: RecoveryInput) -> bool:
        return given.starts


@ENTRIES.plant("backs_in_ms", caught_by="attempt_moves")
class BacksInMilliseconds(Back):
    """Takes stamps for milliseconds."""

    share_of_second = 1e3


@ENTRIES.plant("first_attempt_only", caught_by="attempts_anew")
class FirstAttemptOnly(Back):
    """Starts once."""

    def is_new(self, given: RecoveryInput) -> bool:
        return self.until_ns == 0


@ENTRIES.plant("counts_calls", caught_by="attempt_ways")
class CountsCalls(Back):
    """Backs up for 40 calls."""

    calls = 0

    def recover(self, given: RecoveryInput) -> RecoveryStep:
        self.calls = 1 if given.starts else self.calls + 1
        is_over = self.calls >= 40
        return RecoveryStep(STILL if is_over else Twist2D(-0.1, 0.0, 0.0), "done" if is_over else "running", is_over)

    def reset(self) -> None:
        super().reset()
        self.calls = 0


# --- metrics and messages ---------------------------------------------------------------------------------------------


def ticks_of_turning(trail: Trail) -> float:
    return float((np.abs(trail.wz) > 0.1).sum())


ENTRIES.plant("time_of_turning", "metric_tick_rate", "metric")(
    Metric("time_of_turning", "s", "lower", ticks_of_turning, "Time for which the robot turns.")
)


@ENTRIES.plant("OtherLetter", "declared_as_described", "message")
@message
class OtherLetter(Message):
    """Things that were seen.

    Attributes:
        stamp_ns: Run clock at which they were seen.
        points: (n, 2) where they are, m, map frame.
        weights: (n,) how sure each is, at least 0.
    """

    stamp_ns: Stamp
    points: Annotated[NDArray[np.float64], Array("float64", ("n", 2))]
    weights: Annotated[NDArray[np.float64], Array("float64", ("k",), at_least=0.0)]


@ENTRIES.plant("Lengthless", "declared_as_described", "message")
@message
class Lengthless(Message):
    """A door.

    Attributes:
        stamp_ns: Run clock at which it was seen.
        width: Width of the opening.
    """

    stamp_ns: Stamp
    width: float


@ENTRIES.plant("Checked", "constructor", "message")
@message
class Checked(Message):
    """A door that checks itself.

    Attributes:
        stamp_ns: Run clock at which it was seen.
        width: Width of the opening, m.
    """

    stamp_ns: Stamp
    width: float

    def __post_init__(self) -> None:
        if self.width < 0.5:
            raise ValueError("too narrow")

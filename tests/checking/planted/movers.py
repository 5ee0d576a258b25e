"""Controllers, platforms and recoveries with a fault each."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from navloom import (
    Claim,
    ControllerInput,
    Odometry,
    PlatformInput,
    PlatformOutput,
    Pose2D,
    RangeScan,
    RecoveryInput,
    RecoveryStep,
    TrackingCommand,
    Twist2D,
)

from planted import Entries
from planted.sound import STILL, Dot, Pause, Proportional

ENTRIES = Entries()


def changed(answer: TrackingCommand, speed: float, turn: float) -> TrackingCommand:
    return replace(answer, twist=Twist2D(speed, 0.0, turn))


@ENTRIES.plant("turn_degrees", caught_by="limits")
class TurnDegrees(Proportional):
    def control(self, given: ControllerInput) -> TrackingCommand:
        answer = super().control(given)
        return changed(answer, answer.twist.vx, math.degrees(answer.twist.wz))


@ENTRIES.plant("error_degrees", caught_by="answers")
class ErrorDegrees(Proportional):
    """Its heading error in degrees."""

    def control(self, given: ControllerInput) -> TrackingCommand:
        answer = super().control(given)
        return replace(answer, e3=180.0 + math.degrees(answer.e3))


@ENTRIES.plant("turns_away", caught_by="settles")
class TurnsAway(Proportional):
    """The sign of its turn."""

    def control(self, given: ControllerInput) -> TrackingCommand:
        answer = super().control(given)
        return changed(answer, answer.twist.vx, -answer.twist.wz)


@ENTRIES.plant("right_bends", caught_by="settles")
class RightBends(Proportional):
    """Turns to the left only."""

    def control(self, given: ControllerInput) -> TrackingCommand:
        answer = super().control(given)
        return changed(answer, answer.twist.vx, max(0.0, answer.twist.wz))


@ENTRIES.plant("never_turns_in_place", caught_by="settles")
class NeverTurnsInPlace(Proportional):
    """Ignores turn_to."""

    def control(self, given: ControllerInput) -> TrackingCommand:
        return super().control(replace(given, reference=replace(given.reference, turn_to=None)))


@ENTRIES.plant("weak", caught_by="settles")
class Weak(Proportional):
    """Is so weak that it never reaches its reference."""

    def control(self, given: ControllerInput) -> TrackingCommand:
        answer = super().control(given)
        return changed(answer, answer.twist.vx, given.reference.turn_rate + 0.01 * answer.twist.wz)


@ENTRIES.plant("swings", caught_by="settles")
class Swings(Proportional):
    """Is so strong that it oscillates about its reference."""

    def control(self, given: ControllerInput) -> TrackingCommand:
        answer = super().control(given)
        return changed(answer, answer.twist.vx, math.copysign(1.0, answer.twist.wz + 4.0 * answer.e2 - answer.e3))


@ENTRIES.plant("left_handed", caught_by="mirror")
class LeftHanded(Proportional):
    claims = {Claim.MIRROR}

    def control(self, given: ControllerInput) -> TrackingCommand:
        answer = super().control(given)
        return changed(answer, answer.twist.vx, answer.twist.wz + 0.05)


@ENTRIES.plant("integrates", caught_by="reset_as_new")
class Integrates(Proportional):
    """Has an integral that reset does not clear."""

    sum = 0.0

    def control(self, given: ControllerInput) -> TrackingCommand:
        self.sum += given.reference.cross_track * self.context.period
        answer = super().control(given)
        return changed(answer, answer.twist.vx, answer.twist.wz - 0.1 * self.sum)


# --- platforms --------------------------------------------------------------------------------------------------------


@ENTRIES.plant("odometry_mm", caught_by="drives_as_told")
class OdometryMm(Dot):
    def odometry(self, given: PlatformInput, v: float, w: float) -> Odometry:
        return Odometry(given.time_ns, Pose2D(1000.0 * self.x, 1000.0 * self.y, self.heading), Twist2D(v, 0.0, w))


@ENTRIES.plant("turns_right", caught_by="drives_as_told")
class TurnsRight(Dot):
    """Counts angles clockwise."""

    def odometry(self, given: PlatformInput, v: float, w: float) -> Odometry:
        return Odometry(given.time_ns, Pose2D(self.x, -self.y, -self.heading), Twist2D(v, 0.0, -w))


@ENTRIES.plant("twist_degrees", caught_by="drives_as_told")
class TwistDegrees(Dot):
    def odometry(self, given: PlatformInput, v: float, w: float) -> Odometry:
        return Odometry(given.time_ns, Pose2D(self.x, self.y, self.heading), Twist2D(v, 0.0, math.degrees(w)))


@ENTRIES.plant("in_map_frame", caught_by="drives_as_told")
class InMapFrame(Dot):
    """Its odometry begins at the start in the map, not at 0."""

    def reset(self) -> None:
        start = self.context.start
        self.x, self.y, self.heading, self.time_ns = start.x + 1.0, start.y, start.heading, 0

    def odometry(self, given: PlatformInput, v: float, w: float) -> Odometry:
        return Odometry(given.time_ns, Pose2D(self.x, self.y, self.heading), Twist2D(v, 0.0, w))


@ENTRIES.plant("stands_still", caught_by="drives_as_told")
class StandsStill(Dot):
    def advance(self, given: PlatformInput) -> PlatformOutput:
        return super().advance(replace(given, command=STILL))


@ENTRIES.plant("clock_of_its_own", caught_by="answers")
class ClockOfItsOwn(Dot):
    """Stamps of the wall clock."""

    def odometry(self, given: PlatformInput, v: float, w: float) -> Odometry:
        return replace(super().odometry(given, v, w), stamp_ns=1_700_000_000_000_000_000 + given.time_ns)


@ENTRIES.plant("backwards", caught_by="answers")
class Backwards(Dot):
    """Stamps that run backwards."""

    def odometry(self, given: PlatformInput, v: float, w: float) -> Odometry:
        return replace(super().odometry(given, v, w), stamp_ns=max(0, 1_000_000_000 - given.time_ns))


@ENTRIES.plant("other_sensor", caught_by="answers")
class OtherSensor(Dot):
    """A scan of a sensor that the config does not have."""

    def advance(self, given: PlatformInput) -> PlatformOutput:
        answer = super().advance(given)
        return replace(answer, scans={**answer.scans, "lidar_2": self.scan(given)})


@ENTRIES.plant("no_contact_told", caught_by="answers")
class NoContactTold(Dot):
    def advance(self, given: PlatformInput) -> PlatformOutput:
        return replace(super().advance(given), contact=None)  # type: ignore[arg-type]


@ENTRIES.plant("slips", caught_by="repeats")
class Slips(Dot):
    """Adds noise that no seed determines."""

    def advance(self, given: PlatformInput) -> PlatformOutput:
        self.x += 1e-4 * float(np.random.default_rng().normal())
        return super().advance(given)


@ENTRIES.plant("keeps_place", caught_by="reset_as_new")
class KeepsPlace(Dot):
    """reset leaves the robot where it is."""

    is_made = False

    def reset(self) -> None:
        if not self.is_made:
            super().reset()
        self.is_made, self.time_ns = True, 0


@ENTRIES.plant("degree_bearings", caught_by="scan_geometry")
class DegreeBearings(Dot):
    """Bearings in degrees."""

    def scan(self, given: PlatformInput) -> RangeScan:
        scan = super().scan(given)
        return replace(scan, bearings=np.degrees(scan.bearings))


# --- recoveries -------------------------------------------------------------------------------------------------------


@ENTRIES.plant("backs_up", caught_by="no_contact")
class BacksUp(Pause):
    """Drives back 3 m, whatever is behind it."""

    def recover(self, given: RecoveryInput) -> RecoveryStep:
        if given.starts:
            self.until_ns = given.stamp_ns + 10_000_000_000
        is_over = given.stamp_ns >= self.until_ns
        return RecoveryStep(STILL if is_over else Twist2D(-0.3, 0.0, 0.0), "done" if is_over else "running", is_over)


@ENTRIES.plant("pushes_on", caught_by="no_contact")
class PushesOn(Pause):
    def recover(self, given: RecoveryInput) -> RecoveryStep:
        return replace(super().recover(given), twist=Twist2D(0.3, 0.0, 0.0))


@ENTRIES.plant("never_ends", caught_by="ends")
class NeverEnds(Pause):
    def recover(self, given: RecoveryInput) -> RecoveryStep:
        return RecoveryStep(STILL, "running", False)


@ENTRIES.plant("second_attempt", caught_by="ends")
class SecondAttempt(Pause):
    """Runs for ever when it is started a second time."""

    def recover(self, given: RecoveryInput) -> RecoveryStep:
        answer = super().recover(given)
        return replace(answer, state="running") if given.attempt > 1 else answer


@ENTRIES.plant("odd_state", caught_by="answers")
class OddState(Pause):
    def recover(self, given: RecoveryInput) -> RecoveryStep:
        return RecoveryStep(STILL, "finished", False)  # type: ignore[arg-type]

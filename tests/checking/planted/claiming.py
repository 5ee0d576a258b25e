"""Plugins that keep a property in one scene and break it in another: in bends, in reverse, late in a drive, turned."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from navloom import (
    Avoidance,
    AvoiderInput,
    ControllerInput,
    LocalizerInput,
    Pose2D,
    PoseEstimate,
    RecoveryInput,
    RecoveryStep,
    TrackingCommand,
    Twist2D,
)
from navloom_recoveries.adapter import Retrace
from navloom_scan_localizer.adapter import ScanMatching

from planted import Entries
from planted.sound import FromStart, Gap, Proportional

ENTRIES = Entries()


def faster(twist: Twist2D, share: float) -> Twist2D:
    return Twist2D(share * twist.vx, 0.0, share * twist.wz)


CACHE: dict[tuple[float, float], Twist2D] = {}


@ENTRIES.plant("cached_by_place", caught_by="fresh_process")
class CachedByPlace(Gap):
    """Keeps the first command at each place in the module, across episodes and objects."""

    def avoid(self, given: AvoiderInput) -> Avoidance:
        pose = given.estimate.pose
        key = (round(pose.x, 1), round(pose.y, 1))
        answer = super().avoid(given)
        return replace(answer, twist=CACHE.setdefault(key, answer.twist))


@ENTRIES.plant("reckless_in_bends", caught_by="limits")
class RecklessInBends(Proportional):
    """Exceeds the limits where the trajectory bends more than 1.5 /m."""

    def control(self, given: ControllerInput) -> TrackingCommand:
        answer, reference = super().control(given), given.reference
        bends = abs(reference.turn_rate) > 1.5 * reference.speed
        return replace(answer, twist=faster(answer.twist, 6.0)) if bends else answer


@ENTRIES.plant("reckless_to_the_right", caught_by="limits")
class RecklessToTheRight(Proportional):
    """Exceeds the limits in tight bends to the right only."""

    def control(self, given: ControllerInput) -> TrackingCommand:
        answer, reference = super().control(given), given.reference
        bends = reference.turn_rate < -0.9 * reference.speed
        return replace(answer, twist=faster(answer.twist, 6.0)) if bends else answer


@ENTRIES.plant("reckless_rolling_back", caught_by="limits")
class RecklessRollingBack(Proportional):
    """Brakes a robot that rolls back with a command far beyond the limits."""

    def control(self, given: ControllerInput) -> TrackingCommand:
        answer = super().control(given)
        return replace(answer, twist=Twist2D(3.0, 0.0, 0.0)) if given.estimate.twist.vx < -0.05 else answer


@ENTRIES.plant("avoider_rolling_back", caught_by="limits")
class AvoiderRollingBack(Gap):
    """The same, as an avoider."""

    def avoid(self, given: AvoiderInput) -> Avoidance:
        answer = super().avoid(given)
        return replace(answer, twist=Twist2D(3.0, 0.0, 0.0)) if given.estimate.twist.vx < -0.05 else answer


@ENTRIES.plant("fast_back", caught_by="limits")
class FastBack(Retrace):
    """Backs up ten times as fast once the robot moves back."""

    def recover(self, given: RecoveryInput) -> RecoveryStep:
        answer = super().recover(given)
        return replace(answer, twist=faster(answer.twist, 10.0)) if given.estimate.twist.vx < -0.05 else answer


@ENTRIES.plant("backs_beyond_limits", caught_by="limits")
class BacksBeyondLimits(Proportional):
    """Follows the trajectory well, and backs at three times the limit where it has passed its place on it."""

    def control(self, given: ControllerInput) -> TrackingCommand:
        answer = super().control(given)
        return replace(answer, twist=Twist2D(-3.0, 0.0, 0.0)) if given.estimate.twist.vx < 0.0 else answer


@ENTRIES.plant("reckless_after_minutes", caught_by="goes_on")
class RecklessAfterMinutes(Proportional):
    """Its integral winds up in a drive of five minutes."""

    steps = 0

    def reset(self) -> None:
        self.steps = 0

    def control(self, given: ControllerInput) -> TrackingCommand:
        self.steps += 1
        answer = super().control(given)
        return replace(answer, twist=faster(answer.twist, 1.0 if self.steps < 6000 else 8.0))


@ENTRIES.plant("degrees_after_minutes", caught_by="goes_on")
class DegreesAfterMinutes(Gap):
    """Turn rates become degrees a second after 150 s."""

    steps = 0

    def reset(self) -> None:
        self.steps = 0

    def avoid(self, given: AvoiderInput) -> Avoidance:
        self.steps += 1
        answer = super().avoid(given)
        return replace(answer, twist=Twist2D(0.0, 0.0, 57.3)) if self.steps > 3000 else answer


@ENTRIES.plant("fails_in_reverse", caught_by="answers")
class FailsInReverse(FromStart):
    """Takes the logarithm of the speed."""

    def localize(self, given: LocalizerInput) -> PoseEstimate:
        if given.odometry.twist.vx < 0.0:
            raise ValueError("math domain error")
        return super().localize(given)


@ENTRIES.plant("forward_only", caught_by="accurate")
class ForwardOnly(FromStart):
    """Integrates the way of the wheels without its sign."""

    last: Pose2D | None = None
    x = y = 0.0

    def reset(self) -> None:
        super().reset()
        self.last = None

    def localize(self, given: LocalizerInput) -> PoseEstimate:
        answer, odometry = super().localize(given), given.odometry.pose
        if self.last is None:
            self.x, self.y = answer.pose.x, answer.pose.y
        else:
            way = float(np.hypot(odometry.x - self.last.x, odometry.y - self.last.y))
            self.x += way * float(np.cos(answer.pose.heading))
            self.y += way * float(np.sin(answer.pose.heading))
        self.last = odometry
        return replace(answer, pose=Pose2D(self.x, self.y, answer.pose.heading))


@ENTRIES.plant("mostly_searching", caught_by="accurate")
class MostlySearching(FromStart):
    """Tracks in every sixth tick only, so that its pose is hardly ever a statement."""

    steps = 0

    def reset(self) -> None:
        super().reset()
        self.steps = 0

    def localize(self, given: LocalizerInput) -> PoseEstimate:
        self.steps += 1
        answer = super().localize(given)
        return answer if self.steps % 6 == 0 else replace(answer, state="searching", reason="few echoes")


class _Reordered(ScanMatching):
    order = (0, 1, 2)

    def localize(self, given: LocalizerInput) -> PoseEstimate:
        answer = super().localize(given)
        return replace(answer, covariance=answer.covariance[np.ix_(self.order, self.order)])


@ENTRIES.plant("variances_of_y_x", caught_by="covariance_turns")
class VariancesOfYX(_Reordered):
    order = (1, 0, 2)


@ENTRIES.plant("variances_of_heading_first", caught_by="covariance_turns")
class VariancesOfHeadingFirst(_Reordered):
    order = (2, 0, 1)


@ENTRIES.plant("variances_of_heading_and_x", caught_by="covariance_turns")
class VariancesOfHeadingAndX(_Reordered):
    order = (2, 1, 0)


@ENTRIES.plant("covariance_of_base", caught_by="covariance_turns")
class CovarianceOfBase(ScanMatching):
    """Gives the covariance in the base frame."""

    def localize(self, given: LocalizerInput) -> PoseEstimate:
        answer, heading = super().localize(given), 0.0
        heading = answer.pose.heading
        turn = np.array([[np.cos(heading), np.sin(heading), 0.0], [-np.sin(heading), np.cos(heading), 0.0], [0, 0, 1]])
        return replace(answer, covariance=turn @ answer.covariance @ turn.T)


@ENTRIES.plant("never_less_sure", caught_by="covariance_grows")
class NeverLessSure(FromStart):
    """Gives the covariance of its start for ever, though it reads the wheels alone."""

    def localize(self, given: LocalizerInput) -> PoseEstimate:
        return replace(super().localize(given), covariance=np.diag([1e-4, 1e-4, 1e-4]))

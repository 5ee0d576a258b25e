"""Retracing and looking around as navloom recoveries."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TypeVar

import numpy as np
from navloom import Context, RangeScan, Recovery, RecoveryInput, RecoveryStep, Twist2D
from navloom.geometry.echoes import beam_ends
from numpy.typing import NDArray

from navloom_recoveries.looking_around import LookingAround, LookRules, View
from navloom_recoveries.params import LookAroundParams, RetraceParams
from navloom_recoveries.retracing import Retracing, Rules
from navloom_recoveries.way_out import way_out

__all__ = ["LookAround", "Retrace"]

THIN = 0.02
"""Half angle below which a beam is a laser's, rad."""
BESIDE = 2
"""Number of neighbours on each side that a laser reading is averaged with."""
AGREEMENT = 0.1
"""Largest difference of two readings of the same surface, m."""


SEARCHING = "searching"
"""Reason of a goal whose localizer is not tracking."""
P = TypeVar("P", bound=RetraceParams)


class Retracer(Recovery[P]):
    """Drives out to where it can turn, or backs up along the trail, turns in place, and clears the map.

    It moves only as far as the scans allow.
    """

    accepts = (RangeScan,)

    def __init__(self, params: P, context: Context) -> None:
        super().__init__(params, context)
        robot = context.robot
        rules = Rules(
            distance=params.distance,
            speed=min(params.speed, robot.max_linear),
            deceleration=robot.max_deceleration,
            turn=math.radians(params.turn_deg),
            turn_rate=min(math.radians(params.turn_rate_deg), robot.max_angular),
            margin=params.margin,
            memory=params.memory,
            patience=params.patience,
            rest=params.wait,
            delay=robot.motor_lag + robot.dead_time,
            noise=params.noise,
        )
        self._retracing = Retracing(rules, robot.footprint)

    @classmethod
    def warm_up(cls) -> None:
        """Compile the search."""
        way_out(np.empty((0, 2)), np.zeros((4, 3)), 0.5, 0.03, 0.6, (True, True))

    def recover(self, given: RecoveryInput) -> RecoveryStep:
        place = given.estimate.pose
        pose, time = (place.x, place.y, place.heading), given.stamp_ns * 1e-9
        if given.starts:
            self._retracing.start(time, given.attempt, pose, given.trail)
        points, moving = [echoes(scan) for scan in given.scans], given.estimate.twist.vx
        v, w, is_over = self._retracing.step(time, pose, points, given.surfaces, moving)
        return RecoveryStep(Twist2D(v, 0.0, w), "done" if is_over else "running", is_over and self.params.clear_map)


class Retrace(Retracer[RetraceParams]):
    """Drives out to where it can turn, or backs up along the trail, turns in place, and clears the map."""

    name = "retrace"


class LookAround(Retracer[LookAroundParams]):
    """As `retrace`; and while the localizer searches, it turns round and drives on to where it has not been.

    It then works from scans and from the measured velocity alone: the pose is not known.
    """

    name = "look_around"
    looks_around = True

    def __init__(self, params: LookAroundParams, context: Context) -> None:
        super().__init__(params, context)
        robot = context.robot
        rules = LookRules(
            speed=min(params.look_speed, robot.max_linear),
            turn_rate=min(math.radians(params.turn_rate_deg), robot.max_angular),
            deceleration=robot.max_deceleration,
            leg=params.leg,
            time=params.look_time,
            way=params.look_way,
            margin=params.margin,
            noise=params.noise,
            memory=params.memory,
            delay=robot.motor_lag + robot.dead_time,
        )
        self._looking = LookingAround(rules, robot.footprint)

    def recover(self, given: RecoveryInput) -> RecoveryStep:
        if given.reason != SEARCHING:
            return super().recover(given)
        time, twist = given.stamp_ns * 1e-9, given.estimate.twist
        if given.starts:
            self._looking.start(time)
        v, w, is_over = self._looking.step(time, twist.vx, twist.wz, _views(given))
        return RecoveryStep(Twist2D(v, 0.0, w), "failed" if is_over else "running", False)


def _views(given: RecoveryInput) -> Iterator[View]:
    for scan in given.scans:
        yield View(scan.bearings, scan.half_angles, echoes(scan))


def echoes(scan: RangeScan) -> NDArray[np.float64]:
    """(k, 2) points of a scan's echoes, on the axes of its beams, m, base frame."""
    heard = scan.ranges < scan.range_max
    return beam_ends(scan.origins[heard], scan.bearings[heard], less_noisy(scan)[heard])


def less_noisy(scan: RangeScan) -> NDArray[np.float64]:
    """(n,) ranges, m: each laser reading averaged with the neighbours that agree with it; sonar readings unchanged.

    The nearest of many noisy readings is several standard deviations too near, and would block a free way.
    """
    if not len(scan.ranges) or (scan.half_angles >= THIN).any():
        return scan.ranges
    beside = np.arange(-BESIDE, BESIDE + 1)[:, None] + np.arange(len(scan.ranges))
    readings = np.where(scan.ranges < scan.range_max, scan.ranges, np.inf)[np.clip(beside, 0, len(scan.ranges) - 1)]
    with np.errstate(invalid="ignore"):  # a reading without an echo is infinite
        agree = np.abs(readings - scan.ranges) <= AGREEMENT
    count = agree.sum(axis=0)
    return np.where(count > 0, np.where(agree, readings, 0.0).sum(axis=0) / np.maximum(count, 1), scan.ranges)

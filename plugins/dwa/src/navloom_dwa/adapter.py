"""The dynamic window as a navloom avoider."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache

import numpy as np
from navloom import (
    Avoidance,
    Avoider,
    AvoiderDiagnostics,
    AvoiderInput,
    Claim,
    Context,
    Derived,
    Extra,
    RangeScan,
    RobotSpec,
    Tracks,
    Twist2D,
)
from navloom_avoidance.beams import Beams
from navloom_avoidance.bodies import TrackedBodies
from navloom_avoidance.certainty import THIN_BEAM
from navloom_avoidance.robot import Robot
from numpy.typing import NDArray

from navloom_dwa import warming
from navloom_dwa.avoidance import Decision, DynamicWindow, Given
from navloom_dwa.params import PRINTED, ROBUST, DwaParams
from navloom_dwa.view import arc_directions, cost_by_direction, free_directions, occupied_picture

__all__ = ["Dwa", "given_of", "split_scans"]


class Dwa(Avoider[DwaParams]):
    """Sends the best reachable velocity that can stop in time (Fox, Burgard & Thrun 1997; critics of Nav2's DWB)."""

    name = "dwa"
    presets = {"robust": ROBUST, "printed": PRINTED}
    claims = {Claim.FOOTPRINT, Claim.MIRROR}
    tracks = Extra(Tracks, optional=True)

    def __init__(self, params: DwaParams, context: Context) -> None:
        super().__init__(params, context)
        self._method = DynamicWindow(params, Robot.of(context.robot), context.period)

    def reset(self) -> None:
        self._method.reset()

    @classmethod
    def derived(cls, params: DwaParams, robot: RobotSpec, period: float) -> Mapping[str, Derived]:
        return {
            "max_speed": Derived(robot.max_linear, "max_linear"),
            "max_turn_deg": Derived(math.degrees(robot.max_angular), "max_angular"),
        }

    @classmethod
    def warm_up(cls) -> None:
        warming.warm_up()

    def avoid(self, given: AvoiderInput) -> Avoidance:
        lasers, cones = split_scans(given.scans)
        now = given_of(given, given.extra[self.tracks])
        decision = self._method.step(lasers, cones, now)
        why = self._diagnostics(decision, now) if self.is_to_explain(given.stamp_ns, decision.status) else None
        return Avoidance(Twist2D(decision.speed, 0.0, decision.turn), decision.status, why)

    def _diagnostics(self, decision: Decision, now: Given) -> AvoiderDiagnostics:
        """Diagnostics: the histogram is the least cost by direction of the arcs; 1 is a direction that is not free."""
        method, cell = self._method, self.params.cell
        directions = now.pose[2] + arc_directions(method.arcs)
        slots = free_directions(directions, method.costs)
        histogram = cost_by_direction(directions, method.costs, self.params.sectors)
        chosen = math.remainder(directions[decision.arc], math.tau) if decision.arc >= 0 else None
        return AvoiderDiagnostics(
            occupied_picture(method.distance), cell, float(method.origin[0]) * cell,
            float(method.origin[1]) * cell, histogram, 1.0, slots, chosen, method.why(decision),
        )  # fmt: skip


def given_of(given: AvoiderInput, tracks: Tracks | None) -> Given:
    """What a method that steers to a target needs of one tick, without the scans."""
    pose, twist = given.estimate.pose, given.estimate.twist
    return Given(
        given.stamp_ns * 1e-9, (pose.x, pose.y, pose.heading), (twist.vx, twist.wz),
        (given.target.x, given.target.y), given.remaining, given.share, TrackedBodies.of(tracks, given.stamp_ns),
    )  # fmt: skip


def is_laser(scan: RangeScan) -> bool:
    """Whether all beams of a scan are thin enough for a laser."""
    return bool((scan.half_angles < THIN_BEAM).all())


def beams_of(scan: RangeScan, sensor: int) -> Beams:
    """Convert one scan to beams; `sensor` is its number."""
    limits, sensors = _fixed(scan.ranges.size, scan.range_min, scan.range_max, sensor)
    return Beams(scan.origins, scan.bearings, scan.half_angles, scan.ranges, limits, sensors)


# Built once for each sensor: they are the same in every tick.
@lru_cache(maxsize=32)
def _fixed(count: int, low: float, high: float, sensor: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Constant data of a sensor: (count, 2) limits of its beams, m, and (count,) its number for each beam."""
    return np.tile([low, high], (count, 1)), np.full(count, sensor)


def split_scans(scans: Sequence[RangeScan]) -> tuple[list[Beams], Beams | None]:
    """Split scans into lasers and one set of all sonar beams (None without sonars); ignore scans without a beam."""
    lasers: list[Beams] = []
    sonars: list[Beams] = []
    for number, scan in enumerate(scans):
        if scan.ranges.size:
            (lasers if is_laser(scan) else sonars).append(beams_of(scan, number))
    # The usual case, without copies.
    if len(sonars) < 2:
        return lasers, sonars[0] if sonars else None
    parts = zip(*[(b.origins, b.bearings, b.half_angles, b.ranges, b.limits, b.sensors) for b in sonars], strict=True)
    return lasers, Beams.fixed(*[np.concatenate(part) for part in parts])

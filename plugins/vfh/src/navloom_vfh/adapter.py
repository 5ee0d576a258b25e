"""VFH, VFH+, VFH* and the swept VFH* as navloom avoiders."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TypeVar

import numpy as np
from navloom import (
    Avoidance,
    Avoider,
    AvoiderDiagnostics,
    AvoiderInput,
    Claim,
    Context,
    Derived,
    RobotSpec,
    Twist2D,
)
from navloom_avoidance.beams import Beams, Joiner
from navloom_avoidance.decision import Decision
from navloom_avoidance.robot import Robot
from navloom_avoidance.smoothing import warm_up_smoothing
from numpy.typing import NDArray

from navloom_vfh.avoidance import HistogramAvoidance
from navloom_vfh.methods import VfhAvoidance, VfhPlusAvoidance, VfhStarAvoidance
from navloom_vfh.params import (
    ROBUST,
    VFH_PLUS_PRINTED,
    VFH_PRINTED,
    VFH_STAR_PRINTED,
    HistogramParams,
    VfhParams,
    VfhPlusParams,
    VfhStarParams,
    VfhSweptParams,
)
from navloom_vfh.swept import VfhSweptAvoidance

__all__ = ["Vfh", "VfhPlus", "VfhStar", "VfhSwept"]

Floats = NDArray[np.float64]
WARM_UP_ROBOT = Robot(np.array([[0.4, 0.4], [-0.4, 0.4], [-0.4, -0.4], [0.4, -0.4]]), 0.5, 0.4, 0.5, 1.0)


P = TypeVar("P", bound=HistogramParams)


class _HistogramAvoider(Avoider[P]):
    """Avoider that runs any one of the methods."""

    _method: HistogramAvoidance
    _make: type

    def __init__(self, params: P, context: Context) -> None:
        super().__init__(params, context)
        self._method = self._make(params, Robot.of(context.robot), context.period)
        self._joiner = Joiner(self._method.common.agreement)

    def reset(self) -> None:
        self._method.reset()

    @classmethod
    def warm_up(cls) -> None:
        warm_up(cls._make(cls.Params(), WARM_UP_ROBOT, 0.05))
        warm_up_smoothing()

    def avoid(self, given: AvoiderInput) -> Avoidance:
        pose, twist, target = given.estimate.pose, given.estimate.twist, given.target
        beams = self._joiner.join(given.scans) if given.scans else None
        place = (pose.x, pose.y, pose.heading)
        self._method.remaining = given.remaining
        decision = self._method.step(beams, place, (twist.vx, twist.wz), (target.x, target.y), given.share)
        why = self._diagnostics(decision) if self.is_to_explain(given.stamp_ns, decision.status) else None
        return Avoidance(Twist2D(decision.speed, 0.0, decision.turn), decision.status, why)

    def _diagnostics(self, decision: Decision) -> AvoiderDiagnostics:
        method = self._method
        grid, origin = method.picture()
        cell, alpha = method.common.cell, 2.0 * math.pi / method.common.sectors
        slots = np.asarray(method.slots[: method.slot_count] * alpha, np.float64)
        slots[:, 1] += slots[:, 0]
        return AvoiderDiagnostics(
            grid, cell, float(origin[0]) * cell, float(origin[1]) * cell, method.density,
            method.threshold, slots, decision.direction, decision.why,
        )  # fmt: skip


class Vfh(_HistogramAvoider[VfhParams]):
    """Steers through the valley of the polar histogram nearest to the target (Borenstein & Koren 1991)."""

    name = "vfh"
    presets = {"robust": ROBUST, "printed": VFH_PRINTED}
    claims = {Claim.FOOTPRINT, Claim.MIRROR, Claim.STOPS_WHEN_CLOSED}
    _make = VfhAvoidance


class VfhPlus(_HistogramAvoider[VfhPlusParams]):
    """Steers to the cheapest opening that the robot's size and turning circle allow (Ulrich & Borenstein 1998)."""

    name = "vfh_plus"
    presets = {"robust": ROBUST, "printed": VFH_PLUS_PRINTED}
    claims = {Claim.FOOTPRINT, Claim.MIRROR, Claim.STOPS_WHEN_CLOSED}
    _make = VfhPlusAvoidance


class VfhStar(_HistogramAvoider[VfhStarParams]):
    """Steers to the opening with the cheapest path beyond it, found by A* look-ahead (Ulrich & Borenstein 2000)."""

    name = "vfh_star"
    presets = {"robust": ROBUST, "printed": VFH_STAR_PRINTED}
    claims = {Claim.MIRROR, Claim.STOPS_WHEN_CLOSED}
    _make = VfhStarAvoidance


class VfhSwept(_HistogramAvoider[VfhSweptParams]):
    """Drives VFH*'s way at the speed from which the swept footprint stops before what is on its arc."""

    name = "vfh_swept"
    presets = {"robust": ROBUST}
    claims = {Claim.FOOTPRINT, Claim.MIRROR, Claim.STOPS_WHEN_CLOSED}
    _make = VfhSweptAvoidance

    @classmethod
    def derived(cls, params: VfhSweptParams, robot: RobotSpec, period: float) -> Mapping[str, Derived]:
        return {
            "max_speed": Derived(robot.max_linear, "max_linear"),
            "max_turn_deg": Derived(math.degrees(robot.max_angular), "max_angular"),
        }

    @classmethod
    def warm_up(cls) -> None:
        super().warm_up()
        bearings = np.array([-0.3, 0.0, 0.3])
        limits, sensors = np.tile([0.0, 8.0], (3, 1)), np.zeros(3, np.int64)
        laser = Beams.fixed(np.zeros((3, 2)), bearings, np.zeros(3), np.ones(3), limits, sensors)
        method = VfhSweptAvoidance(VfhSweptParams(), WARM_UP_ROBOT, 0.05)
        for _ in range(2):
            method.step(laser, (0.0, 0.0, 0.0), (0.0, 0.0), (3.0, 0.0))
        method.can_stop((0.0, 0.0), (0.1, 0.0))


def warm_up(method: HistogramAvoidance) -> None:
    """Compile every kernel for the types of one tick, with an occupied cell ahead so that every stage runs."""
    method.step(Beams.sample(), (0.0, 0.0, 0.0), (0.0, 0.0), (3.0, 0.0))

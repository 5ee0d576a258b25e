"""The VFF as a navloom avoider."""

from __future__ import annotations

import numpy as np
from navloom import Avoidance, Avoider, AvoiderDiagnostics, AvoiderInput, Context, RangeScan, Twist2D

from navloom_vff import avoidance
from navloom_vff.avoidance import Beams, Decision, ForceField, Robot
from navloom_vff.params import VffParams

__all__ = ["Vff"]

NO_SLOTS = np.zeros((0, 2))
NO_SLOTS.flags.writeable = False


class Vff(Avoider):
    """Pulled by the target and pushed off by what range sensors see (Borenstein & Koren 1989)."""

    name = "vff"
    Params = VffParams

    def __init__(self, params: VffParams, context: Context) -> None:
        super().__init__(params, context)
        r = context.robot
        robot = Robot(
            r.footprint, r.max_linear, r.max_angular, r.max_acceleration, r.max_deceleration, r.motor_lag, r.dead_time
        )  # fmt: skip
        self._method = ForceField(params, robot, context.period)
        self._limits: dict[tuple[tuple[int, float, float], ...], np.ndarray] = {}

    def reset(self) -> None:
        self._method.reset()

    @classmethod
    def warm_up(cls) -> None:
        avoidance.warm_up(VffParams())

    def avoid(self, given: AvoiderInput) -> Avoidance:
        pose, twist, target = given.estimate.pose, given.estimate.twist, given.target
        beams = self._beams(given.scans) if given.scans else None
        place = (pose.x, pose.y, pose.heading)
        decision = self._method.step(beams, place, (twist.vx, twist.wz), (target.x, target.y), given.share)
        why = self._diagnostics(decision) if self.is_to_explain(given.stamp_ns, decision.status) else None
        return Avoidance(Twist2D(decision.speed, 0.0, decision.turn), decision.status, why)

    def _beams(self, scans: tuple[RangeScan, ...]) -> Beams:
        """All beams of this tick in one set; their limits do not change from scan to scan and are made once."""
        key = tuple([(len(scan.ranges), scan.range_min, scan.range_max) for scan in scans])
        limits = self._limits.get(key)
        if limits is None:
            limits = np.array([(low, high) for n, low, high in key for _ in range(n)]).reshape(-1, 2)
            self._limits[key] = limits
        if len(scans) == 1:
            scan = scans[0]
            return Beams(scan.origins, scan.bearings, scan.half_angles, scan.ranges, limits)
        return Beams(
            np.concatenate([scan.origins for scan in scans]),
            np.concatenate([scan.bearings for scan in scans]),
            np.concatenate([scan.half_angles for scan in scans]),
            np.concatenate([scan.ranges for scan in scans]),
            limits,
        )

    def _diagnostics(self, decision: Decision) -> AvoiderDiagnostics:
        """The force by direction stands for the histogram; its threshold is the pull of the target."""
        method, cell = self._method, self.params.cell
        return AvoiderDiagnostics(
            method.grid, cell, float(method.origin[0]) * cell, float(method.origin[1]) * cell, method.histogram, 1.0,
            NO_SLOTS, decision.direction, decision.why,
        )  # fmt: skip

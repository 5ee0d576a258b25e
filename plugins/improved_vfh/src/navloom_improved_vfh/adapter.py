"""The improved VFH as a navloom avoider."""

from __future__ import annotations

import math

import numpy as np
from navloom import Avoidance as Answer
from navloom import Avoider, AvoiderDiagnostics, AvoiderInput, Context, RangeScan, Twist2D

from navloom_improved_vfh import avoidance
from navloom_improved_vfh.avoidance import Avoidance, Beams, Decision, Robot
from navloom_improved_vfh.certainty import THIN_BEAM
from navloom_improved_vfh.params import ImprovedVfhParams
from navloom_improved_vfh.smoothing import smoothed, warm_up_smoothing

__all__ = ["ImprovedVfh", "less_noisy"]


class ImprovedVfh(Avoider):
    """Steers round what range sensors see, towards the target (Hoang et al. 2013, III.C)."""

    name = "improved_vfh"
    Params = ImprovedVfhParams

    def __init__(self, params: ImprovedVfhParams, context: Context) -> None:
        super().__init__(params, context)
        r = context.robot
        robot = Robot(
            r.footprint, r.max_linear, r.max_angular, r.max_acceleration, r.max_deceleration, r.motor_lag, r.dead_time
        )  # fmt: skip
        self._method = Avoidance(params, robot, context.period)
        self._fixed: dict[tuple[tuple[int, float, float], ...], tuple[np.ndarray, np.ndarray]] = {}

    def reset(self) -> None:
        self._method.reset()

    @classmethod
    def warm_up(cls) -> None:
        avoidance.warm_up(ImprovedVfhParams())
        warm_up_smoothing()

    def avoid(self, given: AvoiderInput) -> Answer:
        pose, target = given.estimate.pose, given.target
        beams = self._beams(given.scans) if given.scans else None
        place = (pose.x, pose.y, pose.heading)
        twist = given.estimate.twist
        decision = self._method.step(beams, place, (twist.vx, twist.wz), (target.x, target.y), given.share)
        why = self._diagnostics(decision) if self.is_to_explain(given.stamp_ns, decision.status) else None
        return Answer(Twist2D(decision.speed, 0.0, decision.turn), decision.status, why)

    def _beams(self, scans: tuple[RangeScan, ...]) -> Beams:
        """All beams of this tick in one set; what does not change from scan to scan is made once."""
        key = tuple((len(scan.ranges), scan.range_min, scan.range_max) for scan in scans)
        if key not in self._fixed:
            limits = np.array([(low, high) for n, low, high in key for _ in range(n)]).reshape(-1, 2)
            self._fixed[key] = limits, np.repeat(np.arange(len(key)), [n for n, _, _ in key])
        limits, sensors = self._fixed[key]
        # Copies even of a single scan: numba would compile once more for read-only arrays, in the first tick.
        return Beams(
            np.concatenate([scan.origins for scan in scans]),
            np.concatenate([scan.bearings for scan in scans]),
            np.concatenate([scan.half_angles for scan in scans]),
            np.concatenate([less_noisy(scan, self.params.agreement) for scan in scans]),
            limits,
            sensors,
        )

    def _diagnostics(self, decision: Decision) -> AvoiderDiagnostics:
        p, method = self.params, self._method
        alpha = 2.0 * math.pi / p.sectors
        slots = np.zeros((method.slot_count, 2))
        slots[:, 0] = method.slots[: method.slot_count, 0] * alpha
        slots[:, 1] = slots[:, 0] + method.slots[: method.slot_count, 1] * alpha
        corner = method.origin * method.cell
        return AvoiderDiagnostics(
            method.grid, method.cell, float(corner[0]), float(corner[1]), method.density, p.threshold,
            slots, decision.direction, decision.why,
        )  # fmt: skip


def less_noisy(scan: RangeScan, agreement: float) -> np.ndarray:
    """Ranges of a scan, m; those of a laser averaged as in smoothing.smoothed() where `agreement`, m, is not 0."""
    if agreement == 0.0 or not (scan.half_angles < THIN_BEAM).all():
        return scan.ranges
    return smoothed(scan.ranges, scan.range_max, agreement)

"""The improved VFH as a navloom avoider."""

from __future__ import annotations

import math

import numpy as np
from navloom import Avoidance as Answer
from navloom import Avoider, AvoiderDiagnostics, AvoiderInput, Claim, Context, Twist2D
from navloom_avoidance.beams import Joiner
from navloom_avoidance.decision import Decision
from navloom_avoidance.robot import Robot
from navloom_avoidance.smoothing import warm_up_smoothing

from navloom_improved_vfh import avoidance
from navloom_improved_vfh.avoidance import Avoidance
from navloom_improved_vfh.params import PRINTED, ROBUST, ImprovedVfhParams

__all__ = ["ImprovedVfh"]


class ImprovedVfh(Avoider[ImprovedVfhParams]):
    """Steers around the obstacles that range sensors see, towards the target (Hoang et al. 2013, III.C)."""

    name = "improved_vfh"
    presets = {"robust": ROBUST, "printed": PRINTED}
    claims = {Claim.FOOTPRINT, Claim.MIRROR}

    def __init__(self, params: ImprovedVfhParams, context: Context) -> None:
        super().__init__(params, context)
        self._method = Avoidance(params, Robot.of(context.robot), context.period)
        self._joiner = Joiner(params.agreement)

    def reset(self) -> None:
        self._method.reset()

    @classmethod
    def warm_up(cls) -> None:
        avoidance.warm_up(ImprovedVfhParams())
        warm_up_smoothing()

    def avoid(self, given: AvoiderInput) -> Answer:
        pose, target = given.estimate.pose, given.target
        beams = self._joiner.join(given.scans) if given.scans else None
        place = (pose.x, pose.y, pose.heading)
        twist = given.estimate.twist
        decision = self._method.step(beams, place, (twist.vx, twist.wz), (target.x, target.y), given.share)
        why = self._diagnostics(decision) if self.is_to_explain(given.stamp_ns, decision.status) else None
        return Answer(Twist2D(decision.speed, 0.0, decision.turn), decision.status, why)

    def _diagnostics(self, decision: Decision) -> AvoiderDiagnostics:
        p, method = self.params, self._method
        alpha = 2.0 * math.pi / p.sectors
        slots = np.zeros((method.slot_count, 2))
        slots[:, 0] = method.slots[: method.slot_count, 0] * alpha
        slots[:, 1] = slots[:, 0] + method.slots[: method.slot_count, 1] * alpha
        corner = method.origin * method.cell
        return AvoiderDiagnostics(
            method.grid, method.cell, float(corner[0]), float(corner[1]), method.density, method.threshold,
            slots, decision.direction, decision.why,
        )  # fmt: skip

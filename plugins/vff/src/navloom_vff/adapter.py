"""The VFF as a navloom avoider."""

from __future__ import annotations

import numpy as np
from navloom import Avoidance, Avoider, AvoiderDiagnostics, AvoiderInput, Claim, Context, Twist2D
from navloom_avoidance.beams import Joiner
from navloom_avoidance.decision import Decision
from navloom_avoidance.robot import Robot

from navloom_vff import avoidance
from navloom_vff.avoidance import ForceField
from navloom_vff.params import PRINTED, ROBUST, VffParams

__all__ = ["Vff"]

# A force field has no free slots, but the message has a place for them.
NO_SLOTS = np.zeros((0, 2))
NO_SLOTS.flags.writeable = False


class Vff(Avoider[VffParams]):
    """Steers by the pull of the target and the push of obstacles in the range scans (Borenstein & Koren 1989)."""

    name = "vff"
    presets = {"robust": ROBUST, "printed": PRINTED}
    claims = {Claim.STOPS_WHEN_CLOSED}

    def __init__(self, params: VffParams, context: Context) -> None:
        super().__init__(params, context)
        self._method = ForceField(params, Robot.of(context.robot), context.period)
        # 0: no averaging of echoes, which the paper does not have.
        self._joiner = Joiner(0.0)

    def reset(self) -> None:
        self._method.reset()

    @classmethod
    def warm_up(cls) -> None:
        avoidance.warm_up(VffParams())

    def avoid(self, given: AvoiderInput) -> Avoidance:
        pose, twist, target = given.estimate.pose, given.estimate.twist, given.target
        beams = self._joiner.join(given.scans) if given.scans else None
        place = (pose.x, pose.y, pose.heading)
        decision = self._method.step(beams, place, (twist.vx, twist.wz), (target.x, target.y), given.share)
        why = self._diagnostics(decision) if self.is_to_explain(given.stamp_ns, decision.status) else None
        return Avoidance(Twist2D(decision.speed, 0.0, decision.turn), decision.status, why)

    def _diagnostics(self, decision: Decision) -> AvoiderDiagnostics:
        """Diagnostics: the histogram is the force by direction, and its threshold is the pull of the target."""
        method, cell = self._method, self.params.cell
        return AvoiderDiagnostics(
            method.grid, cell, float(method.origin[0]) * cell, float(method.origin[1]) * cell, method.histogram, 1.0,
            NO_SLOTS, decision.direction, decision.why,
        )  # fmt: skip

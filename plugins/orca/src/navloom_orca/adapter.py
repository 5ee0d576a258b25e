"""Optimal reciprocal collision avoidance as a navloom avoider."""

from __future__ import annotations

import math

import numpy as np
from navloom import Avoidance, Avoider, AvoiderDiagnostics, AvoiderInput, Claim, Context, Extra, Tracks, Twist2D
from navloom_avoidance.robot import Robot
from navloom_dwa.adapter import given_of, split_scans
from navloom_dwa.avoidance import Given
from navloom_dwa.view import points_picture

from navloom_orca import warming
from navloom_orca.avoidance import Decision, Reciprocal
from navloom_orca.params import RECIPROCAL, ROBUST, OrcaParams

__all__ = ["Orca"]


class Orca(Avoider[OrcaParams]):
    """Takes the velocity nearest to the wanted one that keeps clear of tracks and echoes (van den Berg et al. 2011)."""

    name = "orca"
    presets = {"robust": ROBUST, "reciprocal": RECIPROCAL}
    claims = {Claim.FOOTPRINT, Claim.MIRROR, Claim.TRANSLATION, Claim.ROTATION, Claim.STOPS_WHEN_CLOSED}
    tracks = Extra(Tracks, optional=True)

    def __init__(self, params: OrcaParams, context: Context) -> None:
        super().__init__(params, context)
        self._method = Reciprocal(params, Robot.of(context.robot), context.period)

    def reset(self) -> None:
        self._method.reset()

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
        """Diagnostics: the histogram is the violation by direction at the wanted speed, per this speed, up to 1."""
        method, heading, count = self._method, now.pose[2], self.params.sectors
        directions = (np.arange(count) + 0.5) * 2.0 * math.pi / count
        speed = max(math.hypot(*method.wanted), 0.1)
        velocities = speed * np.column_stack([np.cos(directions - heading), np.sin(directions - heading)])
        histogram = (method.violations(velocities) / speed).clip(max=1.0)
        chosen = math.remainder(heading + math.atan2(*reversed(method.taken)), math.tau)
        window, cell, x, y = points_picture(method.obstacles, now.pose, method.sight)
        return AvoiderDiagnostics(
            window, cell, x, y, histogram, 1.0, np.empty((0, 2)), None if decision.status == "trapped" else chosen,
            decision.why,
        )  # fmt: skip

"""The dynamic window as a navloom avoider."""

from __future__ import annotations

import math

from navloom import Avoidance, Avoider, AvoiderDiagnostics, AvoiderInput, Context, Twist2D

from navloom_dwa import warming
from navloom_dwa.avoidance import Decision, DynamicWindow, Given, Robot
from navloom_dwa.beams import split_scans
from navloom_dwa.params import DwaParams
from navloom_dwa.view import arc_directions, cost_by_direction, free_directions, occupied_picture

__all__ = ["Dwa"]


class Dwa(Avoider):
    """The best velocity that can be reached and stopped in time (Fox, Burgard & Thrun 1997; critics of Nav2's DWB)."""

    name = "dwa"
    Params = DwaParams

    def __init__(self, params: DwaParams, context: Context) -> None:
        super().__init__(params, context)
        r = context.robot
        robot = Robot(r.footprint, r.half_track, r.max_linear, r.max_angular, r.max_acceleration, r.max_deceleration)
        self._method = DynamicWindow(params, robot, context.period)

    def reset(self) -> None:
        self._method.reset()

    @classmethod
    def warm_up(cls) -> None:
        warming.warm_up()

    def avoid(self, given: AvoiderInput) -> Avoidance:
        pose, twist = given.estimate.pose, given.estimate.twist
        lasers, cones = split_scans(given.scans)
        now = Given(
            given.stamp_ns * 1e-9, (pose.x, pose.y, pose.heading), (twist.vx, twist.wz),
            (given.target.x, given.target.y), given.remaining,
        )  # fmt: skip
        decision = self._method.step(lasers, cones, now)
        return Avoidance(Twist2D(decision.speed, 0.0, decision.turn), decision.status, self._diagnostics(decision, now))

    def _diagnostics(self, decision: Decision, now: Given) -> AvoiderDiagnostics:
        """The costs by the direction their arcs lead in stand for the histogram; 1 is what cannot be driven."""
        method, cell = self._method, self.params.cell
        directions = now.pose[2] + arc_directions(method.arcs)
        slots = free_directions(directions, method.costs)
        histogram = cost_by_direction(directions, method.costs, self.params.sectors)
        chosen = math.remainder(directions[decision.arc], math.tau) if decision.arc >= 0 else None
        return AvoiderDiagnostics(
            occupied_picture(method.distance), cell, float(method.origin[0]) * cell,
            float(method.origin[1]) * cell, histogram, 1.0, slots, chosen, decision.why,
        )  # fmt: skip

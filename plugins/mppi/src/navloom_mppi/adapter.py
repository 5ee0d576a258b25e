"""Model predictive path integral control as a navloom avoider."""

from __future__ import annotations

import math
from collections.abc import Mapping

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
    Reference,
    RobotSpec,
    Rollouts,
    Tracks,
    Trajectory,
    Twist2D,
)
from navloom_avoidance.bodies import TrackedBodies
from navloom_avoidance.robot import Robot
from navloom_dwa.adapter import split_scans
from navloom_dwa.view import cost_by_direction, in_map, points_picture

from navloom_mppi import warming
from navloom_mppi.control import Decision, Given, PathIntegral
from navloom_mppi.critics import COLLISION, CRITICS
from navloom_mppi.motion import near_goal
from navloom_mppi.params import ROBUST, MppiParams

__all__ = ["Mppi"]


class Mppi(Avoider[MppiParams]):
    """Follows the path by the weighted mean of random motions (Williams et al. 2017; critics of Nav2's MPPI)."""

    name = "mppi"
    presets = {"robust": ROBUST}
    claims = {Claim.FOOTPRINT, Claim.MIRROR, Claim.TRANSLATION, Claim.ROTATION}
    trajectory = Extra(Trajectory)
    reference = Extra(Reference)
    tracks = Extra(Tracks, optional=True)

    def __init__(self, params: MppiParams, context: Context) -> None:
        super().__init__(params, context)
        self._method = PathIntegral(params, Robot.of(context.robot), context.period, context.stream("noise"))

    def reset(self) -> None:
        self._method.reset()

    @classmethod
    def derived(cls, params: MppiParams, robot: RobotSpec, period: float) -> Mapping[str, Derived]:
        source = "footprint, max_linear, max_deceleration, motor_lag, dead_time and period"
        return {
            "goal_within": Derived(near_goal(Robot.of(robot), period), source),
            "turning_radius": Derived(robot.turn_radius, "drive"),
        }

    @classmethod
    def warm_up(cls) -> None:
        warming.warm_up()

    def avoid(self, given: AvoiderInput) -> Avoidance:
        pose, twist = given.estimate.pose, given.estimate.twist
        reference, samples = given.extra[self.reference], given.extra[self.trajectory].samples
        # A trajectory is published before the reference on it; their numbers differ in no tick.
        left = samples[min(int(np.searchsorted(samples[:, 0], reference.progress)), len(samples) - 1) :]
        # Up to the next cusp: what comes after it leads back.
        turned = np.flatnonzero(left[:, 5] * left[0, 5] < 0.0)
        left = left[: int(turned[0]) if len(turned) else None, 1:3]
        lasers, cones = split_scans(given.scans)
        now = Given(
            given.stamp_ns * 1e-9, (pose.x, pose.y, pose.heading), (twist.vx, twist.wz), left, reference.turn_to,
            given.share, TrackedBodies.of(given.extra[self.tracks], given.stamp_ns),
        )  # fmt: skip
        self._pose = now.pose
        decision = self._method.step(lasers, cones, now)
        why = self._diagnostics(decision, now) if self.is_to_explain(given.stamp_ns, decision.status) else None
        return Avoidance(Twist2D(decision.speed, 0.0, decision.turn), decision.status, why)

    def rollouts(self) -> Rollouts:
        shown, pose = self._method.drawn(), self._pose
        points = in_map(shown.points, pose).astype(np.float32)
        return Rollouts(points, shown.costs, in_map(shown.plan, pose).astype(np.float32), CRITICS, shown.critics)

    def _diagnostics(self, decision: Decision, now: Given) -> AvoiderDiagnostics:
        """Diagnostics: the histogram is the least cost by direction of the roll-outs; 1 is a direction without one."""
        method, heading = self._method, now.pose[2]
        directions = heading + method.ends
        free = np.where(method.parts[:, COLLISION] > 0.0, np.inf, method.costs)
        histogram = cost_by_direction(directions, free[:, None], self.params.sectors)
        chosen = None if decision.status == "trapped" else math.remainder(heading + method.direction(), math.tau)
        window, cell, x, y = points_picture(method.scene.obstacles, now.pose, method.reach)
        return AvoiderDiagnostics(window, cell, x, y, histogram, 1.0, np.empty((0, 2)), chosen, decision.why)

"""Law (6) as a navloom controller."""

from __future__ import annotations

import math

from navloom import Claim, Context, Controller, ControllerInput, TrackingCommand, Twist2D

from navloom_lyapunov_tracker.law import (
    final_turn,
    planar_command,
    stopping_turn,
    tracking_command,
    tracking_error,
    turn_acceleration,
    turn_direction,
    turn_that_stops,
    wrap,
)
from navloom_lyapunov_tracker.params import PRINTED, ROBUST, LyapunovTrackerParams

__all__ = ["LyapunovTracker"]


class LyapunovTracker(Controller[LyapunovTrackerParams]):
    """Follows the re-projected reference with the law of Hoang et al. 2013, eq. (6)."""

    name = "lyapunov_tracker"
    presets = {"robust": ROBUST, "printed": PRINTED}
    claims = {Claim.TRANSLATION, Claim.ROTATION, Claim.MIRROR}

    def __init__(self, params: LyapunovTrackerParams, context: Context) -> None:
        super().__init__(params, context)
        # Steered wheels cannot turn the robot in place.
        above = params.turn_in_place_above_deg if context.robot.turn_radius == 0.0 else 180.0
        self._above = math.radians(above)
        self._until = math.radians(params.turn_in_place_until_deg)
        self._turning = 0

    def reset(self) -> None:
        self._turning = 0

    def control(self, given: ControllerInput) -> TrackingCommand:
        pose, reference, robot = given.estimate.pose, given.reference, self.context.robot
        limits = (robot.max_angular, robot.max_angular_acceleration)
        if reference.turn_to is not None:
            e3 = wrap(reference.turn_to - pose.heading)
            return TrackingCommand(Twist2D(0.0, 0.0, final_turn(e3, *limits)), 0.0, 0.0, e3)
        target = reference.pose
        error = tracking_error(pose.x, pose.y, pose.heading, target.x, target.y, target.heading)
        side = 0.0
        self._turning = turn_direction(error.e3, self._turning, self._above, self._until)
        if self._turning:
            v, w = 0.0, self._turning * turn_that_stops(error.e3, *limits)
        elif robot.drive == "holonomic":
            velocity = (reference.speed, reference.lateral_speed)
            v, side, w = planar_command(error, velocity, reference.turn_rate, self.params.k1, self.params.k3)
        else:
            k3, v_ref, w_ref = self.params.k3, reference.speed, reference.turn_rate
            if robot.turn_radius > 0.0:
                # Slowly, the same turn takes more steering: without this, a crawling robot would steer to and fro.
                k3 = min(k3, 2.0 * abs(v_ref) / robot.turn_radius)
            v, w = tracking_command(error, v_ref, w_ref, self.params.k1, k3)
            fastest = robot.max_angular_acceleration
            fastest = turn_acceleration(v_ref, fastest, robot.wheelbase, robot.max_steering_rate)
            w = stopping_turn(w, w_ref, k3, fastest)
        return TrackingCommand(Twist2D(v, side, w), *error)

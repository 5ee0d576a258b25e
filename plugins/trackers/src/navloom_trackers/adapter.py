"""Six tracking laws as navloom controllers."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import replace
from typing import TypeVar

from navloom import (
    Claim,
    Context,
    Controller,
    ControllerInput,
    InputError,
    Pose2D,
    TrackingCommand,
    Trajectory,
    Twist2D,
)
from navloom.geometry.footprints import inscribed_radius
from navloom_lyapunov_tracker.law import (
    TrackingError,
    final_turn,
    stopping_turn,
    tracking_error,
    turn_acceleration,
    turn_direction,
    turn_that_stops,
    wrap,
)

from navloom_trackers import derived, fierro_lewis, graceful, kanayama, pure_pursuit, ramsete
from navloom_trackers.branches import Branch, branch_at, branches_of
from navloom_trackers.limits import DriveLimits, stiffest, within_limits, within_reach
from navloom_trackers.params import (
    DERIVED,
    FIERRO_LEWIS_PRINTED,
    GRACEFUL_PRINTED,
    KANAYAMA_PRINTED,
    PURE_PURSUIT_PRINTED,
    RAMSETE_PRINTED,
    ROBUST,
    FierroLewisParams,
    GracefulParams,
    KanayamaParams,
    PurePursuitParams,
    RamseteParams,
    RegulatedPurePursuitParams,
    TrackerParams,
)

__all__ = ["FierroLewis", "Graceful", "Kanayama", "PurePursuit", "Ramsete", "RegulatedPurePursuit"]


P = TypeVar("P", bound=TrackerParams)
Wanted = tuple[float, tuple[float, float], float]
"""Direction to face, rad from the heading in [-π, π); a law's velocity, m/s and rad/s; its gain of the heading, 1/s."""


class _Tracker(Controller[P]):
    """Controller that turns in place where needed, else follows its tracking law, within the limits of the drive."""

    claims = {Claim.TRANSLATION, Claim.ROTATION, Claim.MIRROR}

    def __init__(self, params: P, context: Context) -> None:
        super().__init__(params, context)
        robot = context.robot
        # Steered wheels cannot turn the robot in place.
        above = params.turn_in_place_above_deg if robot.turn_radius == 0.0 else 180.0
        self._above = math.radians(above)
        self._until = math.radians(params.turn_in_place_until_deg)
        shape = (robot.wheel_radius, robot.half_track)
        wheel = math.inf if params.max_wheel_speed is None else params.max_wheel_speed
        self._limits = DriveLimits(robot.max_linear, robot.max_angular, wheel, *shape, params.may_reverse)
        self._stiffest = stiffest(robot.turn_radius)
        # Hysteresis needs a memory: at one threshold the robot would switch between turning and driving.
        self._turning = 0
        self._followed: Trajectory | None = None
        self._branches: list[Branch] = []

    def reset(self) -> None:
        self._turning = 0

    def control(self, given: ControllerInput) -> TrackingCommand:
        pose, reference = given.estimate.pose, given.reference
        limits, sign = (self.context.robot.max_angular, self.context.robot.max_angular_acceleration), 1.0
        if reference.turn_to is not None:
            error = TrackingError(0.0, 0.0, wrap(reference.turn_to - pose.heading))
            wanted = (0.0, final_turn(error.e3, *limits))
        else:
            if reference.lateral_speed != 0.0:
                raise InputError(
                    f"{self.name}: got a reference that drives sideways at {reference.lateral_speed:.2f} m/s, expected "
                    "one that drives along its heading: take lyapunov_tracker for paths with other headings"
                )
            given, sign = self._along_way(given)
            pose, reference = given.estimate.pose, given.reference
            target = reference.pose
            error = tracking_error(pose.x, pose.y, pose.heading, target.x, target.y, target.heading)
            bearing, (v, w), gain = self._follow(given, error)
            robot, v_ref = self.context.robot, reference.speed
            fastest = turn_acceleration(v_ref, limits[1], robot.wheelbase, robot.max_steering_rate)
            wanted = (v, stopping_turn(w, reference.turn_rate, gain, fastest))
            self._turning = turn_direction(bearing, self._turning, self._above, self._until)
            # The turn in place replaces the law, which would drive away from the path at such an angle.
            if self._turning:
                wanted = (0.0, self._turning * turn_that_stops(bearing, *limits))
        v, w = within_limits(*wanted, self._limits)
        return TrackingCommand(Twist2D(sign * v, 0.0, w), sign * error.e1, sign * error.e2, error.e3)

    def _along_way(self, given: ControllerInput) -> tuple[ControllerInput, float]:
        """The input as it is for a robot that heads along its way, and the sign of its speed: -1 backwards.

        The trajectory is then the branch of the reference only, and progress and remaining length are those on it.
        """
        reference, estimate = given.reference, given.estimate
        if given.trajectory is not self._followed:
            self._followed, self._branches = given.trajectory, branches_of(given.trajectory.samples)
        if len(self._branches) == 1 and reference.speed > 0.0:
            return given, 1.0
        sign = math.copysign(1.0, reference.speed)
        branch = branch_at(self._branches, reference.progress, sign)
        progress, left = max(reference.progress - branch.begin, 0.0), max(branch.end - reference.progress, 0.0)
        reference = replace(reference, progress=progress, remaining=left, speed=abs(reference.speed))
        if sign < 0.0:
            back = Twist2D(-estimate.twist.vx, -estimate.twist.vy, estimate.twist.wz)
            reference = replace(reference, pose=_turned(reference.pose))
            estimate = replace(estimate, pose=_turned(estimate.pose), twist=back)
        trajectory = replace(given.trajectory, samples=branch.samples)
        return replace(given, reference=reference, estimate=estimate, trajectory=trajectory), sign

    @abstractmethod
    def _follow(self, given: ControllerInput, error: TrackingError) -> Wanted:
        """Apply the law."""


class Kanayama(_Tracker[KanayamaParams]):
    """Tracking law of Kanayama et al. 1990, eq. (8)."""

    name = "kanayama"
    presets = {"robust": ROBUST, "printed": KANAYAMA_PRINTED}

    def _follow(self, given: ControllerInput, error: TrackingError) -> Wanted:
        own, reference = self.params, given.reference
        k_y = min(own.k_y, self._stiffest)
        k_theta = kanayama.critical_gain(k_y) if own.k_theta is None else own.k_theta
        if own.approach_deg < 90.0:
            error = within_reach(error, kanayama.reach(k_y, k_theta, math.radians(own.approach_deg)))
        wanted = kanayama.control_rule(error, reference.speed, reference.turn_rate, own.k_x, k_y, k_theta)
        return error.e3, wanted, k_theta * reference.speed


class FierroLewis(_Tracker[FierroLewisParams]):
    """Kinematic law of Fierro & Lewis 1997, with the lag of their velocity loop."""

    name = "fierro_lewis"
    presets = {"robust": ROBUST, "printed": FIERRO_LEWIS_PRINTED}

    def _follow(self, given: ControllerInput, error: TrackingError) -> Wanted:
        own, reference, twist = self.params, given.reference, given.estimate.twist
        k2, k3 = own.k2, own.k3
        if k2 > self._stiffest:
            k2, k3 = self._stiffest, min(k3, kanayama.critical_gain(self._stiffest))
        v_ref, w_ref, gains = reference.speed, reference.turn_rate, (own.k1, k2, k3)
        curvature = w_ref / v_ref
        moved = fierro_lewis.projected_speed(twist.vx, error.e3, curvature, reference.cross_track)
        rates = kanayama.error_rates(error, twist.vx, twist.wz, moved, curvature * moved)
        if own.approach_deg < 90.0:
            near = within_reach(error, kanayama.reach(k2, k3, math.radians(own.approach_deg)))
            # A component at its bound is constant, so its rate is 0.
            held = [now == wanted for now, wanted in zip(near[:2], error[:2], strict=True)]
            error, rates = near, TrackingError(rates.e1 * held[0], rates.e2 * held[1], rates.e3)
        v, w = fierro_lewis.kinematic_command(error, v_ref, w_ref, *gains)
        v_rate, w_rate = fierro_lewis.command_rates(error, rates, v_ref, *gains)
        v = fierro_lewis.velocity_after(twist.vx, v, v_rate, own.k4, self.context.period)
        w = fierro_lewis.velocity_after(twist.wz, w, w_rate, own.k4, self.context.period)
        return error.e3, (v, w), k3 * v_ref


class Ramsete(_Tracker[RamseteParams]):
    """The nonlinear tracker of De Luca, Oriolo and Vendittelli 2001."""

    name = "ramsete"
    presets = {"robust": ROBUST, "printed": RAMSETE_PRINTED}

    def _follow(self, given: ControllerInput, error: TrackingError) -> Wanted:
        own, b = self.params, min(self.params.b, self._stiffest)
        law = (given.reference.speed, given.reference.turn_rate, own.zeta, b)
        if own.approach_deg < 90.0:
            error = within_reach(error, ramsete.reach(*law, math.radians(own.approach_deg)))
        return error.e3, ramsete.tracking_command(error, *law), ramsete.feedback_gain(*law)


class _Pursuit(_Tracker[P]):
    """Law that heads for a pose of the trajectory one look-ahead away."""

    _look_ahead: tuple[float, float, float]
    """Time, s, and least and largest distance, m."""
    _approach: tuple[float, float]
    """Remaining distance, m, below which the robot slows down, and the least speed there, m/s."""

    def _target(self, given: ControllerInput, angle: float) -> tuple[float, float, float]:
        """Pose to head for, m, rad, map frame: at most `angle`, rad, off the path's direction."""
        reference, pose = given.reference, given.estimate.pose
        away = pure_pursuit.look_ahead(given.estimate.twist.vx, *self._look_ahead)
        away = pure_pursuit.reaching(away, reference.cross_track, angle)
        return pure_pursuit.pursuit_pose(given.trajectory.samples, reference.progress, pose.x, pose.y, away)


class _Regulated(_Pursuit[P]):
    """Regulated pure pursuit, Macenski et al. 2023."""

    _arc: tuple[float, float]
    """Radius of the arcs below which the robot slows down, m, and the least speed there, m/s."""
    _fastest: float | None = None
    """Speed to regulate, m/s; None: the reference's."""

    def _follow(self, given: ControllerInput, error: TrackingError) -> Wanted:
        reference, pose = given.reference, given.estimate.pose
        x, y, _ = self._target(given, math.radians(self.params.approach_deg))
        ahead, left, _ = tracking_error(pose.x, pose.y, pose.heading, x, y, pose.heading)
        curvature = pure_pursuit.pursuit_curvature(ahead, left)
        v = pure_pursuit.curvature_speed(self._fastest or reference.speed, curvature, *self._arc)
        v = min(pure_pursuit.proximity_speed(v, reference.remaining, *self._approach), reference.speed)
        least = self._look_ahead[1]
        return math.atan2(left, ahead), (v, v * curvature), 2.0 * v / max(math.hypot(ahead, left), least)


class PurePursuit(_Regulated[PurePursuitParams]):
    """Regulated pure pursuit with fixed lengths, near those that Nav2 ships."""

    name = "pure_pursuit"
    presets = {"robust": ROBUST, "printed": PURE_PURSUIT_PRINTED}

    def __init__(self, params: PurePursuitParams, context: Context) -> None:
        super().__init__(params, context)
        self._look_ahead = (params.look_ahead_time, params.min_look_ahead, params.max_look_ahead)
        self._approach = (params.approach_distance, params.min_approach_speed)
        self._arc = (params.slow_radius, params.min_arc_speed)


class RegulatedPurePursuit(_Regulated[RegulatedPurePursuitParams]):
    """Regulated pure pursuit with lengths that follow from the robot."""

    name = "regulated_pure_pursuit"
    presets = {"robust": DERIVED, "printed": PURE_PURSUIT_PRINTED}

    def __init__(self, params: RegulatedPurePursuitParams, context: Context) -> None:
        super().__init__(params, context)
        robot = context.robot
        # Small errors of an arc to a point of a line: curvature -2 / L² e - 2 / L ψ.
        self._look_ahead, self._approach = _from_robot(params, context, 2.0, 2.0)
        self._arc = (_or(params.slow_radius, robot.max_linear / robot.max_angular), params.min_arc_speed)
        # The reference's speed falls with the curvature of the trajectory: to regulate it would slow down twice.
        self._fastest = robot.max_linear


class Graceful(_Pursuit[GracefulParams]):
    """The smooth control law of Park & Kuipers 2011, to a pose that moves along the trajectory."""

    name = "graceful"
    presets = {"robust": DERIVED, "printed": GRACEFUL_PRINTED}

    def __init__(self, params: GracefulParams, context: Context) -> None:
        super().__init__(params, context)
        robot, k1, k2 = context.robot, params.k1, params.k2
        # Small errors of the law on a line: curvature -(1 + k1) (1 + k2) / L² e - (1 + k1 + k2) / L ψ.
        self._damping = 1.0 + k1 + k2
        self._look_ahead, self._approach = _from_robot(params, context, self._damping, (1.0 + k1) * (1.0 + k2))
        self._beta = _or(params.beta, graceful.speed_weight(robot.max_linear, robot.max_angular, params.exponent))
        self._speed = graceful.turning_speed if params.keeps_turn_rate else graceful.speed
        approach = math.radians(params.approach_deg)
        self._sight = graceful.line_of_sight(approach, k1, k2) if params.approach_deg < 90.0 else approach

    def _follow(self, given: ControllerInput, error: TrackingError) -> Wanted:
        own, reference, pose = self.params, given.reference, given.estimate.pose
        target = self._target(given, self._sight)
        seen = graceful.egocentric_polar(pose.x, pose.y, pose.heading, *target)
        # In a loop smaller than the look-ahead the pose may be at the robot itself, where the law is not defined.
        seen = seen._replace(r=max(seen.r, 0.5 * self._look_ahead[1]))
        curvature = graceful.curvature(seen, own.k1, own.k2)
        v = self._speed(self.context.robot.max_linear, curvature, self._beta, own.exponent)
        v = min(pure_pursuit.proximity_speed(v, reference.remaining, *self._approach), reference.speed)
        return -seen.delta, (v, v * curvature), self._damping * v / seen.r


def _turned(pose: Pose2D) -> Pose2D:
    return replace(pose, heading=wrap(pose.heading + math.pi))


def _from_robot(
    params: RegulatedPurePursuitParams | GracefulParams, context: Context, damping: float, stiffness: float
) -> tuple[tuple[float, float, float], tuple[float, float]]:
    """Look-ahead and approach of `_Pursuit`: as given, else from the robot; see `derived.margin_look_ahead`."""
    robot = context.robot
    # A limited turn acceleration is not in it: `stopping_turn` bounds the correction to what ends in time.
    late = context.period + robot.dead_time + robot.motor_lag
    time = _or(params.look_ahead_time, derived.margin_look_ahead(late, damping, stiffness))
    # Steered wheels are at their limit for a point nearer than that, once it is an eighth of their radius aside.
    least = _or(params.min_look_ahead, 0.5 * max(inscribed_radius(robot.footprint), robot.turn_radius))
    most = _or(params.max_look_ahead, max(least, time * robot.max_linear))
    distance = _or(params.approach_distance, derived.braking_approach(robot.max_linear, robot.max_deceleration))
    return (time, min(least, most), most), (distance, params.min_approach_speed)


def _or(given: float | None, derived_value: float) -> float:
    return derived_value if given is None else given

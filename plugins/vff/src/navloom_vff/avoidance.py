"""One tick of the VFF: scans and pose in, velocity and reasons out (Borenstein & Koren 1989)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from navloom_avoidance.beams import Beams
from navloom_avoidance.certainty import new_window, occupied_cells
from navloom_avoidance.clearance import disc_radius, free_command
from navloom_avoidance.decision import Decision
from navloom_avoidance.himm import enter_readings
from navloom_avoidance.method import Method
from navloom_avoidance.robot import Robot
from navloom_avoidance.search import Progress, Trap
from navloom_avoidance.steering import wrap
from numpy.typing import NDArray

from navloom_vff.following import WallFollowing, is_turned_away, wall_direction
from navloom_vff.forces import damping_factor, force_constant, repulsive_force, resultant, travel_cosine
from navloom_vff.steering import forward_speed, low_pass, slowed_for_turn, turn_rate

if TYPE_CHECKING:
    from navloom_vff.params import VffParams

Floats = NDArray[np.float64]
Pose = tuple[float, float, float]
Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class View:
    """Inputs to the decision of one tick, in the pose frame except for the cells.

    Attributes:
        pose: x, y, m, heading, rad. twist: Current speed, m/s, and turn rate, rad/s. target: m.
        distance: Distance to the target, m. bearing: Direction of the target, theta_t, rad.
        cells: (n, 3), occupied cells: x, y, m, base frame, and certainty.
        push: F_r. cosine: forces.travel_cosine(). factor: forces.damping_factor().
    """

    pose: Pose
    twist: tuple[float, float]
    target: Point
    distance: float
    bearing: float
    cells: Floats
    push: Point
    cosine: float
    factor: float


class ForceField(Method):
    """The VFF for one robot: its certainty window, its turn rate, and the wall it follows."""

    def __init__(self, params: VffParams, robot: Robot, period: float) -> None:
        super().__init__(robot, period)
        self.params = params
        self.radius = disc_radius(robot.footprint, params.disc)
        # A point has no body: its distances are from the centre, and the body begins at its half width.
        body = 0.0 if self.radius > 0.0 else disc_radius(robot.footprint, "inscribed")
        self.constant = force_constant(body + params.balance)
        self.max_turn = min(math.radians(params.max_turn_deg), robot.max_angular)
        self.max_speed = min(params.max_speed, robot.max_linear)
        self.histogram = np.zeros(params.sectors)
        self._wall_angle = math.radians(params.wall_angle_deg)
        self._cells = np.zeros((params.window * params.window, 3))
        self._votes = np.zeros((params.window, params.window), np.uint8)
        self.reset()

    def reset(self) -> None:
        """Forget the window and the wall."""
        super().reset()
        p = self.params
        self.grid, self.origin = new_window(p.window)
        self.following = WallFollowing()
        self.progress = Progress(p.progress_step, p.target_shift)
        self.trap = Trap(p.release_distance, math.radians(p.release_deg))
        self._target: Point | None = None
        self._turn = 0.0

    def decide(self, beams: Beams | None, pose: Pose, twist: tuple[float, float], target: Point) -> Decision:
        if beams is not None and beams.ranges.size:
            enter_readings(self.grid, self.origin, self._votes, beams, pose, self.params)
        view = self.look(pose, twist, target)
        if self.trap.place is not None:
            if self.trap.holds(pose, target, self.params.target_shift):
                return Decision(0.0, 0.0, "trapped", None, "trapped: neither robot nor target moved since")
            self._target = None
        if self._target is None or math.dist(target, self._target) > self.params.target_shift:
            self._target = target
            self.following.end()
            self.progress.restart()
        if self.progress.note(view.distance, self._target):
            self.following.hesitated = 0.0
        self._follow_or_leave(view)
        return self._steer(view)

    def look(self, pose: Pose, twist: tuple[float, float], target: Point) -> View:
        """Compute the target's place, the occupied cells and their force."""
        p, heading = self.params, pose[2]
        distance = math.dist(target, pose[:2])
        bearing = math.atan2(target[1] - pose[1], target[0] - pose[0])
        count = occupied_cells(self.grid, self.origin, p.cell, pose, self.edges, self._cells)
        cells = self._cells[:count]
        horizon = distance + self.radius if p.stops_at_target else math.inf
        x, y = repulsive_force(cells, self.radius, self.constant, p.least_distance, horizon, heading, self.histogram)
        cosine = travel_cosine((x, y), 0.0)
        factor = damping_factor(cosine, p.damping, p.may_pull)
        # The force is summed in the base frame, where the cells are; a wall is followed in the pose frame.
        c, s = math.cos(heading), math.sin(heading)
        return View(pose, twist, target, distance, bearing, cells, (c * x - s * y, s * x + c * y), cosine, factor)

    def _follow_or_leave(self, view: View) -> None:
        """Start or stop following a wall."""
        p, following, heading = self.params, self.following, view.pose[2]
        is_away = is_turned_away(heading, view.bearing)
        is_led_away = is_turned_away(resultant(view.push, view.factor, view.bearing), view.bearing)
        if is_away and not is_led_away:
            following.hesitated = 0.0  # turning back to the target takes time without being a trap
        if view.push == (0.0, 0.0):
            following.end()
        elif following.side == 0:
            if following.hesitated > p.hesitation or (is_away and (is_led_away or p.trap_rule == "heading")):
                following.begin(view.push, heading, self._wall_angle, view.distance)
        elif not is_away and (p.leave_rule == "heading" or self._is_past(view)):
            following.end()

    def _is_past(self, view: View) -> bool:
        """Whether the robot is nearer to the target than at the start of following, or no push opposes the target."""
        if view.distance < self.following.start - self.params.progress_step:
            return True
        return not is_turned_away(math.atan2(view.push[1], view.push[0]), view.bearing)

    def _steer(self, view: View) -> Decision:
        """Turn to the resultant and drive as fast as the push allows."""
        p, heading, side = self.params, view.pose[2], self.following.side
        pull = wall_direction(view.push, side, self._wall_angle) if side else view.bearing
        direction = resultant(view.push, view.factor, pull)
        wanted = turn_rate(direction, heading, p.turn_gain, self.max_turn)
        self._turn = low_pass(self._turn, wanted, self.period, p.time_constant)
        strength = math.hypot(*view.push)
        speed = forward_speed(strength, view.cosine, self.max_speed, p.slows_leaving, p.slow_force)
        # The robot's own limit may lie below the method's least speed.
        speed = max(min(p.min_speed, self.max_speed), speed)
        if p.slows_for_turns:
            speed = slowed_for_turn(speed, direction, heading)
        off = math.degrees(wrap(direction - view.bearing))
        why = f"push {strength:.2f}, {off:+.0f} deg off the target"
        if side:
            why += ", following the wall on the " + ("left" if side > 0 else "right")
        return self._send(view, speed, self._turn, direction, why)

    def _send(self, view: View, speed: float, turn: float, direction: float, why: str) -> Decision:
        """Reduce the command to a collision-free one, and check the robot's progress."""
        p, r, progress = self.params, self.robot, self.progress
        sent = (speed, turn)
        if p.arc_check:
            sent = free_command(
                view.cells, self.edges, view.twist, sent, p.creep, self.period, r.max_acceleration,
                r.max_deceleration, p.turn_horizon, p.arc_margin, p.arc_margin, self.in_flight,
                r.motor_lag, r.dead_time,
            )  # fmt: skip
        if sent != (speed, turn):
            why += ", reduced by what is on the arc"
        is_clear = view.push == (0.0, 0.0)
        # Only time in which the robot executes these commands counts: stopped or driven by another source, it is not
        # trapped.
        obeyed = self.motors.obeyed(view.twist)
        elapsed = self.period if obeyed else 0.0
        progress.stalled = 0.0 if is_clear else progress.stalled + elapsed
        self.following.hesitated += elapsed
        progress.blocked = progress.blocked + elapsed if sent == (0.0, 0.0) else 0.0
        if progress.stalled > p.patience:
            return self._give_up(view, f"no progress in {p.patience:g} s")
        if progress.blocked > p.blocked_patience:
            return self._give_up(view, "no room to move or turn")
        return Decision(*sent, "clear" if is_clear else "steering", direction, why)

    def _give_up(self, view: View, why: str) -> Decision:
        self.trap.place, self.trap.target = view.pose, view.target
        # The low-pass would otherwise go on turning when the trap is left.
        self._turn = 0.0
        return Decision(0.0, 0.0, "trapped", None, "trapped: " + why)


def warm_up(*choices: VffParams) -> None:
    """Compile every kernel for the types of one tick."""
    square = np.array([[0.4, 0.4], [-0.4, 0.4], [-0.4, -0.4], [0.4, -0.4]])
    robot = Robot(square, 0.5, 0.4, 0.5, 1.0)
    for params in choices:
        ForceField(params, robot, 0.05).step(Beams.sample(), (0.0, 0.0, 0.0), (0.0, 0.0), (3.0, 0.0))

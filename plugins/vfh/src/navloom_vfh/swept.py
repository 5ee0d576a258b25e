"""VFH* for fast robots with a laser: echo points, the true footprint, the free run, and a way that is kept."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from navloom_avoidance.beams import Beams
from navloom_avoidance.certainty import occupied_cells, scroll_window
from navloom_avoidance.clearance import disc_radius
from navloom_avoidance.decision import Decision
from navloom_avoidance.himm import TOP
from navloom_avoidance.points import EchoMemory, points_in_base
from navloom_avoidance.robot import Robot
from navloom_avoidance.steering import wrap
from numpy.typing import NDArray

from navloom_vfh.avoidance import Choice, Floats, Point, Pose, View
from navloom_vfh.free_run import ECHO, choose_command, near_points, stops_free
from navloom_vfh.held import Held
from navloom_vfh.kept_target import KeptTarget
from navloom_vfh.lookahead import IS_GOAL
from navloom_vfh.methods import VfhStarAvoidance
from navloom_vfh.steering import stopping_speed, turn_rate, turning_speed
from navloom_vfh.stuck import Stuck
from navloom_vfh.survey import openings

if TYPE_CHECKING:
    from navloom_vfh.params import VfhSweptParams

MOST_POINTS, MOST_NEAR = 8192, 4096
BEND = 2.0  # 1/m: curvature of the arcs on which it backs up if it cannot go straight
FINE = 0.01  # m: side of the square in which one point is checked; less than the noise of a laser


class VfhSweptAvoidance(VfhStarAvoidance):
    """Turns to the candidate that VFH* chooses, as fast as the swept footprint stays free until the robot stops.

    Attributes:
        memory: Echo points of the lasers.
        has_cells: Whether the certainty window is in use: there are sonars, or `echoes` is "cells".
        place: Position of the robot in the last tick, m.
        near, gaps: Points that the robot may meet in this tick, from free_run.near_points(); `near_count` rows.
    """

    params: VfhSweptParams

    def __init__(self, params: VfhSweptParams, robot: Robot, period: float) -> None:
        p = params
        self.far = p.look_ahead * p.step + p.d_max
        self.rim = float(np.hypot(robot.footprint[:, 0], robot.footprint[:, 1]).max())
        self.disc = disc_radius(robot.footprint, p.disc)
        self.kept = KeptTarget(p.keep_target, p.target_shift, p.step)
        self.stuck = Stuck(p.stuck_patience, p.back_up, p.back_speed)
        super().__init__(params, robot, period)
        self._cells = np.zeros((self._cells.shape[0] + MOST_POINTS, 3))
        self._fine = np.zeros_like(self._cells)
        self.near, self.gaps, self.near_count = np.zeros((MOST_NEAR, 4)), np.zeros(MOST_NEAR), 0
        self.limits = (robot.max_acceleration, robot.max_deceleration, robot.max_angular_acceleration)
        self.margins = np.array([[p.point_margin, p.point_floor], [p.arc_margin, p.arc_margin]])

    def reset(self) -> None:
        super().reset()
        self.memory = EchoMemory(self.edges, self.params.memory, self.far)
        self.has_cells = self.params.echoes == "cells"
        self.kept.forget()
        self.held, self._sent = Held(), (0.0, 0.0)
        self.stuck.restart()
        self._time, self._count, self._reaches, self._steers = 0.0, 0, False, False
        self.place: Point = (0.0, 0.0)

    def step(
        self, beams: Beams | None, pose: Pose, twist: tuple[float, float], target: Point, share: float = 1.0
    ) -> Decision:
        self.held.note(share, self._sent, self.period)
        decision = super().step(beams, pose, twist, target, share)
        self._sent = (decision.speed, decision.turn)
        return decision

    def enter(self, beams: Beams, pose: Pose) -> None:
        rest = self.memory.enter(beams, pose, self._time) if self.params.echoes == "points" else beams
        if rest is not None:
            self.has_cells = True
            super().enter(rest, pose)

    def decide(self, beams: Beams | None, pose: Pose, twist: tuple[float, float], target: Point) -> Decision:
        p = self.params
        self._time += self.period
        self._count, self.place = -1, pose[:2]
        # Cells are coarse, and a sonar's echo is anywhere on its arc; points are where the laser saw them.
        self.radius = (
            self.disc + (p.safety_distance if self.has_cells else p.point_distance) if self.disc > 0.0 else 0.0
        )
        target = self.kept.choose(pose[:2], target, self.remaining, self._reaches, self.period)
        follows = self.held.is_held or self.motors.obeyed(twist)
        is_told = self._steers and follows and math.dist(target, pose[:2]) > p.progress_step
        self.stuck.note(pose, self.period if is_told or self.stuck.backs_up else 0.0)
        decision = super().decide(beams, pose, twist, target)
        if decision.status == "trapped":
            self.stuck.restart(pose)
            return decision
        return self._back_up(pose, twist) or decision

    def picture(self) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
        """The certainty window about the robot, with full certainty where echo points are, and its origin in cells."""
        grid, origin, cell = self.grid.copy(), self.origin.copy(), self.params.cell
        scroll_window(grid, origin, self.place[0], self.place[1], cell)
        cells = np.floor(self.memory.points[:, :2] / cell).astype(np.int64) - origin
        columns, rows = cells[((cells >= 0) & (cells < grid.shape[0])).all(axis=1)].T
        grid[rows, columns] = TOP
        return grid, origin

    def _back_up(self, pose: Pose, twist: tuple[float, float]) -> Decision | None:
        """The command that backs a stuck robot up; None if it is not stuck, or something is behind it."""
        if not self.stuck.backs_up and not self.stuck.is_due:
            return None
        speed = min(self.params.back_speed, self.max_speed)
        self.look_near(pose, max(abs(twist[0]), speed))
        bend = min(BEND * speed, self.max_turn)
        command = next((c for c in ((-speed, 0.0), (-speed, bend), (-speed, -bend)) if self.can_stop(twist, c)), None)
        if command is None or not self.held.allows(command):
            if self.stuck.backs_up:
                self.stuck.restart(pose)
            return None
        if not self.stuck.backs_up:
            self.stuck.begin(pose)
        return Decision(*command, "steering", None, "stuck: backing up")

    def choose(self, view: View) -> Choice:
        choice = super().choose(view)
        self._steers = choice.direction is not None
        return choice

    def survey(self, view: View, circle: float) -> tuple[int, int, bool, float]:
        p = self.params
        if self._count < 0:
            self._count = self._gather(view.pose, p.spacing, self._cells)
        self.slot_count, found, must_slow, ahead = openings(
            self._cells[: self._count], view.pose[2], self.radius, self.reach, view.horizon,
            (p.threshold_low, p.threshold_high), circle, float(p.mask_certainty), p.widest_slot, view.bearing,
            self.density, self.blocked, self.slots, self._directions,
        )  # fmt: skip
        return self._count, found, must_slow, ahead

    def _gather(self, pose: Pose, spacing: float, cells: Floats) -> int:
        """Write occupied cells and one echo point per square of a side, m, to `cells`; return their number."""
        count = 0
        if self.has_cells:
            count = occupied_cells(self.grid, self.origin, self.params.cell, pose, self.edges, cells)
        return count + points_in_base(self.memory.points, pose, self.far, spacing, ECHO, cells[count:])

    def pick(self, view: View, cells: Floats, found: int, circle: float, must_slow: bool) -> tuple[int, bool, str]:
        picked = super().pick(view, cells, found, circle, must_slow)
        self._reaches = bool(self.nodes[self.way_end, IS_GOAL])
        return picked

    def _steer(self, view: View, choice: Choice, direction: float) -> Decision:
        """Turn to the direction and drive as fast as the swept footprint stays free."""
        p, r = self.params, self.robot
        if p.speed_law == "density":
            return super()._steer(view, choice, direction)
        # The command acts after dead time and lag: the error counts from the heading then.
        coming = r.dead_time * float(self.in_flight[0, 1]) + r.motor_lag * view.twist[1]
        error = wrap(direction - view.pose[2] - coming)
        self.look_near(view.pose, max(self.max_speed, abs(view.twist[0])))
        n = self.near_count
        v, w = choose_command(
            self.near[:n], self.gaps[:n], self.edges, self.rim, view.twist, error, self._target_speed(view, coming),
            turn_rate(error, 0.0, p.turn_gain, self.max_turn), self.max_turn, p.turn_rates, self.held.side,
            p.horizon, p.nose, self.period, self.limits, self.in_flight, r.motor_lag, r.dead_time,
        )  # fmt: skip
        if v < 0.0:
            return self._send(view, choice, *self._braking(), direction, choice.why + ", nothing is free: braking")
        return self._send(view, choice, v, w, direction, choice.why)

    def _target_speed(self, view: View, coming: float) -> float:
        """Greatest speed at which the robot can turn to the target, and stop at the goal, m/s.

        Args:
            view: The tick. coming: Angle that the robot still turns by the commands in flight, rad.
        """
        p = self.params
        off = wrap(view.bearing - view.pose[2] - coming)
        way = view.distance + self.remaining
        stopping = stopping_speed(way, self.robot.max_deceleration, self.period + self.motors.delay)
        turning = turning_speed(view.distance, off, self.max_turn)
        return min(self.max_speed, max(min(stopping, turning), p.min_speed))

    def _braking(self) -> tuple[float, float]:
        """The command that brakes on the arc of the last command, which was found free."""
        v, w = self.in_flight[-1].tolist()
        slower = max(0.0, v - self.robot.max_deceleration * self.period)
        return (slower, w * slower / v) if slower > 0.0 else (0.0, 0.0)

    def checked(self, view: View, choice: Choice, wanted: tuple[float, float]) -> tuple[float, float]:
        """A turn in place, reduced until it is free; choose_command() has checked every other command."""
        p = self.params
        if p.speed_law == "density":
            return super().checked(view, choice, wanted)
        if wanted[0] > 0.0 or wanted[1] == 0.0:
            return wanted
        trials = [(0.0, wanted[1] * part) for part in (1.0, 0.5, 0.25)]
        # Driving ahead moves the corners past what is in the way of a turn.
        trials += [(p.creep, wanted[1] * part) for part in (1.0, 0.5, 0.0, -0.5)] if p.creep > 0.0 else []
        self.look_near(view.pose, max(p.creep, abs(view.twist[0])))
        return next(
            (trial for trial in trials if self.held.allows(trial) and self.can_stop(view.twist, trial)), (0.0, 0.0)
        )

    def look_near(self, pose: Pose, speed: float) -> None:
        """Fill `near` and `gaps` with what the footprint may meet before the robot has stopped from a speed, m/s."""
        r = self.robot
        way = speed * (2.0 * self.period + r.motor_lag + r.dead_time + 0.5 * speed / r.max_deceleration)
        count = self._gather(pose, FINE, self._fine)
        self.near_count = near_points(
            self._fine[:count], self.edges, way + 2.0 * self.rim, self.margins, self.memory.beam_spacing, self.near,
            self.gaps,
        )  # fmt: skip

    def can_stop(self, twist: tuple[float, float], command: tuple[float, float]) -> bool:
        """Whether the robot stops free of the points of the last look_near()."""
        r, n = self.robot, self.near_count
        return stops_free(
            self.near[:n], self.gaps[:n], self.edges, self.rim, twist, command, self.period,
            self.limits, self.in_flight, r.motor_lag, r.dead_time,
        )  # fmt: skip

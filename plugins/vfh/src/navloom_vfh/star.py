"""VFH* (Ulrich & Borenstein 2000), and what the default adds to it: echo points, the true footprint, the free run."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from navloom_avoidance.beams import Beams
from navloom_avoidance.certainty import occupied_cells
from navloom_avoidance.decision import Decision
from navloom_avoidance.himm import TOP
from navloom_avoidance.points import EchoMemory, points_in_base
from navloom_avoidance.robot import Robot
from navloom_avoidance.steering import turn_rate, wrap

from navloom_vfh.avoidance import Choice, Floats, Pose, View
from navloom_vfh.free_run import choose_command, near_points, stops_free
from navloom_vfh.lookahead import COLUMNS, DEPTH, IS_GOAL, ROOT, TOTAL, look_ahead
from navloom_vfh.methods import VfhPlusAvoidance
from navloom_vfh.survey import openings

if TYPE_CHECKING:
    from navloom_vfh.params import VfhStarParams

MOST_NEAR = 4096
"""Most points of one roll-forward; the nearest are kept."""
MOVED = 0.35  # rad: a robot that turned by this is not stuck


class VfhStarAvoidance(VfhPlusAvoidance):
    """Chooses the first candidate of the cheapest path of several steps (Ulrich & Borenstein 2000).

    Attributes:
        nodes: (limit, 11), search tree of the last tick, see lookahead.py; `node_count` rows are valid.
        way_end: Row of the last node of the chosen path.
        expanded: Number of nodes expanded.
    """

    params: VfhStarParams

    def __init__(self, params: VfhStarParams, robot: Robot, period: float) -> None:
        p = params
        self.later = (p.projected_target_weight, p.projected_heading_weight, p.projected_previous_weight)
        self.nodes = np.zeros((p.node_limit, COLUMNS))
        self.node_count, self.way_end, self.expanded = 0, -1, 0
        super().__init__(params, robot, period)
        corners = robot.footprint
        self.rim = float(np.hypot(corners[:, 0], corners[:, 1]).max())
        self.far = p.look_ahead * p.step + self.reach
        if p.echoes == "points":
            self._cells = np.zeros((self._cells.shape[0] + 8192, 3))
        self._near, self._gaps = np.zeros((MOST_NEAR, 3)), np.zeros(MOST_NEAR)
        self._raw = np.zeros((8192 + self._cells.shape[0], 3))

    def reset(self) -> None:
        super().reset()
        self._time, self._still = 0.0, 0.0
        self._target: tuple[tuple[float, float], float, float] | None = None
        self._backing: Pose | None = None
        self._anchor: Pose = (math.inf, 0.0, 0.0)
        self._reaches = self._has_way = False
        self.memory = EchoMemory(self.edges, self.params.memory, self.params.look_ahead * self.params.step + self.reach)
        self._has_cells = self.params.echoes == "cells"

    def enter(self, beams: Beams, pose: Pose) -> None:
        rest: Beams | None = beams
        if self.params.echoes == "points":
            rest = self.memory.enter(beams, pose, self._time)
        if rest is not None:
            self._has_cells = True
            super().enter(rest, pose)

    def decide(
        self, beams: Beams | None, pose: Pose, twist: tuple[float, float], target: tuple[float, float]
    ) -> Decision:
        self._time += self.period
        self._count = -1
        target = self._kept_target(pose, target)
        if self._backing is not None:
            if beams is not None and beams.ranges.size:
                self.enter(beams, pose)
            if (sent := self._back_up(pose, twist)) is not None:
                return sent
            beams = None
        elif self._is_stuck(pose, twist):
            self._backing = pose
        return super().decide(beams, pose, twist, target)

    def _kept_target(self, pose: Pose, target: tuple[float, float]) -> tuple[float, float]:
        """The target, or the one before where the path jumped to a longer one while a way to the old one is seen.

        A noisy map can close a gap that the scans show open. Turning back there costs more than driving through.
        """
        p, remaining = self.params, self.remaining
        if p.keep_target > 0.0 and self._target is not None:
            old, rest, since = self._target
            is_jump = math.dist(target, old) > p.target_shift
            # Beyond the target its path counts, up to it the straight line.
            is_longer = math.dist(target, pose[:2]) + remaining > math.dist(old, pose[:2]) + rest + p.target_shift
            is_passed = math.dist(old, pose[:2]) < p.step
            if is_jump and is_longer and not is_passed and self._reaches and self._time - since < p.keep_target:
                return old
        self._target = (target, remaining, self._time)
        return target

    def _is_stuck(self, pose: Pose, twist: tuple[float, float]) -> bool:
        """Whether the robot has hardly moved for a while although it obeys this avoider."""
        p, place = self.params, self._anchor
        is_there = self._target is not None and math.dist(pose[:2], self._target[0]) < p.progress_step
        has_moved = math.dist(pose[:2], place[:2]) > p.progress_step or abs(wrap(pose[2] - place[2])) > MOVED
        if has_moved or is_there or self.trap.place is not None or not self._has_way or not self.motors.obeyed(twist):
            self._anchor, self._still = pose, 0.0
        else:
            self._still += self.period
        if p.back_up == 0.0 or self._still <= p.stuck_patience:
            return False
        self._still = 0.0
        return True

    def _back_up(self, pose: Pose, twist: tuple[float, float]) -> Decision | None:
        """Drive straight back until far enough or something is in the way; then None."""
        p = self.params
        assert self._backing is not None
        way = math.dist(pose[:2], self._backing[:2])
        command = (-min(p.back_speed, self.max_speed), 0.0)
        self._near_points(pose, abs(twist[0]) + p.back_speed)
        is_in_time = self._still < p.back_up / p.back_speed + 1.0
        if way < p.back_up and is_in_time and self._stops_free(twist, command):
            self._still += self.period
            return Decision(*command, "steering", None, f"stuck: backing up, {way:.2f} of {p.back_up:g} m")
        self._backing, self._still, self._anchor = None, 0.0, pose
        return None

    def gather(self, view: View) -> int:
        """Number of cells and echo points of this tick, written to `_cells`."""
        if self._count < 0:
            p, count = self.params, 0
            if self._has_cells:
                count = occupied_cells(self.grid, self.origin, p.cell, view.pose, self.edges, self._cells)
            if p.echoes == "points":
                count += points_in_base(
                    self.memory.points, view.pose, self.far, p.spacing, TOP + 1.0e-6, self._cells[count:]
                )
            self._count = count
        return self._count

    def choose(self, view: View) -> Choice:
        choice = super().choose(view)
        self._has_way = choice.direction is not None
        return choice

    def survey(self, view: View, circle: float) -> tuple[int, int, bool, float]:
        p, count = self.params, self.gather(view)
        self.slot_count, found, must_slow, ahead = openings(
            self._cells[:count], view.pose[2], self.radius, self.reach, view.horizon,
            (p.threshold_low, p.threshold_high), circle, float(p.mask_certainty), p.widest_slot, view.bearing,
            self.density, self.blocked, self.slots, self._directions,
        )  # fmt: skip
        return count, found, must_slow, ahead

    def pick(self, view: View, cells: Floats, found: int, circle: float, must_slow: bool) -> tuple[int, bool, str]:
        self.search_from(view, cells, found, circle)
        if circle > 0.0 and not self.nodes[self.way_end, IS_GOAL]:
            # No path reaches a goal at this speed; a slower robot may find one.
            _, found, _, _ = self.survey(view, 0.0)
            self.search_from(view, cells, found, 0.0)
            must_slow = True
        end = self.nodes[self.way_end]
        self._reaches = bool(end[IS_GOAL])
        return int(end[ROOT]), must_slow, f", {int(end[DEPTH]) + 1} steps ahead at cost {end[TOTAL]:.1f}"

    def search_from(self, view: View, cells: Floats, found: int, circle: float) -> None:
        """Look ahead from the first `found` of `_directions`; fills `nodes`."""
        p, heading = self.params, view.pose[2]
        toward = view.bearing - heading
        target = (view.distance * math.cos(toward), view.distance * math.sin(toward))
        self.way_end, self.node_count, self.expanded = look_ahead(
            cells, self._directions[:found] - heading, target, self.previous(view) - heading,
            self.weights, self.later, p.discount, p.look_ahead, p.step, circle, self.radius, self.reach,
            self.slack if p.stops_at_target else math.inf, p.threshold_high, float(p.mask_certainty), p.sectors,
            p.widest_slot, self.nodes,
        )  # fmt: skip

    def _steer(self, view: View, choice: Choice, direction: float) -> Decision:
        if self.params.speed_law == "density":
            return super()._steer(view, choice, direction)
        p = self.params
        # The command acts after dead time and lag; the error counts from the heading then.
        error = wrap(direction - view.pose[2] - self.turn_in_flight(view))
        turn = turn_rate(error, 0.0, p.turn_gain, self.max_turn)
        v, w = self.fastest(view, choice, error, self.max_speed, turn, p.spread)
        if v < 0.0:
            return self._send(view, choice, 0.0, 0.0, direction, choice.why + ", nothing is free")
        return self._send(view, choice, v, w, direction, choice.why)

    def turn_in_flight(self, view: View) -> float:
        """Angle that the robot still turns by the commands in flight, rad."""
        r = self.robot
        return r.dead_time * float(self.in_flight[0, 1]) + r.motor_lag * view.twist[1]

    def fastest(
        self, view: View, choice: Choice, error: float, wanted: float, turn: float, spread: int
    ) -> tuple[float, float]:
        p, r = self.params, self.robot
        self._near_points(view.pose, max(wanted, abs(view.twist[0])))
        count = self._near_count
        return choose_command(
            self._near[:count], self._gaps[:count], self.edges, self.rim, view.twist, error, wanted, turn,
            self.max_turn, spread, p.horizon, p.nose, self.period, (r.max_acceleration, r.max_deceleration),
            max(p.point_margin, p.arc_margin), p.floor, self.in_flight, r.motor_lag, r.dead_time,
        )  # fmt: skip

    def _near_points(self, pose: Pose, speed: float) -> None:
        """Fill `_near` and `_gaps` with the points that the robot might meet before it stops from a speed, m/s."""
        p, r, count = self.params, self.robot, 0
        if self._has_cells:
            count = occupied_cells(self.grid, self.origin, p.cell, pose, self.edges, self._raw)
        if p.echoes == "points":
            count += points_in_base(self.memory.points, pose, self.far, 0.01, TOP + 1.0e-6, self._raw[count:])
        time = 2.0 * self.period + r.motor_lag + r.dead_time + speed / (2.0 * r.max_deceleration)
        self._near_count = near_points(
            self._raw[:count], self.edges, speed * time + self.rim, (p.point_margin, p.arc_margin), self._near, self._gaps
        )

    def checked(self, view: View, choice: Choice, wanted: tuple[float, float]) -> tuple[float, float]:
        if self.params.speed_law == "density":
            return super().checked(view, choice, wanted)
        if wanted[0] > 0.0 or wanted[1] == 0.0:
            return wanted  # choose_command() has checked it
        p = self.params
        trials = [(0.0, wanted[1] * part) for part in (1.0, 0.5, 0.25)]
        # Driving ahead moves the corners past what is in the way of a turn.
        trials += [(p.creep, wanted[1] * part) for part in (1.0, 0.5, 0.0, -0.5)] if p.creep > 0.0 else []
        self._near_points(view.pose, max(p.creep, abs(view.twist[0])))
        return next((trial for trial in trials if self._stops_free(view.twist, trial)), (0.0, 0.0))

    def _stops_free(self, twist: tuple[float, float], command: tuple[float, float]) -> bool:
        """Whether the robot stops free of the points of the last _near_points()."""
        p, r, n = self.params, self.robot, self._near_count
        return stops_free(
            self._near[:n], self._gaps[:n], self.edges, self.rim, twist, command, self.period,
            (r.max_acceleration, r.max_deceleration), max(p.point_margin, p.arc_margin), p.floor, self.in_flight,
            r.motor_lag, r.dead_time,
        )  # fmt: skip

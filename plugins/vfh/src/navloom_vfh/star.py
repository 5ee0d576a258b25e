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
from navloom_vfh.free_run import choose_command, near_points
from navloom_vfh.lookahead import COLUMNS, DEPTH, IS_GOAL, ROOT, TOTAL, look_ahead
from navloom_vfh.methods import VfhPlusAvoidance
from navloom_vfh.survey import openings

if TYPE_CHECKING:
    from navloom_vfh.params import VfhStarParams

MOST_NEAR = 4096
"""Most points of one roll-forward; the nearest are kept."""


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
        self._raw = np.zeros((8192, 3))

    def reset(self) -> None:
        super().reset()
        self._time = 0.0
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
        return super().decide(beams, pose, twist, target)

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
        raw = choice.cells
        if p.echoes == "points":
            cells = occupied_cells(self.grid, self.origin, p.cell, view.pose, self.edges, self._raw) if self._has_cells else 0
            cells += points_in_base(self.memory.points, view.pose, self.far, 0.01, TOP + 1.0e-6, self._raw[cells:])
            raw = self._raw[:cells]
        speed = max(wanted, abs(view.twist[0]))
        reach = speed * (self.period + r.motor_lag + r.dead_time + speed / (2.0 * r.max_deceleration)) + self.rim
        count = near_points(raw, self.edges, reach, (p.point_margin, p.arc_margin), self._near, self._gaps)
        return choose_command(
            self._near[:count], self._gaps[:count], self.edges, self.rim, view.twist, error, wanted, turn,
            self.max_turn, spread, p.horizon, p.nose, self.period, (r.max_acceleration, r.max_deceleration),
            max(p.point_margin, p.arc_margin), p.floor, self.in_flight, r.motor_lag, r.dead_time,
        )  # fmt: skip

    def checked(self, view: View, choice: Choice, wanted: tuple[float, float]) -> tuple[float, float]:
        if self.params.speed_law == "density":
            return super().checked(view, choice, wanted)
        if wanted[0] > 0.0 or wanted[1] == 0.0:
            return wanted  # choose_command() checked it
        v, w = self.fastest(view, choice, math.copysign(0.5 * math.pi, wanted[1]), self.params.creep, wanted[1], 0)
        return (v, w) if v >= 0.0 else (0.0, 0.0)

"""The choice of direction in each method: VFH (1991), VFH+ (1998) and VFH* (2000)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from navloom_avoidance.histogram import smoothing_gain
from navloom_avoidance.robot import Robot
from navloom_avoidance.steering import wrap

from navloom_vfh.avoidance import Choice, Floats, HistogramAvoidance, View
from navloom_vfh.costs import cheapest
from navloom_vfh.lookahead import DEPTH, IS_GOAL, ROOT, TOTAL, look_ahead
from navloom_vfh.survey import survey_openings, survey_valleys
from navloom_vfh.turning import turning_radius
from navloom_vfh.valleys import nearest_valley, valley_direction

if TYPE_CHECKING:
    from navloom_vfh.params import VfhParams, VfhPlusParams, VfhStarParams


class VfhAvoidance(HistogramAvoidance):
    """Chooses the valley nearest to the target (Borenstein & Koren 1991)."""

    def __init__(self, params: VfhParams, robot: Robot, period: float) -> None:
        self.params = params
        super().__init__(params, robot, period)
        self.gain = smoothing_gain(params.smoothing, self.radius > 0.0)
        self.threshold = params.threshold * self.gain

    def choose(self, view: View) -> Choice:
        p = self.params
        count, self.slot_count, ahead = survey_valleys(
            (self.grid, self.origin, p.cell), view.pose, self.edges, self.radius, self.reach, view.horizon,
            p.smoothing, self.threshold, self._cells, self.density, self.slots,
        )  # fmt: skip
        cells = self._cells[:count]
        valleys = [(first, width) for first, width in self.slots[: self.slot_count].tolist()]
        valley = nearest_valley(valleys, p.sectors, view.bearing)
        if valley is None:
            return Choice(None, True, ahead, cells, "no valley")
        direction = valley_direction(valley, p.sectors, p.widest_slot, view.bearing)
        if abs(wrap(direction - view.bearing)) < 1.0e-9:
            direction = view.bearing
        off = math.degrees(wrap(direction - view.bearing))
        return Choice(direction, False, ahead, cells, f"valley {off:+.0f} deg off the target")


class VfhPlusAvoidance(HistogramAvoidance):
    """Chooses the cheapest candidate of the masked histogram (Ulrich & Borenstein 1998)."""

    def __init__(self, params: VfhPlusParams, robot: Robot, period: float) -> None:
        self.params = params
        self.threshold = params.threshold_high
        self.weights = (params.target_weight, params.heading_weight, params.previous_weight)
        self.blocked = np.zeros(params.sectors)
        super().__init__(params, robot, period)

    def reset(self) -> None:
        super().reset()
        self.blocked[:] = 0.0
        self._previous: float | None = None

    def choose(self, view: View) -> Choice:
        circle = turning_radius(view.twist[0], self.max_turn)
        count, found, must_slow, ahead = self.survey(view, circle)
        cells = self._cells[:count]
        if found == 0:
            self._previous = None
            return Choice(None, True, ahead, cells, "no opening")
        index, must_slow, depth = self.pick(view, cells, found, 0.0 if must_slow else circle, must_slow)
        # The target's own direction is not wrapped: _send() compares the two for equality.
        direction = float(self._directions[index])
        direction = direction if direction == view.bearing else wrap(direction)
        self._previous = direction
        off = math.degrees(wrap(direction - view.bearing))
        return Choice(direction, must_slow, ahead, cells, f"opening {off:+.0f} deg off the target{depth}")

    def survey(self, view: View, circle: float) -> tuple[int, int, bool, float]:
        """Numbers of cells and candidates for a turning circle, m; whether the circle is too wide; density ahead."""
        p = self.params
        count, self.slot_count, found, must_slow, ahead = survey_openings(
            (self.grid, self.origin, p.cell), view.pose, self.edges, self.radius, self.reach, view.horizon,
            (p.threshold_low, p.threshold_high), circle, float(p.mask_certainty), p.widest_slot, view.bearing,
            self._cells, self.density, self.blocked, self.slots, self._directions,
        )  # fmt: skip
        return count, found, must_slow, ahead

    def previous(self, view: View) -> float:
        """Direction chosen last, rad, pose frame; the heading where there is none."""
        return view.pose[2] if self._previous is None else self._previous

    def pick(self, view: View, cells: Floats, found: int, circle: float, must_slow: bool) -> tuple[int, bool, str]:
        """Choose among the first `found` of `_directions`.

        Args:
            cells: (n, 3), base frame. circle: Turning radius, m. must_slow: Whether the robot is already too fast.

        Returns:
            Index of the candidate, whether the robot must slow down for it, and a note on how it was found.
        """
        heading = view.pose[2]
        return (
            cheapest(self._directions, found, view.bearing, heading, self.previous(view), self.weights),
            must_slow,
            "",
        )


class VfhStarAvoidance(VfhPlusAvoidance):
    """Chooses the first candidate of the cheapest path of several steps (Ulrich & Borenstein 2000).

    Attributes:
        nodes: (limit, 10), search tree of the last tick, see lookahead.py; `node_count` rows are valid.
        way_end: Row of the last node of the chosen path.
        expanded: Number of nodes expanded.
    """

    params: VfhStarParams

    def __init__(self, params: VfhStarParams, robot: Robot, period: float) -> None:
        self.later = (
            params.projected_target_weight,
            params.projected_heading_weight,
            params.projected_previous_weight,
        )
        self.nodes = np.zeros((params.node_limit, 10))
        self.node_count, self.way_end, self.expanded = 0, -1, 0
        super().__init__(params, robot, period)

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

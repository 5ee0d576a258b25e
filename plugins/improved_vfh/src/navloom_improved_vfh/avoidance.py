"""One tick of the improved VFH: scans and pose in, velocity and reasons out (Hoang et al. 2013, III.C)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from navloom_avoidance.beams import Beams
from navloom_avoidance.certainty import THIN_BEAM, insert_beams, new_window, occupied_cells
from navloom_avoidance.clearance import free_command, nearest_ahead
from navloom_avoidance.decision import Decision
from navloom_avoidance.histogram import (
    enlarged_density,
    free_slots,
    sector_density,
    slot_directions,
    smooth,
    smoothing_gain,
)
from navloom_avoidance.method import Method
from navloom_avoidance.robot import Robot
from navloom_avoidance.search import Progress, RotationSearch, Trap
from navloom_avoidance.steering import turn_rate, wrap
from navloom_avoidance.support import new_record
from numba import njit
from numpy.typing import NDArray

from navloom_improved_vfh.steering import forward_speed, is_turning, select_direction

if TYPE_CHECKING:
    from navloom_improved_vfh.params import ImprovedVfhParams

Floats = NDArray[np.float64]
Pose = tuple[float, float, float]
Point = tuple[float, float]


class View(NamedTuple):
    """Inputs to the decision of one tick, in the pose frame except for the cells.

    Attributes:
        pose: x, y, m, heading, rad. twist: Present speed, m/s, and turn rate, rad/s. target: m.
        distance: Distance to the target, m. bearing: Direction of the target, theta_t, rad.
        cells: (n, 3), occupied cells: x, y, m, base frame, and certainty.
        directions: Candidate directions of the slots, rad.
        d30, run: Nearest distance ahead and free run straight ahead, m, see clearance.nearest_ahead().
    """

    pose: Pose
    twist: tuple[float, float]
    target: Point
    distance: float
    bearing: float
    cells: Floats
    directions: list[float]
    d30: float
    run: float


@njit(cache=True, nogil=True)
def survey(
    grid: NDArray[np.uint8],
    origin: NDArray[np.int64],
    cell: float,
    pose: tuple[float, float, float],
    edges: Floats,
    clears_footprint: bool,
    reach: float,
    horizon: float,
    radius: float,
    half_width: int,
    per_arc_cell: bool,
    threshold: float,
    widest: int,
    inset: float,
    target: float,
    ahead: tuple[float, float, float, float],
    cells: Floats,
    density: Floats,
    slots: NDArray[np.int64],
    directions: Floats,
) -> tuple[int, int, int, float, float]:
    """Compute occupied cells, density, slots, candidate directions and the clearance ahead, in one call.

    Args:
        grid, origin, cell, pose: As for certainty.insert_beams().
        edges: clearance.footprint_edges(). clears_footprint: Whether cells under the robot are set free.
        reach: Distance at which a cell's magnitude falls to 0, m.
        horizon: Cells farther than this do not enter the histogram, m.
        radius: Enlargement radius, m. If negative, cells are not enlarged: the density is summed and smoothed over
            2 half_width + 1 sectors.
        per_arc_cell, threshold, widest, inset, target: As for the functions of histogram.py.
        ahead: Half sector of d30, rad; front of the footprint, its half width, and the margin, m.
        cells, density, slots, directions: Outputs, filled in: (size * size, 3), (sectors,), (sectors // 2 + 1, 2),
            (3 * (sectors // 2 + 1),).

    Returns:
        Numbers of cells, slots and directions; d30 and free run, m.
    """
    heading = pose[2]
    count = occupied_cells(grid, origin, cell, pose, edges if clears_footprint else edges[:0], cells)
    near = cells[:count]
    if horizon < reach:
        kept = 0
        near = np.empty((count, 3))
        for i in range(count):
            if math.hypot(cells[i, 0], cells[i, 1]) <= horizon:
                near[kept] = cells[i]
                kept += 1
        near = near[:kept]
    if radius >= 0.0:
        enlarged_density(near, heading, radius, reach, density)
    else:
        rough = np.empty_like(density)
        sector_density(near, heading, cell, reach, per_arc_cell, rough)
        smooth(rough, half_width, density)
    found = free_slots(density, threshold, slots)
    candidates = slot_directions(slots, found, density.size, widest, inset, target, directions)
    d30, run = nearest_ahead(cells[:count], ahead[0], ahead[1], ahead[2], ahead[3])
    return count, found, candidates, d30, run


class Avoidance(Method):
    """The improved VFH for one robot: its certainty window and the state of its search.

    Attributes:
        cell: Side of a cell of the window, m. radius: Enlargement radius, m; negative for no enlargement.
        threshold: Density that blocks a sector.
        arc_margin: Margin between footprint and cell centres, m.
        arc_floor: Smaller margin that is kept where a cell is already within arc_margin, m.
    """

    def __init__(self, params: ImprovedVfhParams, robot: Robot, period: float) -> None:
        super().__init__(robot, period)
        self.params = params
        self.front = float(robot.footprint[:, 0].max())
        self.half_width = float(np.abs(robot.footprint[:, 1]).max())
        self.max_turn = min(math.radians(params.max_turn_deg), robot.max_angular)
        self.max_speed = min(params.max_speed, robot.max_linear)
        measured = self.front if params.distance_from == "front" else 0.0
        self._front = (math.radians(params.front_sector_deg), measured, self.half_width)
        self._slow = math.radians(params.slow_on_deg), math.radians(params.slow_off_deg)
        self._window, self._case = math.radians(params.slot_window_deg), math.radians(params.case_limit_deg)
        self._loyalty, self._pivot = math.radians(params.loyalty_deg), math.radians(params.pivot_deg)
        is_smoothed = params.enlargement == "none"
        self.threshold = params.threshold * (smoothing_gain(params.smoothing, False) if is_smoothed else 1.0)
        n = params.sectors
        self.density = np.zeros(n)
        self.slots = np.zeros((n // 2 + 1, 2), np.int64)
        self._directions = np.zeros(3 * (n // 2 + 1))
        self._is_laser = False
        self._beams: Beams | None = None
        self.reset()

    def reset(self) -> None:
        """Forget the window and the search."""
        super().reset()
        p = self.params
        self._open_window()
        self.search = RotationSearch(math.radians(p.rotation_deg))
        self.progress = Progress(p.progress_step, p.target_shift)
        self.trap = Trap(p.release_distance, math.radians(p.release_deg))
        self.slot_count = 0
        self._previous: float | None = None
        self._is_turning = False

    def decide(self, beams: Beams | None, pose: Pose, twist: tuple[float, float], target: Point) -> Decision:
        if beams is not None and beams.ranges.size:
            self.sense(beams, pose)
        view = self.look(pose, twist, target)
        if self.trap.place is not None:
            if self.trap.holds(pose, target, self.params.target_shift):
                return Decision(0.0, 0.0, "trapped", None, "trapped: neither robot nor target moved since")
            self.search.end()
            self.progress.restart()
        self.progress.note(view.distance, target)
        direction = self._choose(view)
        if direction is not None:
            return self._steer(view, direction)
        if self.progress.attempts > self.params.attempts:
            return self._give_up(view, f"no slot in {self.params.attempts} rotations without progress")
        why = "no slot: rotating " + ("left" if self.search.sign > 0 else "right")
        return self._send(view, 0.0, self.search.sign * self.max_turn, None, why)

    def _open_window(self) -> None:
        """Start an empty window with the resolution and margins that the sensors allow.

        A laser measures where an obstacle is; a cone measures only its distance.
        """
        p, is_laser = self.params, self._is_laser
        self.cell = p.laser_cell if is_laser else p.cell
        size = p.window if self.cell == p.cell else 2 * round(0.5 * p.window * p.cell / self.cell) + 1
        safety = p.laser_safety_distance if is_laser else p.safety_distance
        self.radius = self.half_width + safety if p.enlargement == "footprint" else -1.0
        self.arc_margin = p.laser_margin if is_laser else p.arc_margin
        self.arc_floor = min(p.laser_floor, p.laser_margin) if is_laser else p.arc_margin
        self.grid, self.origin = new_window(size)
        self.heard = new_record(size if p.consistency else 0)
        self._cells = np.zeros((size * size, 3))

    def sense(self, beams: Beams, pose: Pose) -> None:
        """Enter the readings of one tick into the window."""
        p = self.params
        if beams is not self._beams:  # for the same object, only the ranges have changed
            is_laser = bool((beams.half_angles < THIN_BEAM).all())
            if is_laser != self._is_laser:
                self._is_laser = is_laser
                self._open_window()
            self._beams = beams
            self._sensors = beams.sensors if p.conflict == "seen_through" else np.full_like(beams.sensors, -1)
        insert_beams(
            self.grid, self.origin, self.cell, pose, beams.origins, beams.bearings, beams.half_angles,
            beams.ranges, beams.limits, self._sensors, p.clear_margin,
            p.blind_depth, p.clears_blind_zone, p.reset_scope == "window",
            self.heard, p.consistency,
        )  # fmt: skip

    def look(self, pose: Pose, twist: tuple[float, float], target: Point) -> View:
        """Compute histogram, slots and clearances from the current window."""
        p = self.params
        distance = math.dist(target, pose[:2])
        bearing = math.atan2(target[1] - pose[1], target[0] - pose[0])
        horizon = distance + max(self.radius, self.half_width) if p.stops_at_target else math.inf
        count, self.slot_count, candidates, d30, run = survey(
            self.grid, self.origin, self.cell, pose, self.edges, p.clears_footprint, p.d_max, horizon, self.radius,
            p.smoothing, p.normalisation == "arc", self.threshold, p.widest_slot, p.inset, bearing,
            (*self._front, self.arc_margin), self._cells, self.density, self.slots, self._directions,
        )  # fmt: skip
        directions = self._directions[:candidates].tolist()
        return View(pose, twist, target, distance, bearing, self._cells[:count], directions, d30, run)

    def _choose(self, view: View) -> float | None:
        """Direction of a slot, rad, or None while a rotation is running or starts now."""
        heading = view.pose[2]
        if self.search.follow(heading):
            return None
        direction = select_direction(
            view.directions, heading, view.bearing, self._window, self._case, self._previous, self._loyalty
        )
        self._previous = direction
        if direction is None:
            self.progress.attempts += 1
            self.search.start(heading, view.bearing)
        else:
            self.search.end()
        return direction

    def _steer(self, view: View, direction: float) -> Decision:
        """Turn to the direction and drive as fast as the clearance ahead allows."""
        p, heading = self.params, view.pose[2]
        turn = turn_rate(direction, heading, p.turn_gain, self.max_turn)
        run = view.run if p.brakes else math.inf
        speed = forward_speed(
            view.d30, p.speed_gain, p.standoff, self.max_speed, run, self.robot.max_deceleration, self.motors.delay
        )  # fmt: skip
        self._is_turning = is_turning(turn, self._is_turning, *self._slow)
        if self._is_turning:
            speed /= p.slow_factor
        if abs(wrap(direction - heading)) > self._pivot:
            speed = 0.0
        why = f"slot {math.degrees(wrap(direction - view.bearing)):+.0f} deg off the target"
        return self._send(view, speed, turn, direction, why)

    def _send(self, view: View, speed: float, turn: float, direction: float | None, why: str) -> Decision:
        """Reduce the command to a collision-free one, and check the robot's progress."""
        p, r = self.params, self.robot
        sent = (speed, turn)
        if p.arc_check:
            sent = free_command(
                view.cells, self.edges, view.twist, (speed, turn), p.creep, self.period, r.max_acceleration,
                r.max_deceleration, p.turn_horizon, self.arc_margin, self.arc_floor, self.in_flight,
                r.motor_lag, r.dead_time,
            )  # fmt: skip
        if sent != (speed, turn):
            why += ", reduced by what is on the arc"
        is_clear = direction is not None and direction == view.bearing and sent == (self.max_speed, turn)
        progress = self.progress
        progress.stalled = 0.0 if is_clear else progress.stalled + self.period
        progress.blocked = progress.blocked + self.period if sent == (0.0, 0.0) else 0.0
        if progress.stalled > p.patience:
            return self._give_up(view, f"no progress in {p.patience:g} s")
        if progress.blocked > p.blocked_patience:
            progress.attempts += 1
            progress.blocked = 0.0
            if progress.attempts > p.attempts:
                return self._give_up(view, "no room to move or turn")
            self.search.sign = self.search.sign or (1 if turn > 0.0 else -1)
            self.search.reverse(view.pose[2])
        return Decision(*sent, "clear" if is_clear else "steering", direction, why)

    def _give_up(self, view: View, why: str) -> Decision:
        self.trap.place, self.trap.target = view.pose, view.target
        self._previous = None
        return Decision(0.0, 0.0, "trapped", None, "trapped: " + why)


def warm_up(*choices: ImprovedVfhParams) -> None:
    """Compile every kernel for the types of one tick, by running one tick for each parameter set."""
    square = np.array([[0.4, 0.4], [-0.4, 0.4], [-0.4, -0.4], [0.4, -0.4]])
    robot = Robot(square, 0.5, 0.4, 0.5, 1.0)
    for params in choices:
        Avoidance(params, robot, 0.05).step(Beams.sample(), (0.0, 0.0, 0.0), (0.0, 0.0), (3.0, 0.0))

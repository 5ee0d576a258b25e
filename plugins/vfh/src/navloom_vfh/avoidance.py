"""The parts of a tick that the three methods share: the window, the command, and the check of progress."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from navloom_avoidance.beams import Beams
from navloom_avoidance.certainty import new_window
from navloom_avoidance.clearance import disc_radius, free_command
from navloom_avoidance.decision import Decision
from navloom_avoidance.himm import enter_readings
from navloom_avoidance.method import Method
from navloom_avoidance.robot import Robot
from navloom_avoidance.search import Progress, RotationSearch, Trap
from numpy.typing import NDArray

from navloom_vfh.steering import forward_speed, turn_rate

if TYPE_CHECKING:
    from navloom_vfh.params import HistogramParams

Floats = NDArray[np.float64]
Pose = tuple[float, float, float]
Point = tuple[float, float]
STOPPED_BELOW = 0.01  # rad/s: a slower turn counts as stopped


@dataclass(frozen=True, slots=True)
class View:
    """Inputs to the decision of one tick, in the pose frame.

    Attributes:
        pose: x, y, m, heading, rad. twist: Present speed, m/s, and turn rate, rad/s. target: m.
        distance: Distance to the target, m. bearing: Direction of the target, rad.
        horizon: Cells farther than this do not count, m.
    """

    pose: Pose
    twist: tuple[float, float]
    target: Point
    distance: float
    bearing: float
    horizon: float


@dataclass(frozen=True, slots=True)
class Choice:
    """A method's result for one tick.

    Attributes:
        direction: Direction to steer to, rad, pose frame, or None where no direction is free.
        must_slow: Whether the robot is too fast to turn to it.
        ahead: h_c, density in the direction of travel.
        cells: (n, 3), occupied cells: x, y, m, base frame, and certainty.
        why: Reason, one phrase.
    """

    direction: float | None
    must_slow: bool
    ahead: float
    cells: Floats
    why: str


class HistogramAvoidance(Method):
    """A vector field histogram method for one robot; each method implements choose().

    Attributes:
        density: (sectors,), polar histogram of the last tick.
        slots: Its free slots, first sector and number of sectors; `slot_count` rows are valid.
        threshold: Density that blocks a sector.
        gain: Factor of the smoothing on the density of an obstacle; 1 without smoothing.
        reach: Distance at which a cell's magnitude falls to 0, m.
        remaining: Length of the path beyond the target of the next tick, m.
    """

    threshold: float
    gain = 1.0
    remaining = 0.0

    def __init__(self, params: HistogramParams, robot: Robot, period: float) -> None:
        super().__init__(robot, period)
        self.common = params
        disc = disc_radius(robot.footprint, params.disc)
        self.radius = disc + params.safety_distance if disc > 0.0 else 0.0
        self.reach = params.d_max
        self.slack = max(self.radius, disc_radius(robot.footprint, "inscribed"))
        self.max_turn = min(math.radians(params.max_turn_deg or math.inf), robot.max_angular)
        self.max_speed = min(params.max_speed or math.inf, robot.max_linear)
        n, size = params.sectors, params.window
        self.density = np.zeros(n)
        # At most every second sector begins a slot, and a slot gives at most three directions.
        self.slots = np.zeros((n // 2 + 1, 2), np.int64)
        self._directions = np.zeros(3 * (n // 2 + 1))
        self._cells, self._votes = np.zeros((size * size, 3)), np.zeros((size, size), np.uint8)
        self.reset()

    def reset(self) -> None:
        """Forget the window, the choice and the search."""
        super().reset()
        p = self.common
        self.grid, self.origin = new_window(p.window)
        self.search = RotationSearch(math.radians(p.rotation_deg))
        self.progress = Progress(p.progress_step, p.target_shift)
        self.trap = Trap(p.release_distance, math.radians(p.release_deg))
        self.slot_count = 0

    def enter(self, beams: Beams, pose: Pose) -> None:
        """Enter the readings of one tick."""
        enter_readings(self.grid, self.origin, self._votes, beams, pose, self.common)

    def picture(self) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
        """The certainty window, and the place of its first cell, in cells."""
        return self.grid, self.origin

    @abstractmethod
    def choose(self, view: View) -> Choice:
        """Choose the direction to steer to, from the window and the view."""

    def decide(self, beams: Beams | None, pose: Pose, twist: tuple[float, float], target: Point) -> Decision:
        if beams is not None and beams.ranges.size:
            self.enter(beams, pose)
        distance = math.dist(target, pose[:2])
        bearing = math.atan2(target[1] - pose[1], target[0] - pose[0])
        horizon = distance + self.slack if self.common.stops_at_target else math.inf
        view = View(pose, twist, target, distance, bearing, horizon)
        choice = self.choose(view)
        if self.trap.place is not None:
            if self.trap.holds(pose, target, self.common.target_shift):
                return Decision(0.0, 0.0, "trapped", None, "trapped: neither robot nor target moved since")
            self.search.end()
            self.progress.restart()
        self.progress.note(distance, target)
        if self.search.follow(pose[2]):
            return self._rotate(view, choice)
        if choice.direction is None:
            return self._search(view, choice)
        self.search.end()
        return self._steer(view, choice, choice.direction)

    def _search(self, view: View, choice: Choice) -> Decision:
        """Start a rotation because no direction is free, or give up."""
        self.progress.attempts += 1
        if self.progress.attempts > self.common.attempts:
            return self._give_up(view, f"nothing free in {self.common.attempts} rotations without progress")
        self.search.start(view.pose[2], view.bearing)
        return self._rotate(view, choice)

    def _rotate(self, view: View, choice: Choice) -> Decision:
        side = self.search.sign
        why = "nothing free: rotating " + ("left" if side > 0 else "right")
        return self._send(view, choice, 0.0, side * self.max_turn, None, why)

    def _steer(self, view: View, choice: Choice, direction: float) -> Decision:
        """Turn to the direction and drive as fast as the density ahead and the turn allow."""
        p = self.common
        turn = turn_rate(direction, view.pose[2], p.turn_gain, self.max_turn)
        # The greatest speed of a slow robot may be below the method's least.
        least = min(p.min_speed, self.max_speed)
        speed = forward_speed(choice.ahead, p.slow_density * self.gain, turn, self.max_turn, self.max_speed, least)
        return self._send(view, choice, least if choice.must_slow else speed, turn, direction, choice.why)

    def _send(
        self, view: View, choice: Choice, speed: float, turn: float, direction: float | None, why: str
    ) -> Decision:
        """Reduce the command to a collision-free one, and check the robot's progress."""
        sent = self.checked(view, choice, (speed, turn)) if self.common.arc_check else (speed, turn)
        if sent != (speed, turn):
            why += ", reduced by what is on the arc"
        is_clear = direction == view.bearing and choice.ahead == 0.0 and sent == (speed, turn)
        reason = self._watch(view, sent, is_clear)
        if reason:
            return self._give_up(view, reason)
        return Decision(*sent, "clear" if is_clear else "steering", direction, why)

    def checked(self, view: View, choice: Choice, wanted: tuple[float, float]) -> tuple[float, float]:
        """The wanted speed, m/s, and turn rate, rad/s, reduced until the robot can stop free."""
        p, r = self.common, self.robot
        return free_command(
            choice.cells, self.edges, view.twist, wanted, p.creep, self.period, r.max_acceleration,
            r.max_deceleration, p.turn_horizon, p.arc_margin, p.arc_margin, self.in_flight, r.motor_lag, r.dead_time,
        )  # fmt: skip

    def _watch(self, view: View, sent: tuple[float, float], is_clear: bool) -> str:
        """Count the time without progress; return why the robot is trapped, or an empty string."""
        p, progress = self.common, self.progress
        # Only time in which the robot executes these commands counts: stopped or driven by another source, it is not
        # trapped.
        obeyed = self.motors.obeyed(view.twist)
        elapsed = self.period if obeyed else 0.0
        progress.stalled += 0.0 if is_clear else elapsed
        is_stopped = sent[0] == 0.0 and abs(sent[1]) < STOPPED_BELOW
        progress.blocked = progress.blocked + elapsed if is_stopped else 0.0
        if progress.stalled > p.patience:
            return f"no progress in {p.patience:g} s"
        if progress.blocked > p.blocked_patience:
            progress.attempts += 1
            progress.blocked = 0.0
            if progress.attempts > p.attempts:
                return "no room to move or turn"
            self.search.sign = self.search.sign or 1
            self.search.reverse(view.pose[2])
        return ""

    def _give_up(self, view: View, why: str) -> Decision:
        self.trap.place, self.trap.target = view.pose, view.target
        return Decision(0.0, 0.0, "trapped", None, "trapped: " + why)

"""One tick of the dynamic window: scans and pose in, velocity and reasons out (Fox, Burgard & Thrun 1997)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from navloom_avoidance.beams import Beams
from navloom_avoidance.bodies import NO_BODIES, TrackedBodies, without_bodies
from navloom_avoidance.clearance import footprint_edges
from navloom_avoidance.echoes import Echoes
from navloom_avoidance.motors import Motors
from navloom_avoidance.robot import Robot
from navloom_avoidance.search import Progress, Trap
from numpy.typing import NDArray

from navloom_dwa.contact import enlarged_corners, first_contacts
from navloom_dwa.critics import score_critics
from navloom_dwa.field import centre_field, fill_field, obstacle_distance
from navloom_dwa.moving import BODY_SPEED, bodies_ahead, score_bodies
from navloom_dwa.objective import score_1997
from navloom_dwa.rollout import choose, highest_speeds, stays_free
from navloom_dwa.trail import TurnTrend, trail_ahead
from navloom_dwa.window import reachable, sample_arcs

if TYPE_CHECKING:
    from navloom_dwa.params import DwaParams

Floats = NDArray[np.float64]
Pose = tuple[float, float, float]
Point = tuple[float, float]
STOPPED_BELOW = (0.01, 0.02)  # m/s, rad/s: slower counts as stopped
STEPS = 20  # times along an arc at which tracked bodies are looked at
HELD = 0.5  # the gate holds the robot back if it lets less than this share of a command through


class Given(NamedTuple):
    """Inputs to the decision of one tick, in the pose frame.

    Attributes:
        time: s. pose: x, y, m, heading, rad, of the base. twist: Forward speed, m/s, and turn rate, rad/s.
        target: m. remaining: Length of the path after the target, m.
        share: Share of the last command that the gate let through. bodies: Tracked bodies now.
    """

    time: float
    pose: Pose
    twist: tuple[float, float]
    target: Point
    remaining: float
    share: float = 1.0
    bodies: TrackedBodies = NO_BODIES


class Decision(NamedTuple):
    """Answer of one tick.

    Attributes:
        speed: m/s. turn: rad/s. status: As in the Avoider role.
        arc, pace: Indices of the chosen arc and of the speed on it; -1 for none.
        why: Reason, one phrase; empty if an arc was chosen, see DynamicWindow.why().
    """

    speed: float
    turn: float
    status: Literal["clear", "steering", "trapped"]
    arc: int
    why: str = ""
    pace: int = -1


def is_stopped(v: float, w: float) -> bool:
    """Whether a velocity, m/s and rad/s, counts as stopped."""
    return abs(v) < STOPPED_BELOW[0] and abs(w) < STOPPED_BELOW[1]


class DynamicWindow:
    """The dynamic window for one robot, with its memory of obstacles, targets and blocked time.

    Attributes of the last tick:
        window: Lowest and highest v, m/s, and w, rad/s.
        arcs: (m, 4), from window.sample_arcs(). contacts: (m,), m along u; +inf for none.
        costs: (m, n), by arc and speed, +inf where not admissible.
        distance, origin: From field.fill_field().
    """

    def __init__(self, params: DwaParams, robot: Robot, period: float) -> None:
        p, self.params, self.robot, self.period = params, params, robot, period
        self.edges = footprint_edges(robot.footprint)
        self.inner = float(self.edges[:, 2].min())
        self.radius = float(np.hypot(robot.footprint[:, 0], robot.footprint[:, 1]).max())
        self.max_speed = min(p.max_speed or math.inf, robot.max_linear)
        self.max_turn = min(math.radians(p.max_turn_deg or math.inf), robot.max_angular)
        self.turn_acceleration = min(math.radians(p.turn_acceleration_deg), robot.max_angular_acceleration)
        self.motors = Motors.of(robot, period)
        self.rim_speed = p.wheel_speed if p.wheel_speed > 0.0 else math.inf
        # The largest: points with a smaller one are sorted out by their own.
        self.margin = max(p.laser_margin, p.sonar_margin)
        self.corners = enlarged_corners(self.edges, self.margin)
        self.reaction = period + self.motors.delay if p.reacts else 0.0
        self.weights = np.array(
            [p.goal_distance, p.goal_align, p.path_distance, p.path_align, p.obstacle, p.contact, p.turning]
        )
        self.arcs, self.contacts, self.limits = np.zeros((p.arcs, 4)), np.zeros(p.arcs), np.zeros(p.arcs)
        self.costs = np.zeros((p.arcs, p.speeds))
        self.distance, self.cost_to_go = (np.zeros((p.field, p.field), np.int32) for _ in range(2))
        self.times = np.linspace(p.horizon / STEPS, p.horizon, STEPS)
        self.echoes = Echoes(self.edges, p.echoes())
        self.reset()

    def reset(self) -> None:
        """Forget obstacles, targets and traps."""
        p = self.params
        self.echoes.reset()
        self.origin = np.zeros(2, np.int64)
        self.window = (0.0, 0.0, 0.0, 0.0)
        self.progress = Progress(p.progress_step, p.target_shift)
        self.trap = Trap(p.release_distance, math.radians(p.release_deg))
        self.trend = TurnTrend(p.oscillation_distance, math.radians(p.oscillation_deg))
        self._trail: list[Point] = []
        self._backed, self._backing = 0, None
        self._sent = (0.0, 0.0)
        self.motors.reset()
        self.in_flight = np.zeros((1, 2))

    _backing: Pose | None

    def step(self, lasers: Sequence[Beams], cones: Beams | None, given: Given) -> Decision:
        """Decide for one tick.

        Args:
            lasers: Readings of each laser in this tick. cones: Readings of all sonars, or None.
            given: The other inputs of the tick.
        """
        self.in_flight = self.motors.in_flight(given.twist, given.share)
        decision = self._decide(lasers, cones, given)
        self.motors.give(decision.speed, decision.turn)
        return decision

    def _decide(self, lasers: Sequence[Beams], cones: Beams | None, given: Given) -> Decision:
        p, pose, target = self.params, given.pose, given.target
        bodies = given.bodies if p.objective == "critics" else NO_BODIES
        static = [without_bodies(beams, pose, bodies) for beams in lasers]
        obstacles, gaps = self.echoes.see(static, cones, pose, given.time)
        if self.trap.place is not None:
            if self.trap.holds(pose, target, p.target_shift):
                return Decision(0.0, 0.0, "trapped", -1, "trapped: neither robot nor target moved since")
            self.progress.restart()
            self._backed, self._backing = 0, None
        if self.progress.note(math.dist(target, pose[:2]), target):
            self._backed = 0
        self._count_time(given)
        self.trend.follow(pose)
        if self._backing is not None:
            return self._back_up(given, obstacles, gaps)
        return self._steer(given, obstacles, gaps)

    def _count_time(self, given: Given) -> None:
        """Count the time without progress, while the robot executes these commands and no other source's."""
        elapsed = self.period if self.motors.obeyed(given.twist) else 0.0
        self.progress.stalled += elapsed
        # A robot that stands at its target is not blocked.
        is_there = math.dist(given.pose[:2], given.target) < self.params.progress_step
        is_blocked = is_stopped(*self._sent) and not is_there
        self.progress.blocked = self.progress.blocked + elapsed if is_blocked else 0.0

    def _steer(self, given: Given, obstacles: Floats, gaps: Floats) -> Decision:
        """Score the window and send its best velocity that stays free."""
        p, r = self.params, self.robot
        self._look(given, obstacles, gaps)
        arc, speed, v, w = choose(
            self.costs, self.arcs, given.twist, obstacles, gaps, self.edges, self.period,
            r.max_acceleration, r.max_deceleration, self.turn_acceleration, self.margin, p.roll_check,
            self.in_flight, r.motor_lag, r.dead_time,
        )  # fmt: skip
        is_clear = bool(np.isinf(self.contacts).all())
        if is_clear:
            # With nothing in the way, the time without progress is the path's, not the avoider's.
            self.progress.stalled = 0.0
        # Only at rest: a robot at speed brakes first.
        if self.progress.stalled > p.patience and abs(given.twist[0]) <= STOPPED_BELOW[0]:
            return self._give_up(given, f"no progress in {p.patience:g} s")
        if self.progress.blocked > p.blocked_patience and is_stopped(v, w):
            return self._recover(given, obstacles, gaps)
        if arc < 0 or self.progress.stalled > p.patience:
            # Braking on the arc that was found free one tick ago stays free, even if noise blocks it now.
            turn = float(self.in_flight[-1, 1]) if abs(given.twist[0]) > STOPPED_BELOW[0] else 0.0
            return self._send(0.0, turn, "nothing of the window is free: braking")
        self.trend.note(v, w, p.slow, given.pose)
        self._sent = (v, w)
        return Decision(v, w, "clear" if is_clear else "steering", arc, pace=speed)

    def _look(self, given: Given, obstacles: Floats, gaps: Floats) -> None:
        """Compute window, arcs, contacts, field and costs."""
        p, r, (v, w) = self.params, self.robot, self.in_flight[-1].tolist()
        low, high = reachable(v, 0.0, self.max_speed, r.max_acceleration, r.max_deceleration, p.window_time)
        turn = self.turn_acceleration
        self.window = (low, high, *reachable(w, -self.max_turn, self.max_turn, turn, turn, p.window_time))
        sample_arcs(self.window, self.radius, r.half_track, self.rim_speed, self.arcs)
        first_contacts(
            obstacles, gaps, self.corners, self.edges, self.radius, p.shape == "disc", self.margin,
            self.arcs, p.farthest, self.contacts,
        )  # fmt: skip
        highest_speeds(self.arcs, self.contacts, r.max_deceleration, self.turn_acceleration, self.reaction, self.limits)
        dx, dy = given.target[0] - given.pose[0], given.target[1] - given.pose[1]
        c, s = math.cos(given.pose[2]), math.sin(given.pose[2])
        target = (dx * c + dy * s, dy * c - dx * s)
        if p.objective == "1997":
            centre_field(self.origin, given.pose[0], given.pose[1], p.cell, p.field)
            obstacle_distance(obstacles, given.pose, self.origin, p.cell, self.distance)
            score_1997(
                self.arcs, self.limits, self.contacts, target, p.window_time, r.max_deceleration,
                self.turn_acceleration, self.max_speed, p.farthest, (p.alpha, p.beta, p.gamma), self.costs,
            )  # fmt: skip
            return
        fill_field(
            obstacles, given.pose, given.target, self.origin, p.cell, self.inner, p.soft, p.soft_weight,
            self.distance, self.cost_to_go,
        )  # fmt: skip
        path = trail_ahead(self._trail, given.pose[:2], given.target, p.target_shift)
        score_critics(
            self.arcs, self.limits, self.contacts, target, given.pose, p.horizon, p.nose, given.remaining, p.capture,
            path, self.cost_to_go, self.distance, self.origin, p.cell, self.inner, p.soft, self.weights,
            self.trend.sign, p.slow, (p.rotate_within, math.radians(p.rotate_deg)), self.costs,
        )  # fmt: skip
        bodies = given.bodies.within(given.pose[:2], (self.max_speed + BODY_SPEED) * p.horizon)
        if len(bodies.radii):
            ahead = bodies_ahead(bodies, given.pose, self.times, self.edges, p.track_margin, p.soft, p.sigmas)
            score_bodies(self.arcs, ahead, self.times, self.edges, p.obstacle, p.track, self.costs)

    def _recover(self, given: Given, obstacles: Floats, gaps: Floats) -> Decision:
        """Handle a blocked robot: back up, or give up after too many attempts."""
        p = self.params
        if p.back_up == 0.0 or self._backed >= p.back_ups:
            return self._give_up(given, f"blocked after backing up {self._backed} times")
        self._backed += 1
        self._backing = given.pose
        return self._back_up(given, obstacles, gaps)

    def _back_up(self, given: Given, obstacles: Floats, gaps: Floats) -> Decision:
        """Drive straight back until far enough or blocked."""
        p, r = self.params, self.robot
        assert self._backing is not None
        way = math.dist(given.pose[:2], self._backing[:2])
        command = (-min(p.back_speed, self.max_speed), 0.0)
        # The gate does not let a robot back into space that no sensor sees and where it has not been. A recovery can
        # still retrace the trail.
        is_held = self._sent == command and given.share < HELD
        if is_held and way < STOPPED_BELOW[0]:
            return self._give_up(given, "blocked, and the gate lets it not back up")
        if way < p.back_up and not is_held and stays_free(
            obstacles, gaps, self.edges, given.twist, command, self.period, r.max_acceleration, r.max_deceleration,
            self.turn_acceleration, self.margin, self.in_flight, r.motor_lag, r.dead_time,
        ):  # fmt: skip
            return self._send(*command, f"blocked: backing up, {way:.2f} of {p.back_up:g} m")
        self._backing = None
        if way < STOPPED_BELOW[0]:
            return self._give_up(given, "blocked, and no room to back up")
        return self._send(0.0, 0.0, f"backed up {way:.2f} m")

    def _send(self, v: float, w: float, why: str) -> Decision:
        """Send a command that is not on an arc of the window."""
        self._sent = (v, w)
        return Decision(v, w, "steering", -1, why)

    def _give_up(self, given: Given, why: str) -> Decision:
        self.trap.place, self.trap.target = given.pose, given.target
        self._sent, self._backing = (0.0, 0.0), None
        return Decision(0.0, 0.0, "trapped", -1, "trapped: " + why)

    def why(self, decision: Decision) -> str:
        """Reason of the last decision, one phrase: the window, its number of admissible velocities, and the choice."""
        if decision.arc < 0:
            return decision.why
        arc, (low, high, right, left) = decision.arc, self.window
        free = int(np.isfinite(self.costs).sum())
        ahead = "nothing" if math.isinf(self.contacts[arc]) else f"contact in {self.contacts[arc]:.2f} m"
        return (
            f"window {low:.2f}..{high:.2f} m/s, {math.degrees(right):+.0f}..{math.degrees(left):+.0f} deg/s: "
            f"{free} of {self.costs.size} admissible, cost {self.costs[arc, decision.pace]:.2f}, {ahead} on the arc"
        )

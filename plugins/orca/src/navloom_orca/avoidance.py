"""One tick of ORCA for a robot with two driven wheels: scans, tracks and target in, velocity and reason out.

The robot moves as a disc about an effective centre ahead of its axle, which can move in every direction at once (Snape,
van den Berg, Guy & Manocha 2010). Everything here is in the base frame that the robot has when a command acts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from navloom_avoidance.beams import Beams
from navloom_avoidance.bodies import BODY, TrackedBodies, without_bodies
from navloom_avoidance.clearance import footprint_edges
from navloom_avoidance.echoes import Echoes, EchoSettings
from navloom_avoidance.motors import Motors
from navloom_avoidance.robot import Robot
from navloom_avoidance.search import Progress, Trap
from navloom_dwa.avoidance import Given
from navloom_dwa.rollout import stays_free
from numpy.typing import NDArray

from navloom_orca.crowd import put_lines
from navloom_orca.half_planes import put, put_agent
from navloom_orca.outline import lines_of
from navloom_orca.programme import best_velocity

if TYPE_CHECKING:
    from navloom_orca.params import OrcaParams

Floats = NDArray[np.float64]
Pose = tuple[float, float, float]
Point = tuple[float, float]
STOPPED_BELOW = (0.01, 0.02)  # m/s, rad/s: slower counts as stopped
INSTANT = 1.0e3  # rad/s²: a robot without a limit of its turn acceleration stops turning at once
PROGRESS_STEP, TARGET_SHIFT = 0.1, 0.5  # m: approach that is progress; movement beyond which a target counts as new
HERE, STOOD = 0.1, 2.0  # m, s: a body that has moved by less for this time stands
RELEASE = (0.3, math.radians(45.0))  # m, rad: motion after which a trap is left
TOLERANCE = 0.06  # m: twice the noise of a laser
UNSURE = 0.4  # m: most that a track's covariance adds to its radius
SHORTER = (1.0, 0.5, 0.25, 0.125)  # shares of the horizon that are tried until some velocity is permitted
FEASIBLE, BINDS = 1.0e-6, 0.01  # m/s: violation that is rounding; how near to a border a velocity is held by it
LIMITS = 4  # half planes of the robot's limits
HELD_UP, ASIDE = 0.5, math.radians(90.0)  # share of a free robot's speed; rad/s: below it, it turns aside at this rate


class Decision(NamedTuple):
    """Answer of one tick: speed, m/s, turn rate, rad/s, status as in the Avoider role, and the reason, one phrase."""

    speed: float
    turn: float
    status: Literal["clear", "steering", "trapped"]
    why: str = ""


class Reciprocal:
    """ORCA of one robot.

    Attributes:
        ahead: Distance of the effective centre from the axle, m.
        radius: Of the disc about it that holds the footprint, m: tracks are kept clear of this.
        slowest: Highest speed backwards, m/s, negative.
        half_width: Of the footprint, m: lines are kept clear of this. stays_free() guards the corners.
        planes: (n, 4) half planes of the last tick: the limits, lines, tracks. wanted: Velocity of the centre, m/s.
        taken: Velocity of the centre that was chosen, m/s. obstacles: (n, 3) as from Echoes.see().
        waits: Whether bodies that do not stand hold the robot up.
    """

    def __init__(self, params: OrcaParams, robot: Robot, period: float) -> None:
        p, self.params, self.robot, self.period = params, params, robot, period
        self.edges = footprint_edges(robot.footprint)
        self.slowest = -min(p.reverse, robot.max_linear)
        self.ahead = p.centre * float(self.edges[:, 2].min())
        self.radius = float(np.hypot(robot.footprint[:, 0] - self.ahead, robot.footprint[:, 1]).max())
        self.half_width = float(np.abs(robot.footprint[:, 1]).max())
        by_wheels = robot.max_acceleration / robot.half_track if robot.half_track > 0.0 else math.inf
        self.turn_change = min(robot.max_angular_acceleration, by_wheels, INSTANT)
        self.motors = Motors.of(robot, period)
        self.margin = max(p.laser_margin, p.sonar_margin)
        # Speeds fall in proportion to the gap, at first by speed / horizon: no more than the gate's deceleration.
        self.line_horizon = robot.max_linear / robot.max_deceleration + self.motors.delay + period
        self.sight = robot.max_linear * self.line_horizon + self.radius + self.margin
        self.echoes = Echoes(self.edges, EchoSettings((p.laser_margin, p.sonar_margin), p.memory, self.sight + 1.0))
        self.reset()

    def reset(self) -> None:
        """Forget obstacles, commands and traps."""
        self.echoes.reset()
        self.motors.reset()
        self.in_flight = np.zeros((1, 2))
        self.progress = Progress(PROGRESS_STEP, TARGET_SHIFT)
        self.trap = Trap(*RELEASE)
        self.planes, self.obstacles, self._gaps = np.zeros((0, 4)), np.zeros((0, 3)), np.zeros(0)
        self.wanted, self.taken, self._sent, self._aside = (0.0, 0.0), (0.0, 0.0), (0.0, 0.0), 0.0
        self.waits, self._stood = False, np.zeros((0, 3))

    def step(self, lasers: Sequence[Beams], cones: Beams | None, given: Given) -> Decision:
        """Decide for one tick.

        Args:
            lasers: Readings of each laser in this tick. cones: Readings of all sonars, or None.
            given: The other inputs of the tick.
        """
        self.in_flight = self.motors.in_flight(given.twist, given.share)
        decision = self._decide(lasers, cones, given)
        self._sent = (decision.speed, decision.turn)
        self.motors.give(*self._sent)
        return decision

    def _decide(self, lasers: Sequence[Beams], cones: Beams | None, given: Given) -> Decision:
        p, pose, target = self.params, given.pose, given.target
        bodies = given.bodies.within(pose[:2], p.reach)
        stand = self._stand(bodies, given.time)
        if p.standing_by_echoes:
            bodies, stand = TrackedBodies(*(values[~stand] for values in bodies)), stand[~stand]
        given = given._replace(bodies=bodies)
        static = [without_bodies(beams, pose, given.bodies) for beams in lasers]
        self.obstacles, self._gaps = self.echoes.see(static, cones, pose, given.time)
        if self.trap.holds(pose, target, TARGET_SHIFT):
            return Decision(0.0, 0.0, "trapped", "trapped: neither robot nor target moved since")
        self._count_time(given)
        self._choose(given, ~stand)
        command, is_free = self._validated(given)
        is_blocked = self.progress.blocked > p.blocked_patience and is_stopped(*command)
        if is_blocked or (self.progress.stalled > p.patience and abs(given.twist[0]) <= STOPPED_BELOW[0]):
            self.trap.place, self.trap.target = pose, target
            self.progress.restart()
            return Decision(0.0, 0.0, "trapped", "trapped: blocked" if is_blocked else "trapped: no progress")
        is_clear = is_free and len(self.planes) == LIMITS
        return Decision(*command, "clear" if is_clear else "steering", self.why(is_free))

    def _stand(self, bodies: TrackedBodies, time: float) -> NDArray[np.bool_]:
        """(n,) which bodies have stood for a while, at a time, s: they give way to no one."""
        stood, since, places = self._stood, np.full(len(bodies.radii), time), bodies.positions.copy()
        if len(stood) and len(places):
            gaps = np.hypot(*(places[:, None] - stood[:, :2]).transpose(2, 0, 1))
            rows, stays = gaps.argmin(axis=1), gaps.min(axis=1) < HERE
            since[stays], places[stays] = stood[rows[stays], 2], stood[rows[stays], :2]
        self._stood = np.column_stack([places, since])
        stand: NDArray[np.bool_] = time - since >= STOOD
        return stand

    def _count_time(self, given: Given) -> None:
        """Count the time without progress, while the robot follows this avoider's commands."""
        left = math.dist(given.pose[:2], given.target)
        self.progress.note(left, given.target)
        # A robot that gives way is not trapped: what moves clears its way.
        elapsed = self.period if self.motors.obeyed(given.twist) and not self.waits else 0.0
        self.progress.stalled += elapsed
        is_blocked = is_stopped(*self._sent) and left > PROGRESS_STEP
        self.progress.blocked = self.progress.blocked + elapsed if is_blocked else 0.0

    def _choose(self, given: Given, are_moving: NDArray[np.bool_]) -> None:
        """Set up the half planes, and solve the programme for the velocity of the effective centre.

        Args:
            given: Inputs of the tick. are_moving: (n,) which of its bodies do not stand.
        """
        p, r = self.params, self.robot
        moved = self._when_it_acts(given.twist)
        bodies = self._bodies(given, moved)
        radii = self.radius + bodies.radii + p.track_margin + np.minimum(p.sigmas * bodies.sigmas(), UNSURE)
        points = self._relative(self.obstacles[:, :2], moved)
        if len(bodies.radii):
            is_static = self._are_static(points, bodies)
            self.obstacles, self._gaps, points = self.obstacles[is_static], self._gaps[is_static], points[is_static]
        radius = self.half_width + self.margin
        lines = lines_of(points, 0.0, 0.0, self.sight, 2.0 * radius, TOLERANCE)
        planes = np.zeros((LIMITS + len(lines) + len(bodies.radii), 4))
        now = self._limit(planes)
        walls, gaps = np.empty(len(lines), np.int64), np.empty(len(lines))
        rows = put_lines(
            lines, 0.0, 0.0, now, radius, self.sight, self.line_horizon, walls, gaps, planes[LIMITS:]
        )  # fmt: skip
        hard = LIMITS + rows
        self.wanted = self._wanted(given, moved)
        fastest = 1.0 + math.hypot(r.max_linear, self.ahead * r.max_angular)
        walls_alone, scratch = planes.copy(), np.zeros_like(planes)
        for shorter in SHORTER:
            planes[:] = walls_alone
            rows = hard
            for k in range(len(bodies.radii)):
                (px, py), (vx, vy) = bodies.positions[k].tolist(), bodies.velocities[k].tolist()
                rows = put_agent(
                    planes, rows, (px, py), now, (now[0] - vx, now[1] - vy), float(radii[k]),
                    shorter * p.horizon, self.period, p.share,
                )  # fmt: skip
            self.planes = planes[:rows]
            self.taken = best_velocity(planes, rows, LIMITS, hard, fastest, *self.wanted, scratch)
            if self._violations(hard, np.array([self.taken]))[0] < FEASIBLE:
                break
        self._step_aside(bool((self._beyond(hard, np.array([self.taken]))[0, are_moving] > -BINDS).any()))

    def _step_aside(self, others_bind: bool) -> None:
        """Turn the wanted velocity of the next tick farther to the right while others hold the robot up, else back.

        Two that stop for each other then pass: the right-hand heuristic of Zhou, Wang, Bandyopadhyay & Schwager 2017.
        """
        free = np.clip(self.wanted, (self.planes[1, 0], self.planes[3, 1]), (self.planes[0, 0], self.planes[2, 1]))
        self.waits = others_bind and free @ self.taken < HELD_UP * (free @ free)
        step = ASIDE * self.period
        self._aside = min(
            max(self._aside + (step if self.waits else -step), 0.0), math.radians(self.params.keep_right_deg)
        )

    def _when_it_acts(self, twist: tuple[float, float]) -> Pose:
        """Pose of the base when a command acts, in the present base frame: m and rad."""
        v, w = 0.5 * (twist[0] + self.in_flight[-1, 0]), 0.5 * (twist[1] + self.in_flight[-1, 1])
        time = self.motors.delay
        return v * time * math.cos(0.5 * w * time), v * time * math.sin(0.5 * w * time), w * time

    def _relative(self, points: Floats, moved: Pose) -> Floats:
        """(n, 2) points of the present base frame, m, seen from the effective centre when the command acts."""
        c, s = math.cos(moved[2]), math.sin(moved[2])
        x, y = points[:, 0] - moved[0], points[:, 1] - moved[1]
        return np.column_stack([c * x + s * y - self.ahead, c * y - s * x])

    def _bodies(self, given: Given, moved: Pose) -> TrackedBodies:
        """Bodies within reach when the command acts, as seen from the effective centre; covariances are not turned."""
        pose = given.pose
        bodies = given.bodies.after(self.motors.delay)
        c, s = math.cos(pose[2]), math.sin(pose[2])
        turned = np.array([[c, -s], [s, c]])
        places = self._relative((bodies.positions - pose[:2]) @ turned, moved)
        c, s = math.cos(moved[2]), math.sin(moved[2])
        speeds = bodies.velocities @ turned @ np.array([[c, -s], [s, c]])
        return bodies._replace(positions=places, velocities=speeds)

    def _are_static(self, points: Floats, bodies: TrackedBodies) -> NDArray[np.bool_]:
        """(n,) whether obstacles, (n, 2) seen from the effective centre, are of no track."""
        now = bodies.positions - self.motors.delay * bodies.velocities
        gaps = np.hypot(*(points[:, None] - now[None]).transpose(2, 0, 1)) - bodies.radii
        are_static: NDArray[np.bool_] = (gaps > BODY).all(axis=1)
        return are_static

    def _limit(self, planes: Floats) -> tuple[float, float]:
        """Write the half planes of what the robot can reach; return its velocity so far, of the centre, m/s."""
        p, r, (v, w) = self.params, self.robot, self.in_flight[-1].tolist()
        up, down = (r.max_acceleration, r.max_deceleration) if v >= 0.0 else (r.max_deceleration, r.max_acceleration)
        high = max(min(v + up * p.window, r.max_linear), self.slowest)
        low = min(max(v - down * p.window, self.slowest), high)
        turn, change = r.max_angular, self.turn_change * p.window
        left, right = max(min(w + change, turn), -turn), min(max(w - change, -turn), turn)
        put(planes, 0, high, 0.0, 0.0, 1.0)
        put(planes, 1, low, 0.0, 0.0, -1.0)
        put(planes, 2, 0.0, self.ahead * left, -1.0, 0.0)
        put(planes, 3, 0.0, self.ahead * right, 1.0, 0.0)
        return v, self.ahead * w

    def _wanted(self, given: Given, moved: Pose) -> tuple[float, float]:
        """Wanted velocity of the centre: to the target, so slowly that it can stop at the end of the path.

        To a target behind, the robot turns in place.
        """
        pose, r = given.pose, self.robot
        dx, dy = given.target[0] - pose[0], given.target[1] - pose[1]
        c, s = math.cos(pose[2]), math.sin(pose[2])
        ((x, y),) = self._relative(np.array([[c * dx + s * dy, c * dy - s * dx]]), moved).tolist()
        x += self.ahead
        distance = math.hypot(x, y)
        way = max(0.0, distance + given.remaining - r.max_deceleration * self.period**2)
        speed = min(r.max_linear, math.sqrt(r.max_deceleration * way))
        bearing = math.remainder(math.atan2(y, x) - self._aside, math.tau)
        side = math.sin(bearing) if abs(bearing) < 0.5 * math.pi else math.copysign(1.0, bearing)
        return speed * max(0.0, math.cos(bearing)), speed * side

    def _validated(self, given: Given) -> tuple[tuple[float, float], bool]:
        """The chosen velocity, or less of it, from which it can stop in free space; whether it is the first."""
        v, w = self.taken[0], self.taken[1] / self.ahead
        to_target = math.copysign(min(abs(self.wanted[1]) / self.ahead, self.robot.max_angular), self.wanted[1])
        trials = [(v, w), (0.5 * v, w), (0.5 * v, 0.5 * w), (0.5 * v, 0.0), (0.0, w), (0.0, to_target)]
        for k, trial in enumerate(trials):
            command = self._reachable(*trial)
            if self._is_free(command, given):
                return command, k == 0
        turn = self._reachable(0.0, float(self.in_flight[-1, 1]))[1]
        return (0.0, turn if abs(given.twist[0]) > STOPPED_BELOW[0] else 0.0), False

    def _reachable(self, v: float, w: float) -> tuple[float, float]:
        """A wanted command, m/s and rad/s, with the turn rate that can be commanded in one tick."""
        change, before = self.turn_change * self.period, float(self.in_flight[-1, 1])
        return v, min(max(w, before - change), before + change)

    def _is_free(self, command: tuple[float, float], given: Given) -> bool:
        """Whether one period of a command, and braking after it, keeps the margin of every echo not of a track."""
        r = self.robot
        return stays_free(
            self.obstacles, self._gaps, self.edges, given.twist, command, self.period, r.max_acceleration,
            r.max_deceleration, self.turn_change, self.margin, self.in_flight, r.motor_lag, r.dead_time,
        )  # fmt: skip

    def violations(self, velocities: Floats) -> Floats:
        """(n,) greatest violation of the half planes of lines and tracks by velocities (n, 2) of the centre, m/s."""
        return self._violations(LIMITS, velocities)

    def _violations(self, first: int, velocities: Floats) -> Floats:
        """The same for the half planes from a row on."""
        worst: Floats = self._beyond(first, velocities).max(axis=1, initial=0.0)
        return worst

    def _beyond(self, first: int, velocities: Floats) -> Floats:
        """(n, k) how far velocities are beyond each border from a row on, m/s; negative where they are permitted."""
        planes = self.planes[first:]
        return planes[:, 2] * (planes[:, 1] - velocities[:, 1:]) - planes[:, 3] * (planes[:, 0] - velocities[:, :1])

    def why(self, is_free: bool) -> str:
        """Reason of a command, one phrase."""
        beyond = float(self.violations(np.array([self.taken]))[0])
        count = len(self.planes) - LIMITS
        reason = f"{count} half planes, violated by {beyond:.2f} m/s at most"
        return reason if is_free else f"the velocity is not free of echoes; {reason}"


def is_stopped(v: float, w: float) -> bool:
    """Whether a velocity, m/s and rad/s, counts as stopped."""
    return abs(v) < STOPPED_BELOW[0] and abs(w) < STOPPED_BELOW[1]

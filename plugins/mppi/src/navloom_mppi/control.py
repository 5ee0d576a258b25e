"""One tick of model predictive path integral control: scans, pose and path in, velocity and reasons out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from navloom_avoidance.beams import Beams
from navloom_avoidance.bodies import NO_BODIES, TrackedBodies, without_bodies
from navloom_avoidance.clearance import footprint_edges
from navloom_avoidance.echoes import Echoes, EchoSettings
from navloom_avoidance.motors import Motors
from navloom_avoidance.robot import Robot
from navloom_avoidance.search import Progress, Trap
from navloom_dwa.field import CHAMFER, fill_field, obstacle_distance
from navloom_dwa.moving import BODY_SPEED, bodies_ahead
from navloom_dwa.rollout import stays_free
from numpy.typing import NDArray

from navloom_mppi.critics import COLLISION, CRITICS, Scene
from navloom_mppi.motion import Motion, after_dead_time, follow, motion_of, near_goal, turn_within
from navloom_mppi.nearest import body_points, fill_nearest, gap_beside
from navloom_mppi.rollout import draw, knots_of, roll_out, roll_out_plan
from navloom_mppi.weighting import bounded, effective, evade, mean_of, proposal, shifted, smooth, weights_of

if TYPE_CHECKING:
    from navloom_mppi.params import MppiParams

Floats = NDArray[np.float64]
Pose = tuple[float, float, float]
Point = tuple[float, float]
HERE = (0.0, 0.0, 0.0)
STOPPED_BELOW = (0.01, 0.02)  # m/s, rad/s: slower counts as stopped
HELD = 0.5  # the gate holds the robot back if it lets less than this share of a command through
FIELD, NEAR = 120, 160  # cells along a side of the field of the way left, and of the window of nearest obstacles
NEAR_CELL = 0.05  # m
REACH = (2.0, 6.0)  # m: bounds of the field's half width
BORDER = 0.95  # share of the half width within which the path's farthest point is looked for
BEYOND = 1.07  # half width of the field / longest way of a roll-out
PROGRESS_STEP, TARGET_SHIFT = 0.1, 0.5  # m: approach that is progress; movement beyond which a target counts as new
RELEASE = (0.3, math.radians(45.0))  # m, rad: motion after which a trap is left
COMMANDS = (4, 8)  # parts of the reachable speeds and turn rates in which one roll-out each is tried
INSTANT = 1.0e3  # rad/s²: a robot without a limit of its turn acceleration stops turning at once
MOVES = 0.2  # m/s: slower bodies are taken to stand
DRAWN, DRAWN_EVERY = 64, 4  # roll-outs of a picture, and steps between their points
OCCUPIED = 0.05  # share of the path near obstacles beyond which the robot does not align to it, as in Nav2


class Given(NamedTuple):
    """Inputs to the decision of one tick, map frame.

    Attributes:
        time: s. pose: x, y, m, heading, rad, of the base. twist: Forward speed, m/s, and turn rate, rad/s.
        path: (n, 2) the trajectory from the robot's place on it to its end, m; n >= 1.
        turn_to: Heading to turn to at the end, rad, or None.
        share: Share of the last command that the gate let through. bodies: Tracked bodies now.
    """

    time: float
    pose: Pose
    twist: tuple[float, float]
    path: Floats
    turn_to: float | None = None
    share: float = 1.0
    bodies: TrackedBodies = NO_BODIES


class Decision(NamedTuple):
    """Answer of one tick: speed, m/s, turn rate, rad/s, status as in the Avoider role, and the reason, one phrase."""

    speed: float
    turn: float
    status: Literal["clear", "steering", "trapped"]
    why: str = ""


class Drawn(NamedTuple):
    """Roll-outs of one tick for a picture, base frame.

    Attributes:
        points: (n, points, 2) m; a roll-out that collides stays at the last point before.
        costs: (n,) from 0, the cheapest, to 1, the dearest without a collision; infinite with one.
        plan: (points, 2) the plan, m.
        critics: (critics,) weighted cost of the plan by each critic, in the order of CRITICS.
    """

    points: Floats
    costs: Floats
    plan: Floats
    critics: Floats


class PathIntegral:
    """Model predictive path integral control of one robot.

    Attributes of the last tick:
        scene: Surroundings of the robot.
        parts: (samples, critics) cost of each roll-out by each critic. part: (critics,) that of the plan.
        ends: (samples,) bearing of the end of each, rad, base frame.
        costs: (samples,) their weighted sums. weights: (samples,).
        plan: (steps, 2) commands, m/s and rad/s. track: (steps, 5) its poses, base frame, see rollout.drive().
    """

    scene: Scene

    def __init__(self, params: MppiParams, robot: Robot, period: float, stream: np.random.Generator) -> None:
        p, self.params, self.robot, self.period, self.stream = params, params, robot, period, stream
        self.edges = footprint_edges(robot.footprint)
        self.inner = float(self.edges[:, 2].min())
        self.body, disc = body_points(robot.footprint)
        self.nose = float(np.hypot(robot.footprint[:, 0], robot.footprint[:, 1]).max())
        radius: float | None = p.turning_radius
        self.motion = motion_of(robot, p.step, p.reverse, robot.turn_radius if radius is None else radius)
        self.sigma = (p.noise_speed * robot.max_linear, p.noise_turn * robot.max_angular)
        self.motors = Motors.of(robot, period)
        self.margin = max(p.laser_margin, p.sonar_margin)
        self.near_reach = disc + self.margin + p.soft
        self.reach = min(max(BEYOND * robot.max_linear * p.step * p.steps, REACH[0]), REACH[1])
        self.cell = 2.0 * self.reach / FIELD
        self.times: Floats = robot.dead_time + p.step * np.arange(1.0, p.steps + 1.0)
        self.bodies_reach = (robot.max_linear + BODY_SPEED) * float(self.times[-1])
        margins = (p.laser_margin, p.sonar_margin)
        self.echoes = Echoes(self.edges, EchoSettings(margins, p.memory, self.reach))
        self.by_critic = weights_by_critic(p, robot)
        given: float | None = p.goal_within
        self.goal_within = near_goal(robot, period) if given is None else given
        self.turn_beyond = math.radians(p.turn_beyond_deg)
        # Where a turn takes longer, no roll-out gets to the way after it, and nothing pays for turning at a door post.
        self.turn_near_goal = min(self.turn_beyond, turn_within(robot, 0.5 * p.step * p.steps))
        self.samples = 2 * math.ceil(p.samples / 2)
        self.parts, self.track = np.zeros((self.samples, len(CRITICS))), np.zeros((p.steps, 5))
        self.ends = np.zeros(self.samples)
        self._nearest, self._squares = np.zeros((NEAR, NEAR), np.int32), np.zeros((NEAR, NEAR), np.float32)
        self._cost_to_go, self.distance, self._path_distance = (np.zeros((FIELD, FIELD), np.int32) for _ in range(3))
        self.origin = np.zeros(2, np.int64)
        self.reset()

    def reset(self) -> None:
        """Forget obstacles, the plan and traps."""
        self.echoes.reset()
        self.motors.reset()
        self.in_flight = np.zeros((1, 2))
        self.plan, self._past = np.zeros((self.params.steps, 2)), np.zeros((4, 2))
        self.costs, self.weights = np.zeros(self.samples), np.full(self.samples, 1.0 / self.samples)
        self.progress = Progress(PROGRESS_STEP, TARGET_SHIFT)
        self.trap = Trap(*RELEASE)
        self._sent = (0.0, 0.0)
        self._held: Pose | None = None

    def step(self, lasers: Sequence[Beams], cones: Beams | None, given: Given) -> Decision:
        """Decide for one tick.

        Args:
            lasers: Readings of each laser in this tick. cones: Readings of all sonars, or None.
            given: The other inputs of the tick.
        """
        self.in_flight = self.motors.in_flight(given.twist, given.share)
        decision = self._decide(lasers, cones, given)
        self._sent = (decision.speed, decision.turn)
        self._past = np.vstack([self._past[1:], self._sent])
        self.motors.give(*self._sent)
        return decision

    def _decide(self, lasers: Sequence[Beams], cones: Beams | None, given: Given) -> Decision:
        p, pose = self.params, given.pose
        static = [without_bodies(beams, pose, given.bodies) for beams in lasers]
        obstacles, gaps = self.echoes.see(static, cones, pose, given.time)
        path = in_base(given.path, pose)
        self._look(obstacles, path, given)
        goal = (float(given.path[-1, 0]), float(given.path[-1, 1]))
        if self.trap.holds(pose, goal, TARGET_SHIFT):
            return Decision(0.0, 0.0, "trapped", "trapped: neither robot nor goal moved since")
        self._count_time(given, length_of(path), goal)
        self._optimise(given)
        command, why = self._validated(obstacles, gaps, given)
        is_blocked = self.progress.blocked > p.blocked_patience and is_stopped(*command)
        if is_blocked or (self.progress.stalled > p.patience and abs(given.twist[0]) <= STOPPED_BELOW[0]):
            self.trap.place, self.trap.target = pose, goal
            self.progress.restart()
            self.plan[:] = 0.0
            return Decision(0.0, 0.0, "trapped", "trapped: blocked" if is_blocked else "trapped: no progress")
        is_clear = (not len(gaps) or gaps[0] > self.margin + p.soft) and not self.scene.bodies.size
        return Decision(*command, "clear" if is_clear else "steering", why)

    def _count_time(self, given: Given, left: float, goal: Point) -> None:
        """Count the time without progress along the path, while the robot follows this avoider's commands."""
        self.progress.note(left, goal)
        # A robot that gives way is not trapped: what moves clears its way.
        waits = self._moving(given)
        elapsed = self.period if self.motors.obeyed(given.twist) and not waits else 0.0
        self.progress.stalled += elapsed
        # A robot that stands at its goal is not blocked.
        is_blocked = is_stopped(*self._sent) and left > PROGRESS_STEP
        self.progress.blocked = self.progress.blocked + elapsed if is_blocked else 0.0

    def _moving(self, given: Given) -> bool:
        """Whether a body that moves is so near that the robot may have to give way."""
        near = given.bodies.within(given.pose[:2], self.bodies_reach)
        return bool((np.hypot(near.velocities[:, 0], near.velocities[:, 1]) > MOVES).any())

    def _look(self, obstacles: Floats, path: Floats, given: Given) -> None:
        """Compute the fields around the robot and what the critics need of the path."""
        p = self.params
        outside = np.flatnonzero(np.abs(path).max(axis=1) > BORDER * self.reach)
        near = path[: max(1, int(outside[0]))] if len(outside) else path
        target = (float(near[-1, 0]), float(near[-1, 1]))
        fill_field(
            obstacles, HERE, target, self.origin, self.cell, self.inner, p.soft, p.soft_weight,
            self.distance, self._cost_to_go,
        )  # fmt: skip
        obstacle_distance(near, HERE, self.origin, self.cell, self._path_distance)
        fill_nearest(obstacles, NEAR_CELL, self.near_reach, self._nearest, self._squares)
        columns, rows = (near / self.cell + 0.5 * FIELD).astype(np.int64).clip(0, FIELD - 1).T
        occupied = float((self.distance[rows, columns] * self.cell / CHAMFER < self.inner).mean())
        arc = arc_of(path)
        lead = path[min(len(path) - 1, int(np.searchsorted(arc, self.inner + p.soft)))]
        goal = (float(path[-1, 0]), float(path[-1, 1]))
        is_beside = math.hypot(*lead) > STOPPED_BELOW[0]
        bearing = math.atan2(lead[1], lead[0]) if is_beside and given.turn_to is None else 0.0
        is_near_goal = bool(arc[-1] < self.goal_within)
        turns_away = abs(bearing) > (self.turn_near_goal if is_near_goal else self.turn_beyond)
        # Straight towards a goal behind a corner, the robot would drive to the wall in between, and wait there.
        # Within its nose of the goal, the way that is left of the nose no longer leads there.
        turns_first = turns_away and arc[-1] > self.nose
        is_near_goal = is_near_goal and not turns_first and not len(outside)
        is_near_goal = is_near_goal and gap_beside(obstacles, goal) >= self.inner
        self.scene = Scene(
            obstacles, self._nearest, 1.0 / NEAR_CELL, self.nose, self.body, self.edges, p.soft,
            self._cost_to_go, self._path_distance, self.origin, self.cell,
            goal, is_near_goal, (float(lead[0]), float(lead[1])), turns_away, occupied <= OCCUPIED,
            math.nan if given.turn_to is None else given.turn_to - given.pose[2],
            bodies_ahead(
                given.bodies.within(given.pose[:2], self.bodies_reach), given.pose, self.times, self.edges,
                p.track_margin, p.soft, p.sigmas, p.headway,
            ),
            p.body, p.track_clearance,
        )  # fmt: skip

    def _optimise(self, given: Given) -> None:
        """Williams et al. 2017, Algorithm 2: shift the plan, roll it out with noise, and take the weighted mean."""
        p, m = self.params, self._allowed(given)
        if self.scene.bodies.size and self._held is None:
            m = m._replace(slowest=-self.robot.max_linear)
        start = after_dead_time(given.twist, self.in_flight, self.robot.dead_time, self.period, m)
        before = shifted(self.plan, self.period, p.step)
        noise, paces = proposal(self.stream, self.samples, knots_of(p.steps, p.hold))
        if self.scene.bodies.size:
            evade(noise, paces, self.sigma, (m.slowest, m.fastest, m.turn))
        roll_out(before, noise, paces, self.sigma, p.hold, start, m, self.scene, self.parts, self.ends)
        self.costs = self.parts @ self.by_critic
        self.weights = weights_of(self.costs, p.temperature)
        mean = mean_of(before, self.weights, noise, paces, self.sigma, p.hold)
        mean = smooth(bounded(mean, m.slowest, m.fastest, m.turn), self._past)
        self._proposal, self._start, self._motion = (before, noise, paces), start, m
        self._take(bounded(mean, m.slowest, m.fastest, m.turn))
        best = int(self.costs.argmin())
        if self.part[COLLISION] > 0.0 and self.parts[best, COLLISION] == 0.0:
            # The mean of roll-outs on both sides of an obstacle leads into it.
            self._take(self._sample(best))

    def _allowed(self, given: Given) -> Motion:
        """The robot's motion; not backwards where the gate held it.

        Where no sensor looks, the gate lets a robot back up only where it has been.
        """
        if self._held is not None and math.dist(given.pose[:2], self._held[:2]) > RELEASE[0]:
            self._held = None
        if given.share < HELD and self._sent[0] < 0.0:
            self._held = given.pose
        return self.motion if self._held is None else self.motion._replace(slowest=0.0)

    def _sample(self, k: int) -> Floats:
        """(steps, 2) controls of one roll-out."""
        (before, noise, paces), m = self._proposal, self._motion
        alone = np.zeros(self.samples)
        alone[k] = 1.0
        sample = mean_of(before, alone, noise, paces, self.sigma, self.params.hold)
        return bounded(sample, m.slowest, m.fastest, m.turn)

    def _take(self, plan: Floats) -> None:
        """Make it the plan, and roll it out."""
        self.plan = plan
        self.part = roll_out_plan(plan, self._start, self._motion, self.scene, self.track)

    def _validated(self, obstacles: Floats, gaps: Floats, given: Given) -> tuple[tuple[float, float], str]:
        """The first command of the plan, or else of the best roll-outs, from which the robot can stop in free space."""
        command = self._reachable(self.plan[0])
        if self._is_free(command, obstacles, gaps, given):
            return command, self.why()
        for k in self._others():
            command = self._reachable(self._firsts()[k])
            if self._is_free(command, obstacles, gaps, given):
                self._take(self._sample(k))
                return command, f"the mean is not free: {self.why()}"
        # Braking on the arc that was found free one tick ago stays free, even if noise blocks it now.
        turned = self._reachable(np.array([0.0, self.in_flight[-1, 1]]))[1]
        return (0.0, turned if abs(given.twist[0]) > STOPPED_BELOW[0] else 0.0), "no roll-out is free: braking"

    def _firsts(self) -> Floats:
        """(samples, 2) first command of each roll-out, m/s and rad/s."""
        before, noise, paces = self._proposal
        noise_v, noise_w = self.sigma[0] * noise[:, 0, 0], self.sigma[1] * noise[:, 0, 1]
        v, w = paces * before[0, 0] + noise_v, paces * before[0, 1]
        firsts: Floats = np.column_stack([v, w + noise_w, v, w - noise_w]).reshape(-1, 2)
        return firsts

    def _others(self) -> list[int]:
        """Roll-outs with different first commands, the best first: the cheapest in each cell of what can be reached.

        Those that are exactly straight are cells of their own.
        """
        low, high = (np.array(self._reachable(np.full(2, bound))) for bound in (-np.inf, np.inf))
        span = np.maximum(high - low, 1.0e-9)
        firsts = self._firsts()
        cells = np.rint((firsts.clip(low, high) - low) / span * COMMANDS).astype(np.int64)
        order = np.argsort(self.costs, kind="stable")
        keys = 2 * (cells[:, 0] * (COMMANDS[1] + 1) + cells[:, 1]) + (firsts[:, 1] == 0.0)
        keys = keys[order]
        best: list[int] = order[np.sort(np.unique(keys, return_index=True)[1])].tolist()
        return best

    def _reachable(self, wanted: Floats) -> tuple[float, float]:
        """A wanted command, m/s and rad/s, within what the newest command in flight can become in one tick."""
        m = self._motion._replace(step=self.period)
        sent_v, sent_w = self.in_flight[-1].tolist()
        _, _, v, w = follow(0.0, 0.0, sent_v, sent_w, float(wanted[0]), float(wanted[1]), m)
        return v, w

    def _is_free(self, command: tuple[float, float], obstacles: Floats, gaps: Floats, given: Given) -> bool:
        """Whether one period of a command, and braking after it, keeps every obstacle's margin."""
        m, r = self.motion, self.robot
        return stays_free(
            obstacles, gaps, self.edges, given.twist, command, self.period, m.up, m.down, min(m.turn_change, INSTANT),
            self.margin, self.in_flight, r.motor_lag, r.dead_time,
        )  # fmt: skip

    def drawn(self) -> Drawn:
        """A sample of the roll-outs of the last tick for a picture, from the cheapest to the dearest."""
        before, noise, paces = self._proposal
        order = np.argsort(self.costs, kind="stable")
        which = order[np.linspace(0, self.samples - 1, min(DRAWN, self.samples)).astype(np.int64)]
        hits, steps = self.parts[which, COLLISION], self.params.steps
        # The critic's 2 - step / steps, solved for the last step before the collision.
        ends = np.where(hits > 0.0, np.rint((2.0 - hits) * steps) - 1.0, steps - 1.0).astype(np.int64).clip(0)
        points = np.zeros((len(which), len(range(0, steps, DRAWN_EVERY)), 2))
        draw(
            before, noise, paces, self.sigma, self.params.hold, self._start, self._motion, which, DRAWN_EVERY, ends,
            points,
        )  # fmt: skip
        costs = np.where(hits > 0.0, np.inf, self.costs[which])
        free = costs[np.isfinite(costs)]
        span = float(np.ptp(free)) if len(free) else 0.0
        shares = (costs - free.min()) / span if span > 0.0 else np.where(np.isfinite(costs), 0.0, np.inf)
        return Drawn(points, shares, self.track[::DRAWN_EVERY, :2], self.by_critic * self.part)

    def why(self) -> str:
        """Reason of a command, one phrase: how many roll-outs collide and count, and the costs of the plan."""
        parts = self.by_critic * self.part
        dear = np.argsort(-parts, kind="stable")[:3]
        largest = ", ".join(f"{CRITICS[k].replace('_', ' ')} {parts[k]:.2f}" for k in dear if parts[k] > 0.0)
        hit = float((self.parts[:-1, COLLISION] > 0.0).mean())
        return f"{self.samples} roll-outs, {hit:.0%} collide, {effective(self.weights):.0f} count; cost {largest}"

    def direction(self) -> float:
        """Bearing of the plan's end, rad, base frame."""
        return math.atan2(self.track[-1, 1], self.track[-1, 0])


def weights_by_critic(params: MppiParams, robot: Robot) -> Floats:
    """(critics,) weights per unit of each critic: those of ways and speeds are per what the robot can do.

    A robot of 0.5 m/s decides over a quarter of the way of one of 2 m/s; with weights per metre, its roll-outs would
    all cost nearly the same.
    """
    p, way = params, robot.max_linear * params.step * params.steps
    per_unit = {
        "constraint": 1.0 / robot.max_linear, "goal": 1.0 / way, "path_follow": 1.0 / way,
        "prefer_forward": 1.0 / robot.max_linear, "twirling": 1.0 / robot.max_angular,
    }  # fmt: skip
    named = {name: p.gamma if name == "control" else getattr(p, name) for name in CRITICS}
    return np.array([weight * per_unit.get(name, 1.0) for name, weight in named.items()])


def is_stopped(v: float, w: float) -> bool:
    """Whether a velocity, m/s and rad/s, counts as stopped."""
    return abs(v) < STOPPED_BELOW[0] and abs(w) < STOPPED_BELOW[1]


def in_base(points: Floats, pose: Pose) -> Floats:
    """(n, 2) points of the pose frame in the base frame, m."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    x, y = points[:, 0] - pose[0], points[:, 1] - pose[1]
    return np.column_stack([x * c + y * s, y * c - x * s])


def arc_of(path: Floats) -> Floats:
    """(n,) arc length, m, of each point of a path (n, 2) from the origin to its first point and on."""
    steps = np.diff(path, axis=0, prepend=np.zeros((1, 2)))
    return np.cumsum(np.hypot(steps[:, 0], steps[:, 1]))


def length_of(path: Floats) -> float:
    """Length, m, from the origin along a path (n, 2)."""
    return float(arc_of(path)[-1])

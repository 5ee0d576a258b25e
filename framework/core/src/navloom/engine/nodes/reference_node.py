"""The reference node: turns the planner's path into a trajectory, and finds the robot's place on it."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from navloom.config.schema import Config
from navloom.engine.node_ports import Latest, Output
from navloom.engine.nodes.node_base import Node, Tick
from navloom.engine.streams import GoalPorts, LocalizerPorts, PlannerPorts, ReferencePorts
from navloom.geometry.frames import inverse, transform
from navloom.messages import Drive, Path, Point2D, Pose2D, Reference, Trajectory
from navloom.navigation.approach import least_tolerance, slow_down
from navloom.navigation.braking import Braking
from navloom.navigation.branches import Branch, branches_of, joined, single
from navloom.navigation.trajectory import SpeedLimits, keep_corners, make_trajectory
from navloom.navigation.trajectory_projection import Projection, project, way_ahead
from navloom.roles import RobotSpec

__all__ = ["ReferenceNode", "trajectory_of"]

Floats = NDArray[np.float64]
BESIDE = 0.05
"""How far a robot that is turned away may come beside its trajectory while it turns, m."""
LEAST = 0.1
"""Smallest share of the trajectory's speed while the robot is turned away: tracking laws need a moving reference."""
AT_CUSP = 0.03
"""Way to standstill before a cusp, m: the robot drives on from there, so that it may stop beside it."""
PASSED = 0.01
"""Rest of a branch, m, at which the next one begins."""
FAR = 1.0
"""Distance from the first metre of a new trajectory beyond which the robot is looked for on all of it, m."""


def trajectory_of(path: Path, limits: SpeedLimits, rounds: bool = True) -> Trajectory:
    """The trajectory of a path, rounded within its traversable grid, m, map frame; see `navigation.trajectory`.

    Without `rounds`, it runs along the path's own points, whatever the grid.
    """
    grid = path.traversable
    if not rounds:
        return Trajectory(path.request_id, keep_corners(path.points, limits).samples)
    # The planner gave no free space: corners are then cut by a few centimetres at most.
    if grid is None:
        return Trajectory(path.request_id, make_trajectory(path.points, limits).samples)
    grid_to_map = np.array([grid.origin.x, grid.origin.y, grid.origin.heading])
    points_in_grid = transform(inverse(grid_to_map), path.points)
    samples = make_trajectory(points_in_grid, limits, grid.cells == 0, grid.resolution).samples
    # Samples are read-only.
    turned = samples.copy()
    turned[:, 1:3] = transform(grid_to_map, samples[:, 1:3])
    turned[:, 3] = (samples[:, 3] + grid.origin.heading + math.pi) % math.tau - math.pi
    return Trajectory(path.request_id, turned)


class ReferenceNode(Node):
    """Makes the trajectory of the path that the goal allows to drive, and follows it.

    Args:
        limits: Speed limits of the reference.
        look_ahead: Arc length from the reference point to the avoider's target, m.
        corridor: Half width of the strip that must be free, m.
        rounds: Whether corners of the path are pruned and rounded.
        slows: Makes a trajectory slow enough at its end; see `navigation.approach`.
        stops: The same before a cusp.
    """

    role = "reference"
    ticks = True
    is_awaited = True
    path = Latest(PlannerPorts.path)
    pose = Latest(LocalizerPorts.pose)
    drive = Latest(GoalPorts.drive)
    trajectory = Output(ReferencePorts.trajectory)
    reference = Output(ReferencePorts.reference)
    cause = pose

    def __init__(
        self,
        limits: SpeedLimits,
        look_ahead: float,
        corridor: float,
        rounds: bool = True,
        slows: Callable[[Floats], Floats] = lambda samples: samples,
        stops: Callable[[Floats], Floats] = lambda samples: samples,
    ) -> None:
        self.limits, self.look_ahead, self.corridor, self.rounds = limits, look_ahead, corridor, rounds
        self.slows, self.stops = slows, stops
        self._paths: dict[int, Path] = {}
        self._branches: list[Branch] = []
        self._driven = self._branch = 0
        self._progress = 0.0

    @classmethod
    def of(cls, config: Config, robot: RobotSpec, braking: Braking, tolerance: float) -> ReferenceNode:
        """The node that a config asks for, with the goal's tolerance, m."""
        rules = config.navigation
        # A reference that is faster than the robot runs away from it.
        slowest, fastest = (min(speed, robot.max_linear) for speed in rules.speed)
        limits = SpeedLimits(robot, slowest, fastest, rules.lateral_acceleration)
        half_width = float(np.abs(robot.footprint[:, 1]).max())
        slows, stops = (
            partial(slow_down, braking=braking, tolerance=within)
            for within in (tolerance, max(AT_CUSP, least_tolerance(braking)))
        )
        corridor, rounds = half_width + rules.corridor_margin, rules.path_shape == "rounded"
        return cls(limits, rules.look_ahead, corridor, rounds, slows, stops)

    def step(self, tick: Tick) -> None:
        path, drive, estimate = self.path.value, self.drive.value, self.pose.value
        if path is not None and path.request_id not in self._paths:
            # The driven path stays: a goal may never take the new one.
            self._paths = {number: held for number, held in self._paths.items() if number == self._driven}
            self._paths[path.request_id] = path
        if drive is None or drive.path_id not in self._paths or estimate is None:
            return
        # Only authorised paths become trajectories: the goal may still be turning or stopping on the old one.
        if drive.path_id != self._driven or not self._branches:
            self._branches = self._made(self._paths[drive.path_id])
            self._driven = drive.path_id
            self._branch, self._progress = self._start(estimate.pose)
            self.trajectory.put(Trajectory(drive.path_id, joined(self._branches)))
        self.reference.put(self._reference(drive, estimate.pose))

    def _made(self, path: Path) -> list[Branch]:
        if path.headings is not None:
            return branches_of(path.points, path.headings, self.limits, self.slows, self.stops)
        return [single(self.slows(trajectory_of(path, self.limits, self.rounds).samples))]

    def _speeds(self, at: Projection, heading: float) -> tuple[float, float]:
        """Speed, m/s, and turn rate, rad/s, of the reference: less while a robot that turns slowly is turned away.

        To turn by an angle e takes it 2 sqrt(e / a) at a turn acceleration a; meanwhile it leaves its trajectory.
        """
        away = abs(math.remainder(at.heading - heading, math.tau))
        beside = away * math.sqrt(away / self.limits.robot.max_angular_acceleration)
        speed = max(LEAST * at.speed, BESIDE / beside) if beside * at.speed > BESIDE else at.speed
        return speed, at.turn_rate if speed == at.speed else at.curvature * speed

    def _start(self, base: Pose2D) -> tuple[int, float]:
        """Branch and progress from which to follow a new trajectory: 0, or the robot's place if that is far from there.

        It is far if this node has restarted during a drive. A reference that came from the start, some metres per
        second, would make the robot drive backwards.
        """
        near = self._project(self._branches[0], base, 0.0)
        if math.hypot(near.x - base.x, near.y - base.y) <= FAR:
            return 0, 0.0
        found = [self._project(branch, base, 0.0, branch.length) for branch in self._branches]
        gaps = [math.hypot(at.x - base.x, at.y - base.y) for at in found]
        nearest = gaps.index(min(gaps))
        return nearest, found[nearest].progress

    def _project(self, branch: Branch, base: Pose2D, progress: float, ahead: float = 1.0) -> Projection:
        """The robot's place on a branch, as if it headed along the way."""
        heading = base.heading - branch.at(branch.away, progress)
        return project(branch.samples, base.x, base.y, heading, progress, self.look_ahead, ahead=ahead)

    def _reference(self, drive: Drive, base: Pose2D) -> Reference:
        at = self._project(self._branches[self._branch], base, self._progress)
        # Only at the end of a branch does the next one begin: elsewhere the two may lie side by side.
        if self._branch + 1 < len(self._branches) and at.progress >= self._branches[self._branch].length - PASSED:
            self._branch += 1
            at = self._project(self._branches[self._branch], base, 0.0)
        branch, self._progress = self._branches[self._branch], at.progress
        last, progress, away = self._branches[-1], branch.begin + at.progress, branch.at(branch.away, at.progress)
        speed, turn = self._speeds(at, base.heading - away)
        ahead, left, heading = speed, 0.0, at.heading
        if away:
            heading = math.remainder(at.heading + away, math.tau)
            ahead = -speed
        if branch.is_sideways:
            ahead, left = speed * math.cos(away), -speed * math.sin(away)
            turn = speed * branch.at(branch.turns, at.progress)
        return Reference(
            drive.path_id,
            progress,
            last.begin + last.length - progress,
            Pose2D(at.x, at.y, heading),
            ahead,
            turn,
            at.cross_track,
            Point2D(at.target_x, at.target_y),
            way_ahead(branch.samples, at.progress, self.look_ahead),
            self.corridor,
            drive.turn_to if drive.stop_here else None,
            left,
        )

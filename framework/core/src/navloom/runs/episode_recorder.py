"""Collects the data that the metrics of an episode need."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navloom.config import Config
from navloom.messages import (
    Bodies,
    Command,
    Envelope,
    GateStatus,
    Goal,
    HandOver,
    MapUpdate,
    Message,
    OccupancyGrid,
    Odometry,
    OperatorRequest,
    Path,
    PlanRequest,
    PoseEstimate,
    RecoveryRequest,
    Reference,
    StepRecord,
    Trajectory,
    Truth,
)

__all__ = ["Recorder", "streams_of"]


@dataclass
class Recorder:
    """An observer that keeps the truth, the references, and the newest map, plan and trajectories.

    Attributes:
        truth: (time s, x m, y m, heading rad, speed m/s, clearance m) of each tick, map frame.
        turn_rates, side_speeds: True turn rate, rad/s, and speed to the left, m/s, of each tick.
        cross_tracks: Cross-track error of each tick with a reference, m.
        reference_times: Times of the same ticks, s.
        speeds: Reference speeds, m/s.
        commands: (time s, forward m/s, turn rate rad/s) of the gate.
        gate_stopped: (time s, whether the gate stops a driving robot) at each change.
        drivers: (time s, role whose command the gate passes) at each change; nothing where none drives.
        touches: Number of contacts.
        contacts: (row of the truth, name of the obstacle) of each tick in contact.
        nearest: Name of the obstacle at the smallest clearance.
        engaged: (time s, whether the avoider drives) at each change.
        plans: Every path of the active planner.
        trajectories: Every trajectory.
        map: The newest map of the active mapper.
        known: The newest known map that it publishes beside that one.
        recoveries: Number of recovery attempts.
        estimates: (time s, x m, y m, heading rad) of each pose of the active localizer, map frame.
        trust: Whether it tracks at each of these poses, 1 or 0, and xx, xy, yy, m², heading, rad², of its covariance.
        odometry: (time s, x m, y m, heading rad) of each odometry, in its own frame.
        goals: Each goal by its number.
        given_at: Time at which each of them was given, s, by its number.
        legs: Number of legs of the first goal: one more than its `via` points.
        asked: Goal (x m, y m) of each plan request, by the number of the request.
        began, missed: Run time of the first truth, s, and how many ticks the platform had made before it.
        reads: Streams that are kept as they are, `(role or node, port)`.
        streams: Their messages, each after its time, s, by stream.
        bodies: What moved, in each tick; empty where nothing but the robot moves.
    """

    wants: frozenset[tuple[str, str]] | None = frozenset(
        {
            ("platform", "truth"),
            ("platform", "odometry"),
            ("reference", "reference"),
            ("reference", "trajectory"),
            ("planner", "path"),
            ("mapper", "map"),
            ("mapper", "known"),
            ("goal", "plan"),
            ("goal", "recovery"),
            ("avoider", "handover"),
            ("gate", "command"),
            ("gate", "status"),
            ("localizer", "pose"),
            ("operator", "request"),
            ("world", "bodies"),
        }
    )
    wants_steps: bool = False
    truth: list[tuple[float, float, float, float, float, float]] = field(default_factory=list)
    turn_rates: list[float] = field(default_factory=list)
    side_speeds: list[float] = field(default_factory=list)
    cross_tracks: list[float] = field(default_factory=list)
    reference_times: list[float] = field(default_factory=list)
    speeds: list[float] = field(default_factory=list)
    commands: list[tuple[float, float, float]] = field(default_factory=list)
    gate_stopped: list[tuple[float, bool]] = field(default_factory=list)
    drivers: list[tuple[float, str]] = field(default_factory=list)
    touches: int = 0
    contacts: list[tuple[int, str]] = field(default_factory=list)
    nearest: str = ""
    engaged: list[tuple[float, bool]] = field(default_factory=list)
    plans: list[Path] = field(default_factory=list)
    trajectories: list[Trajectory] = field(default_factory=list)
    map: MapUpdate | None = None
    known: OccupancyGrid | None = None
    recoveries: int = 0
    estimates: list[tuple[float, float, float, float]] = field(default_factory=list)
    trust: list[tuple[float, float, float, float, float]] = field(default_factory=list)
    odometry: list[tuple[float, float, float, float]] = field(default_factory=list)
    goals: dict[int, Goal] = field(default_factory=dict)
    given_at: dict[int, float] = field(default_factory=dict)
    legs: int = 1
    asked: dict[int, tuple[float, float]] = field(default_factory=dict)
    began: float = math.nan
    missed: int = 0
    reads: frozenset[tuple[str, str]] = frozenset()
    streams: dict[tuple[str, str], list[tuple[float, Message]]] = field(default_factory=dict)
    bodies: list[Bodies] = field(default_factory=list)
    _touching: bool = False
    _least: float = math.inf

    def __post_init__(self) -> None:
        assert self.wants is not None
        self.wants |= self.reads
        self.streams = {stream: [] for stream in self.reads}

    def on_message(self, role: str, instance: str, active: bool, port: str, message: Message, at: Envelope) -> None:
        """Store the relevant messages of the active instances."""
        if active:
            if message.__class__ is Truth and math.isnan(self.began):
                # Live, the first messages of a platform may be gone before anybody listens.
                self.began, self.missed = at.stamp_ns * 1e-9, at.sequence - 1
            if (role, port) in self.reads:
                self.streams[role, port].append((at.stamp_ns * 1e-9, message))
            keep = _KEPT.get(message.__class__)
            if keep is not None:
                keep(self, message, at.stamp_ns * 1e-9)

    def on_step(self, record: StepRecord) -> None:
        """Never called: `wants_steps` is false."""

    def _keep_truth(self, truth: Truth, time: float) -> None:
        pose = truth.pose
        self.truth.append((time, pose.x, pose.y, pose.heading, truth.twist.vx, truth.clearance))
        self.turn_rates.append(truth.twist.wz)
        self.side_speeds.append(truth.twist.vy)
        if truth.clearance < self._least:
            self._least, self.nearest = truth.clearance, truth.nearest
        if truth.touching:
            self.contacts.append((len(self.truth) - 1, truth.nearest))
        self.touches += truth.touching and not self._touching
        self._touching = truth.touching

    def _keep_estimate(self, estimate: PoseEstimate, time: float) -> None:
        pose = estimate.pose
        self.estimates.append((estimate.stamp_ns * 1e-9, pose.x, pose.y, pose.heading))
        (xx, xy, _), (_, yy, _), (_, _, turn) = estimate.covariance.tolist()
        self.trust.append((float(estimate.state == "tracking"), xx, xy, yy, turn))

    def _keep_odometry(self, odometry: Odometry, time: float) -> None:
        pose = odometry.pose
        self.odometry.append((odometry.stamp_ns * 1e-9, pose.x, pose.y, pose.heading))

    def _keep_request(self, request: OperatorRequest, time: float) -> None:
        goal = request.goal
        if goal is not None:
            self.legs = self.legs if self.goals else len(goal.via) + 1
            self.goals[goal.goal_id], self.given_at[goal.goal_id] = goal, time

    def _keep_command(self, command: Command, time: float) -> None:
        self.commands.append((time, command.twist.vx, command.twist.wz))

    def _keep_reference(self, reference: Reference, time: float) -> None:
        self.reference_times.append(time)
        self.cross_tracks.append(reference.cross_track)
        self.speeds.append(reference.speed)

    def _keep_handover(self, handover: HandOver, time: float) -> None:
        if not self.engaged or self.engaged[-1][1] != handover.engaged:
            self.engaged.append((time, handover.engaged))

    def _keep_gate(self, status: GateStatus, time: float) -> None:
        stopped = status.interrupts
        if not self.gate_stopped or self.gate_stopped[-1][1] != stopped:
            self.gate_stopped.append((time, stopped))
        if status.source != "none" and (not self.drivers or self.drivers[-1][1] != status.source):
            self.drivers.append((time, status.source))

    def _keep_trajectory(self, trajectory: Trajectory, time: float) -> None:
        self.trajectories.append(trajectory)

    def _keep_asked(self, request: PlanRequest, time: float) -> None:
        self.asked[request.request_id] = (request.goal.x, request.goal.y)

    def _keep_plan(self, path: Path, time: float) -> None:
        self.plans.append(path)

    def _keep_map(self, update: MapUpdate, time: float) -> None:
        self.map = update

    def _keep_known(self, known: OccupancyGrid, time: float) -> None:
        self.known = known

    def _keep_recovery(self, request: RecoveryRequest, time: float) -> None:
        self.recoveries += request.active

    def _keep_bodies(self, bodies: Bodies, time: float) -> None:
        self.bodies.append(bodies)

    @property
    def saved_map(self) -> OccupancyGrid | None:
        """The map to write to a file: the mapper's known map, without what it saw; of other mappers their map."""
        return self.known if self.known is not None or self.map is None else self.map.grid

    @property
    def driven(self) -> NDArray[np.float64]:
        """(n, 2) true positions, m, map frame."""
        return np.array([row[1:3] for row in self.truth], dtype=np.float64).reshape(-1, 2)

    @property
    def plan_length(self) -> float | None:
        """Total length of the first plans of the first goal's legs, m; of the planned legs if the run ended early."""
        firsts: list[float] = []
        leg = None
        for plan in self.plans:
            if not firsts or self.asked.get(plan.request_id) != leg:
                firsts.append(plan.length)
                leg = self.asked.get(plan.request_id)
        return sum(firsts[: self.legs]) if firsts else None

    @property
    def min_clearance(self) -> float | None:
        """Smallest gap between footprint and obstacles, m; None if nothing was near or there is no ground truth."""
        return self._least if math.isfinite(self._least) else None


def streams_of(reads: Iterable[tuple[str, str]], config: Config) -> frozenset[tuple[str, str]]:
    """Streams that metrics read, `(role or node, port)`, in a robot of a config: "node" is every [[node]] of it."""
    nodes = [table.name for table in config.node]
    return frozenset((name, port) for role, port in reads for name in (nodes if role == "node" else [role]))


_KEPT: dict[type[Message], Callable[[Recorder, Any, float], None]] = {
    Truth: Recorder._keep_truth,
    PoseEstimate: Recorder._keep_estimate,
    Odometry: Recorder._keep_odometry,
    OperatorRequest: Recorder._keep_request,
    Command: Recorder._keep_command,
    Reference: Recorder._keep_reference,
    HandOver: Recorder._keep_handover,
    GateStatus: Recorder._keep_gate,
    Trajectory: Recorder._keep_trajectory,
    PlanRequest: Recorder._keep_asked,
    Path: Recorder._keep_plan,
    MapUpdate: Recorder._keep_map,
    OccupancyGrid: Recorder._keep_known,
    RecoveryRequest: Recorder._keep_recovery,
    Bodies: Recorder._keep_bodies,
}
"""Function that stores a message, by class: (recorder, message, run time, s)."""

"""Runs of the paper's experiment (Hoang et al. 2013, IV), recorded with all that its figures need."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from navloom.config import load_config
from navloom.geometry.angles import wrap
from navloom.geometry.world import Box, World
from navloom.messages import (
    AvoiderDiagnostics,
    AvoiderStatus,
    Envelope,
    GateStatus,
    MapUpdate,
    Message,
    Path,
    Point2D,
    Pose2D,
    PoseEstimate,
    RangeScan,
    Reference,
    StepRecord,
    Sweep,
    TrackingCommand,
    Trajectory,
)
from navloom.runs import Episode, run_episode
from numpy.typing import NDArray

__all__ = [
    "PLANNED",
    "QUIET",
    "START",
    "Choice",
    "Drive",
    "Gate",
    "away_from",
    "box",
    "crossing",
    "drive",
    "gates_of",
    "moving_speeds",
]

Floats = NDArray[np.float64]
QUIET = ("platform.noise=false", "sensor.laser.noise=false", "sensor.sonars.noise=false")
"""Settings of a run without sensor noise and wheel noise."""
EVERY_TICK = "avoider.diagnostics_rate_hz=20.0"
"""Setting that makes the avoider publish diagnostics in every tick: figures show the tick in which it turns away."""
PLANNED = "run.stop_after=2.0"
"""Setting that ends a run once the plan exists: the sweep takes 1.24 s."""
GATE_LINE = 5.3
"""y of the middle of the wall with the gates, m."""
START = Pose2D(0.0, 0.0, 0.5 * math.pi)
"""Pose at the start of the experiment: at S, facing D."""


@dataclass(frozen=True)
class Gate:
    """A passage through the wall between S and D: its letter in the paper, and x of its sides, m, map frame."""

    name: str
    left: float
    right: float

    @property
    def middle(self) -> float:
        """x of the middle, m, map frame."""
        return 0.5 * (self.left + self.right)


@dataclass(frozen=True, eq=False)
class Choice:
    """An avoider's view in one tick.

    Attributes:
        time: Time of the tick, s.
        pose: Estimated pose, map frame.
        scan: Ranges of the sonars.
        target: Point that the avoider steers to, map frame.
        diagnostics: Window, histogram and slots.
    """

    time: float
    pose: Pose2D
    scan: RangeScan
    target: Point2D
    diagnostics: AvoiderDiagnostics

    @property
    def to_target(self) -> float:
        """Direction of the target, rad, map frame: the paper's θt."""
        return math.atan2(self.target.y - self.pose.y, self.target.x - self.pose.x)


@dataclass(eq=False)
class _Onlooker:
    """An observer that keeps what the figures need: the first and newest message of each type, and the lists below."""

    wants: frozenset[tuple[str, str]] | None = frozenset(
        {
            ("platform", "laser"),
            ("platform", "sonars"),
            ("localizer", "pose"),
            ("mapper", "map"),
            ("planner", "path"),
            ("reference", "trajectory"),
            ("reference", "reference"),
            ("controller", "command"),
            ("avoider", "status"),
            ("gate", "status"),
        }
    )
    wants_steps: bool = False
    newest: dict[type[Message], Message] = field(default_factory=dict)
    first: dict[type[Message], Message] = field(default_factory=dict)
    errors: list[tuple[float, float, float, float]] = field(default_factory=list)
    sources: list[tuple[float, str]] = field(default_factory=list)
    choice: Choice | None = None
    towards: tuple[float, float] | None = None
    densities: list[tuple[float, float, float, float, float]] = field(default_factory=list)

    def on_message(self, role: str, instance: str, active: bool, port: str, message: Message, at: Envelope) -> None:
        time = at.stamp_ns * 1e-9
        self.newest[type(message)] = message
        self.first.setdefault(type(message), message)
        if isinstance(message, TrackingCommand):
            self.errors.append((time, message.e1, message.e2, message.e3))
        elif isinstance(message, GateStatus):
            self.sources.append((time, message.source))
        elif isinstance(message, AvoiderStatus):
            assert message.diagnostics is not None  # EVERY_TICK
            if self.towards is not None:
                self._measure(time, message.diagnostics, *self.towards)
            if self.choice is None and self.sources[-1][1] == "avoider":
                self._look(time, message.diagnostics)

    def on_step(self, record: StepRecord) -> None:
        """Not used, since `wants_steps` is False."""

    def _measure(self, time: float, diagnostics: AvoiderDiagnostics, x: float, y: float) -> None:
        """Record the density of the sector towards a point."""
        estimate = self.newest[PoseEstimate]
        assert isinstance(estimate, PoseEstimate)
        pose = estimate.pose
        count = len(diagnostics.histogram)
        sector = int(math.atan2(y - pose.y, x - pose.x) % math.tau / (math.tau / count)) % count
        self.densities.append((time, pose.x, pose.y, float(diagnostics.histogram[sector]), diagnostics.threshold))

    def _look(self, time: float, diagnostics: AvoiderDiagnostics) -> None:
        """Record the first tick in which the avoider is active and turns more than one sector away from its target."""
        pose, scan, reference = (self.newest[kind] for kind in (PoseEstimate, RangeScan, Reference))
        assert isinstance(pose, PoseEstimate) and isinstance(scan, RangeScan) and isinstance(reference, Reference)
        found = Choice(time, pose.pose, scan, reference.target, diagnostics)
        sector = 2.0 * math.pi / max(1, len(diagnostics.histogram))
        if diagnostics.chosen is not None and abs(float(wrap(diagnostics.chosen - found.to_target))) > sector:
            self.choice = found


@dataclass(frozen=True, eq=False)
class Drive:
    """One run.

    Attributes:
        episode: The episode with its metrics.
        sweep: The first 3D image.
        map: The first map, or None.
        path: The first plan; None if there is none.
        trajectory: The trajectory of the first plan, or None.
        errors: (n, 4) time, s; e1, e2, m; e3, rad, of each tick with a reference: eq. (4).
        sources: Time, s, and new active source ("controller", "avoider", ...) at each change.
        choice: The tick in which the avoider first turned away from its target, or None.
        densities: (n, 5) time, s; estimated x, y, m, map frame; density of the sector towards a point, and threshold,
            of each tick; n = 0 if no point was asked for.
    """

    episode: Episode
    sweep: Sweep
    map: MapUpdate | None
    path: Path | None
    trajectory: Trajectory | None
    errors: Floats
    sources: tuple[tuple[float, str], ...]
    choice: Choice | None
    densities: Floats

    @property
    def world(self) -> World:
        """The true world of the run."""
        assert self.episode.system.world is not None
        return self.episode.system.world

    def driven_by(self, source: str) -> list[Floats]:
        """Parts of the true track, (n, 2) x, y, m, map frame each, during which `source` was active."""
        truth = np.array(self.episode.recorder.truth)[:, :3]
        ends = [time for time, _ in self.sources[1:]] + [math.inf]
        parts = []
        for (since, who), until in zip(self.sources, ends, strict=True):
            if who == source:
                parts.append(truth[(truth[:, 0] >= since) & (truth[:, 0] <= until + 1e-9), 1:])
        return parts


def moving_speeds(run: Drive) -> Floats:
    """(n,) true forward speeds of the ticks in which the robot moves, m/s."""
    speeds = np.array(run.episode.recorder.truth)[:, 4]
    moving: Floats = speeds[speeds > 1e-3]
    return moving


def drive(*overrides: str, seed: int | None = None, towards: tuple[float, float] | None = None) -> Drive:
    """Run the shipped config `paper` with overrides, and keep what its figures need.

    Args:
        overrides: Settings in the form of `--set`.
        seed: Seed of the noise; None: the config's.
        towards: Point, m, map frame, towards which the avoider's density is recorded; None: none.

    Raises:
        ConfigError, PluginError: A plugin of the experiment is missing, or an override is invalid.
    """
    onlooker = _Onlooker(towards=towards)
    loaded = load_config("paper", [EVERY_TICK, *overrides], seed)
    episode = run_episode(loaded, observers=[onlooker])
    # A robot that misses its goal plans again: figures show the plan from S.
    sweep, update, path, trajectory = (onlooker.first.get(kind) for kind in (Sweep, MapUpdate, Path, Trajectory))
    assert isinstance(sweep, Sweep)
    return Drive(
        episode,
        sweep,
        update if isinstance(update, MapUpdate) else None,
        path if isinstance(path, Path) else None,
        trajectory if isinstance(trajectory, Trajectory) else None,
        np.array(onlooker.errors).reshape(-1, 4),
        tuple(onlooker.sources),
        onlooker.choice,
        np.array(onlooker.densities).reshape(-1, 5),
    )


def box(world: World, name: str) -> Box:
    """The box with a name in the paper's world."""
    found = next(obstacle for obstacle in world.obstacles if obstacle.name == name)
    assert isinstance(found, Box)
    return found


def away_from(obstacle: Box, points: Floats) -> Floats:
    """(n,) horizontal distance of points (n, 2), m, map frame, from an upright box, m; 0 inside."""
    low, high = np.array([obstacle.x, obstacle.y]).T
    apart = np.maximum(np.maximum(low - points, points - high), 0.0)
    found: Floats = np.hypot(*apart.T)
    return found


def gates_of(world: World) -> tuple[Gate, Gate, Gate]:
    """Gates A and B below their girders, and corridor C between partition and right wall."""
    corridor = Gate("C", box(world, "partition").x[1], box(world, "right wall").x[0])
    post = box(world, "post A/B").x
    return (
        Gate("A", box(world, "gate wall left").x[1], post[0]),
        Gate("B", post[1], box(world, "partition").x[0]),
        corridor,
    )


def crossing(path: Path, world: World) -> str:
    """Letter of the gate that a plan goes through; "-" if it goes through none."""
    points = path.points
    first = int(np.argmax(points[:, 1] >= GATE_LINE))
    if points[first, 1] < GATE_LINE or first == 0:
        return "-"
    share = (GATE_LINE - points[first - 1, 1]) / (points[first, 1] - points[first - 1, 1])
    x = points[first - 1, 0] + share * (points[first, 0] - points[first - 1, 0])
    return next((gate.name for gate in gates_of(world) if gate.left < x < gate.right), "-")

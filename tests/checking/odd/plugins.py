"""Twenty sound plugins that do unusual things."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property, lru_cache

import numpy as np
from navloom import (
    Avoidance,
    AvoiderInput,
    Claim,
    Context,
    ControllerInput,
    InputError,
    LocalizerInput,
    MapperInput,
    MapUpdate,
    OccupancyGrid,
    Params,
    Path,
    PlanFailure,
    PlannerInput,
    PlatformInput,
    PlatformOutput,
    PoseEstimate,
    RangeScan,
    RecoveryInput,
    RecoveryStep,
    TrackingCommand,
    Twist2D,
)
from navloom.messages import Point2D
from navloom_sensors_sim.adapter import SensorsSim
from planted import Entries
from planted.sound import STILL, Dot, Flood, FromStart, Gap, GapParams, Hits, Pause, PauseParams, Proportional
from pydantic import Field

ENTRIES = Entries()


def turned(answer: Avoidance, more: float) -> Avoidance:
    return replace(answer, twist=Twist2D(answer.twist.vx, 0.0, answer.twist.wz + more))


@ENTRIES.plant("r")
class R(Gap):
    """Has a name of one letter, and breaks ties with its random stream."""

    def __init__(self, params: GapParams, context: Context) -> None:
        super().__init__(params, context)
        self.draws = context.stream("ties")

    def avoid(self, given: AvoiderInput) -> Avoidance:
        side = 1.0 if self.draws.random() < 0.5 else -1.0
        return turned(super().avoid(given), 0.01 * side)


@ENTRIES.plant("sampling_avoider")
class SamplingAvoider(Gap):
    """A sampling MPC: the best of 64 random commands, rolled out for a second."""

    def __init__(self, params: GapParams, context: Context) -> None:
        super().__init__(params, context)
        self.draws = context.stream("samples")

    def avoid(self, given: AvoiderInput) -> Avoidance:
        plain = super().avoid(given)
        turns = plain.twist.wz + 0.2 * self.draws.standard_normal(64)
        costs = (turns - self.params.gain * self.bearing(given)) ** 2
        limit = self.context.robot.max_angular
        best = float(np.clip(turns[int(np.argmin(costs))], -limit, limit))
        return plain if plain.status == "trapped" else replace(plain, twist=Twist2D(plain.twist.vx, 0.0, best))


@ENTRIES.plant("keeps_right")
class KeepsRight(Gap):
    """Is asymmetric on purpose: it keeps to the right, as on a road."""

    def bearing(self, given: AvoiderInput) -> float:
        pose = given.estimate.pose
        away = math.hypot(given.target.x - pose.x, given.target.y - pose.y)
        return super().bearing(given) - min(0.1, 0.05 * away)


@ENTRIES.plant("lazy")
class Lazy(Gap):
    """Creates what it needs at its first step."""

    @cached_property
    def window(self) -> np.ndarray:
        return np.cos(np.linspace(-1.0, 1.0, 64))

    def avoid(self, given: AvoiderInput) -> Avoidance:
        return turned(super().avoid(given), 0.0 * float(self.window.sum()))


@lru_cache(maxsize=64)
def cosines(beams: int, first: float, last: float) -> np.ndarray:
    """Cosines of the beams, cached for all instances by everything that they depend on."""
    return np.cos(np.linspace(first, last, beams))


@ENTRIES.plant("cached")
class Cached(Gap):
    def avoid(self, given: AvoiderInput) -> Avoidance:
        for scan in given.scans:
            if scan.bearings.size:
                cosines(len(scan.bearings), float(scan.bearings[0]), float(scan.bearings[-1]))
        return super().avoid(given)


@ENTRIES.plant("numpy_scalars")
class NumpyScalars(Gap):
    """Answers in float64 and float32 of numpy."""

    def avoid(self, given: AvoiderInput) -> Avoidance:
        twist = super().avoid(given).twist
        return Avoidance(Twist2D(np.float64(twist.vx), 0, np.float32(twist.wz)), "clear")  # type: ignore[arg-type]


@ENTRIES.plant("generators")
class Generators(Gap):
    """Uses generators and itertools, whose state lasts one step only."""

    def sectors(self, scan: RangeScan) -> Iterator[float]:
        for k in range(0, len(scan.ranges), 8):
            yield float(scan.ranges[k : k + 8].min())

    def avoid(self, given: AvoiderInput) -> Avoidance:
        nearest = min((min(self.sectors(scan), default=math.inf) for scan in given.scans), default=math.inf)
        return Avoidance(STILL, "trapped") if nearest < self.params.stop_at else super().avoid(given)


@ENTRIES.plant("smooth")
class Smooth(Gap):
    """Has a memory, and clears it in reset."""

    claims = {Claim.MIRROR, Claim.ROTATION, Claim.TRANSLATION, Claim.STOPS_WHEN_CLOSED}

    def __init__(self, params: GapParams, context: Context) -> None:
        super().__init__(params, context)
        self.reset()

    def reset(self) -> None:
        self.turn: float | None = None

    def avoid(self, given: AvoiderInput) -> Avoidance:
        answer = super().avoid(given)
        self.turn = answer.twist.wz if self.turn is None else 0.5 * self.turn + 0.5 * answer.twist.wz
        return replace(answer, twist=Twist2D(answer.twist.vx, 0.0, self.turn))


@ENTRIES.plant("crawler")
class Crawler(Gap):
    """Never drives faster than 0.15 m/s."""

    def avoid(self, given: AvoiderInput) -> Avoidance:
        answer = super().avoid(given)
        return replace(answer, twist=Twist2D(min(0.15, answer.twist.vx), 0.0, answer.twist.wz))


@ENTRIES.plant("stops_only")
class StopsOnly(Gap):
    """Never steers: passes on the desired velocity, unless something is near."""

    def avoid(self, given: AvoiderInput) -> Avoidance:
        nearest, ahead = self.near(given)
        if nearest < self.params.stop_at or ahead < 0.9:
            return Avoidance(STILL, "trapped")
        return Avoidance(given.desired, "clear")


@ENTRIES.plant("random_planner")
class RandomPlanner(Flood):
    """Chooses at random among paths of equal length: its random stream orders the neighbours."""

    def __init__(self, params: Params, context: Context) -> None:
        super().__init__(params, context)
        self.draws = context.stream("order")

    def steps(self) -> list[tuple[int, int, float]]:
        steps = super().steps()
        return [steps[k] for k in self.draws.permutation(len(steps)).tolist()]

    def search(self, free: np.ndarray, start: tuple[int, int], goal: tuple[int, int]) -> list[tuple[int, int]]:
        order = self.steps()
        self.steps = lambda: order  # type: ignore[method-assign]
        try:
            return super().search(free, start, goal)
        finally:
            del self.steps  # type: ignore[method-assign]


@ENTRIES.plant("roundabout_planner")
class RoundaboutPlanner(Flood):
    """Finds a path that is far from the shortest: each step away from a wall costs much."""

    def radius(self) -> float:
        return 1.05 * super().radius()


@ENTRIES.plant("raising_planner")
class RaisingPlanner(Flood):
    """Refuses robots that it cannot plan for, with the error made for that."""

    def __init__(self, params: Params, context: Context) -> None:
        super().__init__(params, context)
        if self.radius() > 5.0:
            raise InputError(f"raising_planner: a robot of {self.radius():.1f} m, expected at most 5 m")

    def plan(self, given: PlannerInput) -> Path | PlanFailure:
        if not given.map.grid.cells.size:
            goal = given.request.goal
            return PlanFailure(given.request.request_id, "outside_map", Point2D(goal.x, goal.y), "the map is empty")
        return super().plan(given)


@ENTRIES.plant("float_controller")
class FloatController(Proportional):
    """Keeps its last command, and the reference that it was for."""

    claims = {Claim.MIRROR, Claim.ROTATION, Claim.TRANSLATION}

    def __init__(self, params: Params, context: Context) -> None:
        super().__init__(params, context)
        self.reset()

    def reset(self) -> None:
        self.path_id, self.turn = 0, 0.0

    def control(self, given: ControllerInput) -> TrackingCommand:
        answer = super().control(given)
        if given.reference.path_id != self.path_id:
            self.path_id, self.turn = given.reference.path_id, answer.twist.wz
        self.turn += 0.8 * (answer.twist.wz - self.turn)
        return replace(answer, twist=Twist2D(answer.twist.vx, 0.0, self.turn))


@ENTRIES.plant("unsure")
class Unsure(FromStart):
    """Grows unsure with the distance driven, and reports that it is lost, which is allowed."""

    def __init__(self, params: Params, context: Context) -> None:
        super().__init__(params, context)
        self.reset()

    def reset(self) -> None:
        self.steps = 0

    def localize(self, given: LocalizerInput) -> PoseEstimate:
        self.steps += 1
        answer = super().localize(given)
        covariance = np.diag([1e-3, 1e-3, 1e-4]) * self.steps
        if self.steps > 100:
            return replace(answer, covariance=covariance, state="lost", reason="the way is long")
        return replace(answer, covariance=covariance)


class ThinParams(Params):
    cell: float = Field(0.1, gt=0.0, le=1.0, description="Edge of a cell, m.")
    share: float = Field(0.3, gt=0.0, le=1.0, description="Share of the beams that are drawn.")


@ENTRIES.plant("thin_mapper")
class ThinMapper(Hits):
    """Draws some of the beams, chosen by its random stream."""

    Params = ThinParams  # type: ignore[assignment]

    def __init__(self, params: ThinParams, context: Context) -> None:
        self.draws = context.stream("beams")
        super().__init__(params, context)  # type: ignore[arg-type]

    def insert(self, scan: RangeScan, given: MapperInput) -> None:
        kept = self.draws.random(len(scan.ranges)) < self.params.share
        super().insert(replace(scan, ranges=np.where(kept, scan.ranges, np.inf)), given)


@ENTRIES.plant("refusing_mapper")
class RefusingMapper(Hits):
    """Refuses scans without a beam, with the error made for that."""

    def insert(self, scan: RangeScan, given: MapperInput) -> None:
        if not scan.ranges.size:
            raise InputError("refusing_mapper: a scan of 0 beams, expected at least 1")
        super().insert(scan, given)


@ENTRIES.plant("slow_mapper")
class SlowMapper(Hits):
    """Publishes a smaller map, and only every other second."""

    def update(self, given: MapperInput) -> MapUpdate | None:
        answer = super().update(given)
        if answer is None:
            return None
        self.due_ns = given.stamp_ns + 2_000_000_000
        cells = answer.grid.cells[::2, ::2] | answer.grid.cells[1::2, ::2] | answer.grid.cells[::2, 1::2]
        cells = cells | answer.grid.cells[1::2, 1::2]
        return replace(answer, grid=OccupancyGrid(cells, 2.0 * answer.grid.resolution, answer.grid.origin))


@ENTRIES.plant("slipping")
class Slipping(Dot):
    """Adds noise from its random stream, which continues over reset as streams do."""

    def __init__(self, params: Params, context: Context) -> None:
        self.draws = context.stream("slip")
        super().__init__(params, context)

    def advance(self, given: PlatformInput) -> PlatformOutput:
        way = (given.time_ns - self.time_ns) * 1e-9 * given.command.vx
        self.x += 0.01 * way * float(self.draws.standard_normal())
        return super().advance(given)


@ENTRIES.plant("gives_up_at_once")
class GivesUpAtOnce(Pause):
    """A recovery that fails on purpose, so that the next one is tried."""

    def recover(self, given: RecoveryInput) -> RecoveryStep:
        return RecoveryStep(STILL, "failed", False)


@ENTRIES.plant("waggles")
class Waggles(Pause):
    """Turns to and fro on the spot, by the run clock."""

    def __init__(self, params: PauseParams, context: Context) -> None:
        super().__init__(params, context)
        self.begin_ns = 0

    def reset(self) -> None:
        super().reset()
        self.begin_ns = 0

    def recover(self, given: RecoveryInput) -> RecoveryStep:
        if given.starts:
            self.begin_ns = given.stamp_ns
        answer = super().recover(given)
        phase = 1e-9 * (given.stamp_ns - self.begin_ns)
        return replace(answer, twist=Twist2D(0.0, 0.0, 0.2 * math.sin(6.0 * phase)))


@ENTRIES.plant("few_words")
class FewWords(Gap):
    """Gives no diagnostics, and its parameter is a text."""

    class Params(GapParams):
        side: str = Field("left", pattern="left|right", description="Side that it prefers; no unit.")


@ENTRIES.plant("searches_first")
class SearchesFirst(FromStart):
    """Searches for its place for a second, far from it, and says so."""

    def __init__(self, params: Params, context: Context) -> None:
        super().__init__(params, context)
        self.reset()

    def reset(self) -> None:
        super().reset()
        self.steps = 0

    def localize(self, given: LocalizerInput) -> PoseEstimate:
        answer = super().localize(given)
        self.steps += 1
        if self.steps > 20:
            return answer
        pose = replace(answer.pose, x=answer.pose.x + 1.0)
        return replace(answer, pose=pose, covariance=np.eye(3), state="searching", reason="global start")


assert len(vars(ENTRIES)) >= 20


@ENTRIES.plant("inherits_settings")
class InheritsSettings(SensorsSim):
    """Takes parameters and settings of sensors from another distribution, whose modules read them."""

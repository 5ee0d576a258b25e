"""Small sound plugins, one for each role; the faulty plugins derive from them."""

from __future__ import annotations

import heapq
import math

import numpy as np
from navloom import (
    Avoidance,
    Avoider,
    AvoiderInput,
    Contact,
    Context,
    Controller,
    ControllerInput,
    Localizer,
    LocalizerInput,
    Mapper,
    MapperInput,
    MapUpdate,
    OccupancyGrid,
    Odometry,
    Params,
    Path,
    PlanFailure,
    Planner,
    PlannerInput,
    Platform,
    PlatformInput,
    PlatformOutput,
    Pose2D,
    PoseEstimate,
    RangeScan,
    Recovery,
    RecoveryInput,
    RecoveryStep,
    TrackingCommand,
    Twist2D,
)
from navloom.messages import Point2D
from pydantic import Field

from planted import Entries

ENTRIES = Entries()
STILL = Twist2D(0.0, 0.0, 0.0)


class GapParams(Params):
    stop_at: float = Field(0.45, gt=0.0, le=2.0, description="Nearest thing at which it stands, m.")
    gain: float = Field(1.5, gt=0.0, le=5.0, description="Turn rate per bearing, 1/s.")


@ENTRIES.plant("gap")
class Gap(Avoider):
    """Turns to the target, and drives only as fast as it can stop before what is ahead."""

    Params = GapParams

    def avoid(self, given: AvoiderInput) -> Avoidance:
        nearest, ahead = self.near(given)
        bearing = self.bearing(given)
        limit = self.context.robot.max_angular
        turn = min(max(self.params.gain * bearing, -limit), limit)
        if nearest < self.params.stop_at:
            return Avoidance(STILL, "trapped")
        room = max(0.0, ahead - 0.55)
        speed = min(self.context.robot.max_linear, 0.8 * room) * max(0.0, math.cos(bearing)) ** 4
        return Avoidance(Twist2D(speed, 0.0, turn), "clear" if room > 1.0 else "steering")

    def near(self, given: AvoiderInput) -> tuple[float, float]:
        """Distance to the nearest obstacle all round, and ahead, m."""
        nearest = ahead = math.inf
        for scan in given.scans:
            if not scan.ranges.size:
                continue
            nearest = min(nearest, float(scan.ranges.min()))
            side = np.abs(scan.ranges * np.sin(scan.bearings)) < 0.5
            front = np.isfinite(scan.ranges) & (np.abs(scan.bearings) < 1.5) & side
            ahead = min(ahead, float((scan.ranges * np.cos(scan.bearings))[front].min(initial=math.inf)))
        return nearest, ahead

    def bearing(self, given: AvoiderInput) -> float:
        """Bearing of the target relative to the heading, rad."""
        pose = given.estimate.pose
        return math.remainder(math.atan2(given.target.y - pose.y, given.target.x - pose.x) - pose.heading, math.tau)


@ENTRIES.plant("proportional")
class Proportional(Controller):
    """Turns in proportion to the heading error and the cross-track error."""

    def control(self, given: ControllerInput) -> TrackingCommand:
        pose, reference = given.estimate.pose, given.reference
        wanted = reference.pose.heading if reference.turn_to is None else reference.turn_to
        error = math.remainder(wanted - pose.heading, math.tau)
        if reference.turn_to is not None:
            return TrackingCommand(Twist2D(0.0, 0.0, 1.5 * error), 0.0, 0.0, error)
        turn = reference.turn_rate + 1.5 * error - 1.5 * reference.cross_track
        limit = self.context.robot.max_angular
        turn = min(max(turn, -limit), limit)
        return TrackingCommand(Twist2D(reference.speed, 0.0, turn), 0.0, -reference.cross_track, error)


@ENTRIES.plant("flood")
class Flood(Planner):
    """Dijkstra's search on the map's cells, grown by the circumscribed disc."""

    def plan(self, given: PlannerInput) -> Path | PlanFailure:
        request, grid = given.request, given.map.grid
        free = self.free(grid)
        ends = [self.cell(grid, place) for place in (request.start, request.goal)]
        for (row, col), place, kind in zip(ends, (request.start, request.goal), ("start", "goal"), strict=True):
            if not (0 <= row < free.shape[0] and 0 <= col < free.shape[1]):
                return self.failure(given, "outside_map", place, f"the {kind} lies outside")
            if not free[row, col]:
                return self.failure(given, f"{kind}_occupied", place, f"the {kind} is occupied")
        cells = self.search(free, *ends)
        if not cells:
            return self.failure(given, "no_path", request.goal, "the goal cannot be reached")
        inner = [self.place(grid, cell) for cell in cells[1:-1]]
        points = np.array([(request.start.x, request.start.y), *inner, (request.goal.x, request.goal.y)])
        return Path(request.request_id, points, float(np.hypot(*np.diff(points, axis=0).T).sum()), None)

    def failure(self, given: PlannerInput, kind: str, place: Pose2D, why: str) -> PlanFailure:
        return PlanFailure(given.request.request_id, kind, Point2D(place.x, place.y), why)  # type: ignore[arg-type]

    def radius(self) -> float:
        """Radius by which obstacles are inflated, m."""
        return float(np.hypot(*self.context.robot.footprint.T).max())

    def free(self, grid: OccupancyGrid) -> np.ndarray:
        from scipy.ndimage import distance_transform_edt

        occupied = grid.cells >= 50
        if not occupied.any():
            return ~occupied
        return distance_transform_edt(~occupied) * grid.resolution > self.radius()

    def cell(self, grid: OccupancyGrid, place: Pose2D) -> tuple[int, int]:
        dx, dy, turn = place.x - grid.origin.x, place.y - grid.origin.y, grid.origin.heading
        x, y = dx * math.cos(turn) + dy * math.sin(turn), dy * math.cos(turn) - dx * math.sin(turn)
        return math.floor(y / grid.resolution), math.floor(x / grid.resolution)

    def place(self, grid: OccupancyGrid, cell: tuple[int, int]) -> tuple[float, float]:
        x, y, turn = (cell[1] + 0.5) * grid.resolution, (cell[0] + 0.5) * grid.resolution, grid.origin.heading
        return (grid.origin.x + x * math.cos(turn) - y * math.sin(turn),
                grid.origin.y + x * math.sin(turn) + y * math.cos(turn))  # fmt: skip

    def search(self, free: np.ndarray, start: tuple[int, int], goal: tuple[int, int]) -> list[tuple[int, int]]:
        rows, cols = free.shape
        is_free, best, before = free.tolist(), {start: 0.0}, {start: start}
        queue = [(0.0, start)]
        while queue:
            cost, at = heapq.heappop(queue)
            if at == goal:
                break
            if cost > best[at]:
                continue
            for down, right, length in self.steps():
                row, col = at[0] + down, at[1] + right
                if 0 <= row < rows and 0 <= col < cols and is_free[row][col]:
                    total = cost + length
                    if total < best.get((row, col), math.inf):
                        best[row, col], before[row, col] = total, at
                        heapq.heappush(queue, (total, (row, col)))
        if goal not in before:
            return []
        cells = [goal]
        while cells[-1] != start:
            cells.append(before[cells[-1]])
        return cells[::-1]

    def steps(self) -> list[tuple[int, int, float]]:
        around = [(down, right) for down in (-1, 0, 1) for right in (-1, 0, 1) if down or right]
        return [(down, right, math.hypot(down, right)) for down, right in around]


@ENTRIES.plant("from_start")
class FromStart(Localizer):
    """The odometry, moved to the start pose."""

    accepts = ()

    def localize(self, given: LocalizerInput) -> PoseEstimate:
        start, seen = self.context.start, given.odometry.pose
        cos, sin = math.cos(start.heading), math.sin(start.heading)
        heading = math.remainder(start.heading + seen.heading, math.tau)
        pose = Pose2D(start.x + cos * seen.x - sin * seen.y, start.y + sin * seen.x + cos * seen.y, heading)
        return PoseEstimate(given.odometry.stamp_ns, pose, given.odometry.twist, np.zeros((3, 3)))


class HitsParams(Params):
    cell: float = Field(0.1, gt=0.0, le=1.0, description="Edge of a cell, m.")


@ENTRIES.plant("hits")
class Hits(Mapper):
    """A map of 16 m x 16 m round the start, occupied where beams ended."""

    accepts = (RangeScan,)
    Params = HitsParams

    def __init__(self, params: HitsParams, context: Context) -> None:
        super().__init__(params, context)
        self.side = round(16.0 / params.cell)
        self.reset()

    def reset(self) -> None:
        self.cells = np.zeros((self.side, self.side), np.int8)
        self.due_ns = 0

    def update(self, given: MapperInput) -> MapUpdate | None:
        if given.clear:
            self.reset()
        for scan in given.scans:
            self.insert(scan, given)
        if given.stamp_ns < self.due_ns or not given.scans:
            return None
        self.due_ns = given.stamp_ns + 500_000_000
        return MapUpdate(
            given.stamp_ns, OccupancyGrid(self.cells, self.params.cell, self.origin()), np.empty((0, 4)), ()
        )

    def origin(self) -> Pose2D:
        return Pose2D(self.context.start.x - 8.0, self.context.start.y - 8.0, 0.0)

    def insert(self, scan: RangeScan, given: MapperInput) -> None:
        if not len(given.track.poses):
            return
        x, y, heading = given.track.poses[np.argmin(np.abs(given.track.stamps_ns - scan.stamp_ns))].tolist()
        heard = np.isfinite(scan.ranges) & (scan.ranges < scan.range_max) & (scan.ranges > scan.range_min)
        turn = scan.bearings[heard] + heading
        across = scan.origins[heard]
        px = x + math.cos(heading) * across[:, 0] - math.sin(heading) * across[:, 1] + scan.ranges[heard] * np.cos(turn)
        py = y + math.sin(heading) * across[:, 0] + math.cos(heading) * across[:, 1] + scan.ranges[heard] * np.sin(turn)
        self.mark(px, py)

    def mark(self, x: np.ndarray, y: np.ndarray) -> None:
        origin = self.origin()
        cols = np.floor((x - origin.x) / self.params.cell).astype(int)
        rows = np.floor((y - origin.y) / self.params.cell).astype(int)
        inside = (rows >= 0) & (cols >= 0) & (rows < self.side) & (cols < self.side)
        self.cells[rows[inside], cols[inside]] = 100


@ENTRIES.plant("dot")
class Dot(Platform):
    """Drives exactly as commanded, on an empty floor."""

    sensor_kinds = {"laser": RangeScan}
    is_simulated = True

    def __init__(self, params: Params, context: Context) -> None:
        super().__init__(params, context)
        self.reset()

    def reset(self) -> None:
        self.x = self.y = self.heading = 0.0
        self.time_ns = 0

    def advance(self, given: PlatformInput) -> PlatformOutput:
        dt = max(0, given.time_ns - self.time_ns) * 1e-9
        self.time_ns = given.time_ns
        v, w = given.command.vx, given.command.wz
        half = self.heading + 0.5 * w * dt
        self.x += v * math.cos(half) * dt
        self.y += v * math.sin(half) * dt
        self.heading = math.remainder(self.heading + w * dt, math.tau)
        scans = {spec.name: self.scan(given) for spec in self.context.sensors}
        return PlatformOutput(self.odometry(given, v, w), scans, Contact(False), None)

    def odometry(self, given: PlatformInput, v: float, w: float) -> Odometry:
        return Odometry(given.time_ns, Pose2D(self.x, self.y, self.heading), Twist2D(v, 0.0, w))

    def scan(self, given: PlatformInput) -> RangeScan:
        zeros = np.zeros(8)
        bearings = np.linspace(-1.4, 1.4, 8)
        return RangeScan(given.time_ns, np.zeros((8, 2)), bearings, zeros, zeros, np.full(8, np.inf), 0.05, 5.0)


class PauseParams(Params):
    pause: float = Field(1.0, ge=0.0, le=60.0, description="How long it stands, s.")


@ENTRIES.plant("pause")
class Pause(Recovery):
    """Stops for a while."""

    accepts = ()
    Params = PauseParams

    def __init__(self, params: PauseParams, context: Context) -> None:
        super().__init__(params, context)
        self.until_ns = 0

    def reset(self) -> None:
        self.until_ns = 0

    def recover(self, given: RecoveryInput) -> RecoveryStep:
        if given.starts:
            self.until_ns = given.stamp_ns + round(self.params.pause * 1e9)
        is_over = given.stamp_ns >= self.until_ns
        return RecoveryStep(STILL, "done" if is_over else "running", is_over)

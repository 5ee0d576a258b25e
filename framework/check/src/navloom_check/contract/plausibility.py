"""Whether the numbers in an answer can be right: lengths, covariances, angles and stamps."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from navloom.geometry.cells import cells_at, has_cells, places_of
from navloom.geometry.polylines import Polyline
from navloom.geometry.world import Place
from navloom.messages import MapUpdate, Message, OccupancyGrid, Odometry, Path, Pose2D, RangeScan, Twist2D
from navloom.plugins.registry import NODE
from navloom.roles import LocalizerInput
from numpy.typing import NDArray

from navloom_check.behaviour.measurements import Maker, Unfit, full_scan
from navloom_check.behaviour.obstacle_scene import Scene, grid_of, post, wall
from navloom_check.check_bench import Bench, alike
from navloom_check.checks import check
from navloom_check.findings import Finding, NotRun

__all__ = ["CHECKS"]

Floats = NDArray[np.float64]

SHORTER, LONGER = 0.98, 3.0
"""Least and greatest ratio of a path's length to that of its points: pruning makes points shorter, never longer."""
OCCUPIED = 50
"""Occupancy, percent, from which a cell is blocked."""
BLOCKED = 0.05
"""Share of a path that may touch blocked cells: a diagonal step touches their corners."""
FREE = 0.05
"""Greatest share of the map's occupied cells that are free in a traversable grid: the robot may stand in some."""
ENDS = 0.5
"""Length at each end of a path that is not judged, m."""
SECOND_NS = 1_000_000_000
TICK_NS = 50_000_000
"""Greatest lead of the stamp of a reading over the run clock, ns."""
UNITS = 500
"""A stamp that is this many times smaller than the run clock is not in ns."""
FULL_TURN = math.tau + 1e-6
TURNED_BY = (0.25 * math.pi, 0.5 * math.pi)
"""Angles by which a drive is turned, rad."""
DRIVE, TICK_WAY = 100, 0.02
"""Ticks of that drive, and the way in each, m."""
SOON = 20
"""Ticks after which the covariance of a drive without readings is looked at first."""
SAME_SHARE, SAME_RATIO = 0.4, 3.0
"""Greatest difference of turned position covariances, as a share of the larger variance; ratio of heading variances."""
LEAST_VARIANCE = 1e-8
"""Variance below which differences do not matter, m² or rad²."""
ROOM = (wall(-3.0, -0.8, 3.0, -0.8), wall(3.0, -0.8, 3.0, 1.4), wall(3.0, 1.4, -3.0, 1.4), wall(-3.0, 1.4, -3.0, -0.8))
"""Walls of a long room, 6 m x 2.2 m, in which the place along it is less sure than that across."""


def _answers(bench: Bench) -> Iterator[tuple[Any, Any, int, Any]]:
    """Scene, input, step number and answer of each step of the sound scenes."""
    for scene in bench.sound():
        with alike():
            player = bench.player(scene)
            for step, given in enumerate(scene.inputs):
                yield scene, given, step, player.step(given)


@check("contract", {"planner"}, "A path's length is that of its points, or more if points were pruned.")
def path_length(bench: Bench) -> Iterator[Finding]:
    """The stated length, m, is compared with that of the polyline through the points."""
    for scene, given, step, answer in _answers(bench):
        if not isinstance(answer, Path):
            continue
        along = float(np.hypot(*np.diff(answer.points, axis=0).T).sum())
        slack = 3.0 * given.map.grid.resolution if answer.traversable is None else 3.0 * answer.traversable.resolution
        if not SHORTER * along - slack <= answer.length <= LONGER * along + slack:
            yield Finding(
                f"gives a path of length {answer.length:.2f} m whose points are {along:.2f} m long",
                "the length of the path as planned, m", given=bench.at(scene, step), scene=scene.name,
            )  # fmt: skip
            return


@check("contract", {"planner"}, "A path leads through free cells of its own traversable grid.")
def traversable(bench: Bench) -> Iterator[Finding]:
    """Paths are pruned and smoothed within that grid. Near the ends of a path, obstacles may be close."""
    for scene, given, step, answer in _answers(bench):
        if not isinstance(answer, Path) or answer.traversable is None:
            continue
        free = _free_share(given.map.grid, answer.traversable)
        if free > FREE:
            yield Finding(
                f"gives a traversable grid in which {free:.0%} of the map's occupied cells are free",
                "100 where the robot's centre may not be, which is in and near each cell of the map at 100",
                given=bench.at(scene, step), scene=scene.name,
            )  # fmt: skip
            return
        share = _blocked_share(answer.points, answer.traversable)
        if share > BLOCKED:
            yield Finding(
                f"gives a path of which {share:.0%} leads through occupied cells of its own traversable grid",
                "the grid in which the path was searched: the same rows, columns, origin and resolution",
                given=bench.at(scene, step), scene=scene.name,
            )  # fmt: skip
            return


def _blocked_share(points: Floats, grid: OccupancyGrid) -> float:
    """Share of a path that lies in occupied cells of a grid or outside the grid, without the path's two ends."""
    line = Polyline(points)
    distances = np.arange(ENDS, line.length - ENDS, 0.25 * grid.resolution)
    if not len(distances):
        return 0.0
    return 1.0 - float(_is_free(grid, line.at(distances)).mean())


def _free_share(map_grid: OccupancyGrid, grid: OccupancyGrid) -> float:
    """Share of the centres of a map's cells at 100 that lie in free cells of another grid."""
    occupied = np.argwhere(map_grid.cells == 100)
    return float(_is_free(grid, places_of(map_grid, occupied)).mean()) if len(occupied) else 0.0


def _is_free(grid: OccupancyGrid, points: Floats) -> NDArray[np.bool_]:
    """(n,) which points, (n, 2) m, map frame, lie in free cells of a grid; none outside the grid does."""
    cells = cells_at(grid, points)
    is_free = has_cells(grid, cells)
    known = cells[is_free]
    is_free[is_free] = grid.cells[known[:, 0], known[:, 1]] < OCCUPIED
    return is_free


@check("contract", {"localizer"}, "The covariance is symmetric, and no direction has a negative variance.")
def covariance(bench: Bench) -> Iterator[Finding]:
    """Filters and gates invert the covariance."""
    for scene, _, step, answer in _answers(bench):
        given = answer.covariance
        scale = max(float(np.abs(given).max()), 1e-12)
        least = float(np.linalg.eigvalsh(0.5 * (given + given.T)).min())
        if float(np.abs(given - given.T).max()) > 1e-6 * scale:
            said = f"gives a covariance that is not symmetric: {given.tolist()}"
        elif least < -1e-6 * scale:
            said = f"gives a covariance with the negative eigenvalue {least:.3g}: {given.tolist()}"
        else:
            continue
        yield Finding(said, "0.5 * (C + C.T) of a matrix C = A @ A.T", given=bench.at(scene, step), scene=scene.name)
        return


@check(
    "contract", {"localizer"}, "The covariance turns with the robot and its surroundings, x, y, heading in this order."
)
def covariance_turns(bench: Bench) -> Iterator[Finding]:
    """A drive with exact odometry through a room, and the same drive with robot, room and raster turned in the map.

    Turned by 45°, also a covariance whose x and y are swapped differs; turned by 90°, one whose heading is swapped.
    """
    bench.sound()
    make = Maker(bench.subject.thing, bench.subject.params, bench.seed)
    with alike():
        try:
            plain, *turned = (_last_covariance(make, angle) for angle in (0.0, *TURNED_BY))
        except Unfit as error:
            raise NotRun(str(error)) from None
    scale = max(float(np.linalg.eigvalsh(plain[:2, :2]).max()), LEAST_VARIANCE)
    for angle, found in zip(TURNED_BY, turned, strict=True):
        turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
        expected = turn @ plain[:2, :2] @ turn.T
        off = float(np.abs(found[:2, :2] - expected).max()) / scale
        heading, other = (max(float(one[2, 2]), LEAST_VARIANCE) for one in (plain, found))
        if off > SAME_SHARE or not 1.0 / SAME_RATIO < other / heading < SAME_RATIO:
            yield Finding(
                f"gives the variances {_numbers(np.diag(plain))} at the end of a drive, and {_numbers(np.diag(found))} "
                f"when all is turned by {math.degrees(angle):.0f}°",
                f"x, y and heading of the map frame in this order, m², m², rad²: here {_numbers(np.diag(expected))} "
                f"and {heading:.2g}", given="a drive through a room with exact odometry",
            )  # fmt: skip
            return


@check("contract", {"localizer"}, "The covariance grows while the robot drives and sees nothing.")
def covariance_grows(bench: Bench) -> Iterator[Finding]:
    """A drive of 2 m without a reading. A localizer that gives no covariance, which is 0, is not judged."""
    if any(not issubclass(kind, RangeScan) for kind in bench.subject.thing.accepts):
        raise NotRun("it reads other sensors, which may show where it is")
    bench.sound()
    make = Maker(bench.subject.thing, bench.subject.params, bench.seed)
    with alike():
        try:
            early, late = (_last_covariance(make, 0.0, ticks, is_blind=True) for ticks in (SOON, DRIVE))
        except Unfit as error:
            raise NotRun(str(error)) from None
    before, after = (float(np.trace(found[:2, :2])) for found in (early, late))
    if before > 0.0 and after <= before:
        yield Finding(
            f"gives position variances of {before:.2g} m² in all after {SOON * TICK_WAY:g} m without a reading, and "
            f"{after:.2g} m² after {DRIVE * TICK_WAY:g} m", "a covariance that grows with the way, as odometry drifts",
            given="a straight drive with odometry alone",
        )  # fmt: skip


def _last_covariance(make: Maker, angle: float, ticks: int = DRIVE, *, is_blind: bool = False) -> Floats:
    """Covariance at the end of a straight drive through a room that is turned by an angle, rad.

    Args:
        make: Makes the localizer.
        angle: Turn of the room, rad.
        ticks: Duration of the drive, 2 cm a tick.
        is_blind: There are no scans.
    """
    scene = Scene(Place(-1.0, 0.3), (1.0, 0.3), (post(0.5, 1.2, 0.2), *ROOM))
    turned = scene.moved(Place(0.0, 0.0, angle))
    grid = grid_of(scene, Place(0.0, 0.0, angle))
    localizer, sees = make(turned, map=grid), make.sees(RangeScan) and not is_blind
    known, heading = MapUpdate(0, grid, np.empty((0, 4)), ()), turned.start.heading
    for tick in range(ticks):
        way, stamp_ns = tick * TICK_WAY, tick * TICK_NS
        pose = (turned.start.x + way * math.cos(heading), turned.start.y + way * math.sin(heading), heading)
        speed = TICK_WAY / (1e-9 * TICK_NS)
        odometry = Odometry(stamp_ns, Pose2D(way, 0.0, 0.0), Twist2D(speed, 0.0, 0.0))
        scans = (full_scan(turned, pose, stamp_ns),) if sees else ()
        extra = make.extra(turned, stamp_ns, pose, (speed, 0.0), grid=lambda: grid)
        answer = localizer.localize(LocalizerInput(odometry, scans, known, ("laser",) * len(scans), extra=extra))
    found: Floats = answer.covariance
    return found


def _numbers(values: Floats) -> str:
    return ", ".join(f"{value:.2g}" for value in values)


@check("contract", {"platform"}, "Bearings and half angles of scans are in rad, ranges below range_max, and "
       "beams begin within 10 m of base.")  # fmt: skip
def scan_geometry(bench: Bench) -> Iterator[Finding]:
    """Larger values mean wrong units: no sensor has them."""
    for scene, _, step, answer in _answers(bench):
        for name, scan in answer.scans.items():
            if not isinstance(scan, RangeScan) or not scan.ranges.size:
                continue
            widest = max(float(np.abs(scan.bearings).max()), float(scan.half_angles.max()))
            farthest = float(np.abs(scan.origins).max())
            longest = float(scan.ranges[np.isfinite(scan.ranges)].max(initial=0.0))
            if widest > FULL_TURN:
                said, expected = f"gives a scan of {name!r} with an angle of {widest:.3g} rad", "rad, not degrees"
            elif farthest > 10.0:
                said, expected = f"gives a scan of {name!r} whose beams begin {farthest:.3g} m from base", "m, not mm"
            elif longest >= scan.range_max:
                said = (
                    f"gives a scan of {name!r} with a range of {longest:.3g} m, and range_max = {scan.range_max:.3g} m"
                )
                expected = "ranges below range_max, in m, and +inf for no echo; a reading of range_max or more is none"
            else:
                continue
            yield Finding(said, expected, given=bench.at(scene, step), scene=scene.name)
            return


@check("contract", {"mapper", "platform", NODE}, "Stamps are on the run clock, in ns.")
def stamps(bench: Bench) -> Iterator[Finding]:
    """Once the run clock is past 1 s, a stamp in s or ms is far too small for one in ns."""
    before: MapUpdate | None = None
    for scene, given, step, answer in _answers(bench):
        if isinstance(answer, MapUpdate):
            if before is not None and step and _is_restless(before, answer):
                yield Finding(
                    f"gives another map with the same stamp {answer.stamp_ns}", "the stamp of the newest data in it",
                    given=bench.at(scene, step), scene=scene.name,
                )  # fmt: skip
                return
            before = answer
        now_ns = _now_ns(bench.subject.kind, given)
        ahead_ns = TICK_NS if bench.subject.kind == "platform" else SECOND_NS
        for name, stamp_ns in _stamps_of(answer.scans if bench.subject.kind == "platform" else answer):
            if stamp_ns > now_ns + ahead_ns or (now_ns >= SECOND_NS and 0 < stamp_ns < now_ns / UNITS):
                yield Finding(
                    f"gives {name} = {stamp_ns} at {now_ns} ns of the run clock", "ns of the run clock, as in the "
                    "stamps of its inputs", given=bench.at(scene, step), scene=scene.name,
                )  # fmt: skip
                return


def _is_restless(before: MapUpdate, after: MapUpdate) -> bool:
    """Whether the cells of a map changed and its stamp did not."""
    return before.stamp_ns == after.stamp_ns and not np.array_equal(before.grid.cells, after.grid.cells)


def _now_ns(kind: str, given: Any) -> int:
    """Run clock of an input, ns."""
    if kind == "platform":
        return int(given.time_ns)
    return int(given.tick.time_ns if kind == NODE else given.stamp_ns)


def _stamps_of(answer: Any) -> Iterator[tuple[str, int]]:
    """Name and value of each stamp in an answer."""
    if isinstance(answer, Message):
        for name, kind in answer.kinds.items():
            value = getattr(answer, name)
            if kind.rule == "stamp":
                yield f"{type(answer).__name__}.{name}", value
            else:
                yield from _stamps_of(value)
    elif isinstance(answer, (tuple, list)):
        for one in answer:
            yield from _stamps_of(one)
    elif isinstance(answer, Mapping):
        yield from _stamps_of(tuple(answer.values()))


CHECKS = (path_length, traversable, covariance, covariance_turns, covariance_grows, scan_geometry, stamps)

"""Scenes and measures of localizers and mappers: generated rooms, and what a pitching laser sees of them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from navloom.geometry.cells import cells_at, has_cells
from navloom.geometry.echoes import scan_points
from navloom.geometry.frames import compose, transform
from navloom.geometry.world import Box, Place
from navloom.messages import MapUpdate, OccupancyGrid, Odometry, Pose2D, PoseTrack, RangeScan, Sweep, Twist2D
from navloom.roles import LocalizerInput, MapperInput
from navloom.roles.claims import Claim
from numpy.typing import NDArray

from navloom_check.behaviour.measurements import PERIOD, PERIOD_NS, Behaviour, Line, Maker, Measured, Unfit, scan_from
from navloom_check.behaviour.obstacle_scene import MAST, Scene, ends_of, grid_of, post, wall
from navloom_check.scenes import cast

__all__ = ["LOCALIZERS", "MAPPERS"]

Floats = NDArray[np.float64]

SECONDS = 12.0
"""Duration of a drive through a room, s."""
TURNS = 4.0
"""Time at which the robot turns to the other side, s."""
NEAR, TURNED = 0.1, 0.05
"""Greatest error of a localizer's pose, m and rad."""
SPEED_OFF, TURN_OFF = 0.1, 0.3
"""Greatest median error of a localizer's twist, m/s and rad/s."""
NEAR_DRIFTING = 0.08
"""Greatest error of a localizer's position while odometry drifts, m."""
TRACKS = 0.25
"""Least share of a drive in which a localizer tracks."""
VAGUE = 1.0
"""Greatest standard deviation of the heading of a localizer that tracks, rad."""
DRIFT_WAY, DRIFT_TURN = 1.04, 0.05
"""Drift of odometry: distances are too long by this factor, and the heading is off by this much, rad per metre."""
LATE = 4
"""Delay of the scans that a mapper gets, ticks."""
SCAN_EVERY = 2
"""Ticks from one scan to the next."""
TRUE_SHARE, FOUND_SHARE = 0.9, 0.8
"""Least share of the occupied cells that lie at an obstacle, and of the hits that lie in occupied cells."""
OCCUPIED = 65
"""Occupancy, percent, from which a cell counts as occupied."""
BETTER = 0.25
"""Share of the hits that a map gains in occupied cells when it is moved by half a cell, from which it is shifted."""
MOUNT = 0.4
"""Height of the pitching laser, m."""


def room(seed: int) -> Scene:
    """A room of 7 m x 5 m with a niche and three posts; the seed chooses its place in the map.

    In every third scene, the robot drives backwards.
    """
    stream = np.random.default_rng([seed, 8])
    walls = (
        wall(-3.5, -2.5, 3.5, -2.5), wall(3.5, -2.5, 3.5, 1.0), wall(3.5, 1.0, 2.5, 1.0), wall(2.5, 1.0, 2.5, 2.5),
        wall(2.5, 2.5, -3.5, 2.5), wall(-3.5, 2.5, -3.5, -2.5),
    )  # fmt: skip
    posts = (post(-2.4, 1.6, 0.2), post(-2.5, -1.5, 0.15), post(1.8, -1.7, 0.25))
    place = Place(*stream.uniform((-4.0, -4.0, -3.0), (4.0, 4.0, 3.0)).tolist()) if seed else Place(0.0, 0.0)
    return Scene(Place(-1.2, 0.0), (1.2, 0.0), (*walls, *posts), backs=seed % 3 == 2).moved(place)


def open_room(seed: int) -> Scene:
    """The same room with an opening in a wall, through which beams meet nothing."""
    scene = room(seed)
    start, end = ends_of(scene.walls[4])
    shorter = wall(*start.tolist(), *(start + 0.3 * (end - start)).tolist())
    return replace(scene, obstacles=(*scene.obstacles[:4], shorter, *scene.obstacles[5:]))


def speed_of(scene: Scene) -> float:
    """Speed of the robot, m/s."""
    return -0.25 if scene.backs else 0.25


def true_poses(scene: Scene) -> Floats:
    """(n, 3) poses of a robot that drives a figure of eight from the scene's start, map frame, one a tick."""
    x, y, heading = scene.start.x, scene.start.y, scene.start.heading
    poses = [(x, y, heading)]
    for tick in range(round(SECONDS / PERIOD)):
        v, w = speed_of(scene), (-0.7 if tick * PERIOD < TURNS else 0.7)
        x += v * math.cos(heading + 0.5 * w * PERIOD) * PERIOD
        y += v * math.sin(heading + 0.5 * w * PERIOD) * PERIOD
        heading = math.remainder(heading + w * PERIOD, math.tau)
        poses.append((x, y, heading))
    return np.array(poses)


def odometry_of(poses: Floats, drift: bool) -> Floats:
    """(n, 3) poses in the odometry frame, whose origin is the robot's start."""
    found, at = [(0.0, 0.0, 0.0)], (0.0, 0.0, 0.0)
    for before, after in pairwise(poses):
        turn = math.remainder(float(after[2] - before[2]), math.tau)
        middle = before[2] + 0.5 * turn
        way = float((after[0] - before[0]) * math.cos(middle) + (after[1] - before[1]) * math.sin(middle))
        if drift:
            way, turn = way * DRIFT_WAY, turn + DRIFT_TURN * abs(way)
        half = at[2] + 0.5 * turn
        at = (at[0] + way * math.cos(half), at[1] + way * math.sin(half), math.remainder(at[2] + turn, math.tau))
        found.append(at)
    return np.array(found)


def _localized(make: Maker, scene: Scene, drift: bool, limit: float) -> Measured:
    if not scene.walls:
        raise Unfit("nothing in the scene shows where the robot is")
    poses = true_poses(scene)
    drifted = odometry_of(poses, drift)
    grid = grid_of(scene)
    localizer, known = make(scene, map=grid), MapUpdate(0, grid, np.empty((0, 4)), ())
    found, twists, sees = [], [], make.sees(RangeScan)
    vague, is_sure = 0.0, list[bool]()
    for tick, (pose, odometry) in enumerate(zip(poses.tolist(), drifted.tolist(), strict=True)):
        stamp_ns = tick * PERIOD_NS
        scans = (_scan(scene, pose, stamp_ns),) if sees and tick % SCAN_EVERY == 0 else ()
        driven = Twist2D(speed_of(scene), 0.0, -0.7 if tick * PERIOD < TURNS else 0.7)
        given = Odometry(stamp_ns, Pose2D(*odometry), driven)
        extra = make.extra(scene, stamp_ns, tuple(pose), (given.twist.vx, given.twist.wz))
        answer = localizer.localize(LocalizerInput(given, scans, known, ("laser",) * len(scans), extra=extra))
        estimate, twist = answer.pose, answer.twist
        is_sure.append(answer.state == "tracking")
        if is_sure[-1]:
            vague = max(vague, math.sqrt(max(0.0, float(answer.covariance[2, 2]))))
        found.append((estimate.x, estimate.y, estimate.heading))
        twists.append((twist.vx - given.twist.vx, twist.wz - given.twist.wz))
    estimates = np.array(found)
    off = np.hypot(*(estimates - poses)[:, :2].T)
    turned = np.abs((estimates[:, 2] - poses[:, 2] + math.pi) % math.tau - math.pi)
    # While it says that it searches, its pose is no statement: goals wait.
    worst, most = (float(error[is_sure].max(initial=0.0)) for error in (off, turned))
    alone = transform(poses[0], drifted[:, :2])
    lines = (Line("true", poses[:, :2]), Line("odometry alone", alone), Line("estimate", estimates, is_robot=True))
    said = f"was up to {worst:.3f} m and {most:.3f} rad off"
    if drift:
        said += f", while odometry alone is {float(np.hypot(*(alone - poses[:, :2]).T).max()):.3f} m off"
    v_off, w_off = np.median(np.abs(twists), axis=0).tolist()
    if v_off > SPEED_OFF or w_off > TURN_OFF:
        said = f"gave a twist that differs from that of the odometry by {v_off:.2f} m/s and {w_off:.2f} rad/s"
        return Measured(False, said, v_off, lines)
    if not any(is_sure):
        return Measured(False, f"never tracked: its state was {answer.state!r} to the end", float(off.max()), lines)
    if (share := float(np.mean(is_sure))) < TRACKS:
        return Measured(False, f"tracked in {share:.0%} of the drive only", float(off.max()), lines)
    if vague > VAGUE:
        said = f"tracks with a standard deviation of its heading of {vague:.1f} rad"
        return Measured(False, said, vague, lines)
    return Measured(worst <= limit and most <= TURNED, said, worst, lines)


def _scan(scene: Scene, pose: list[float], stamp_ns: int) -> RangeScan:
    """Scan of a laser that is not in the middle of the robot."""
    return scan_from(scene, MAST, (pose[0], pose[1], pose[2]), stamp_ns)


def accurate_localizer(make: Maker, scene: Scene) -> Measured:
    return _localized(make, scene, False, NEAR)


def corrects_drift(make: Maker, scene: Scene) -> Measured:
    return _localized(make, scene, True, NEAR_DRIFTING)


# --- mappers ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class MapperSeen:
    """A mapper's last map, and the points that beams hit, (n, 2) m, map frame."""

    update: MapUpdate | None
    hits: Floats


def _shown_scans(make: Maker, scene: Scene) -> MapperSeen:
    mapper, poses = make(scene, map=grid_of(scene)), true_poses(scene)
    update, hits = None, list[Floats]()
    for tick, pose in enumerate(poses[:-LATE].tolist()):
        scan, now = _scan(scene, pose, tick * PERIOD_NS), tick + LATE
        extra = make.extra(scene, now * PERIOD_NS, tuple(poses[now]))
        answer = mapper.update(
            MapperInput(now * PERIOD_NS, (), (scan,), _track(poses, now), sensors=("laser",), extra=extra)
        )
        update = answer or update
        hits.append(_places(scan, pose))
    return MapperSeen(update, np.concatenate(hits))


def _places(scan: RangeScan, pose: list[float]) -> Floats:
    return transform(np.array(pose), scan_points(scan))


def _track(poses: Floats, tick: int) -> PoseTrack:
    first = max(0, tick - 60)
    return PoseTrack(np.arange(first, tick + 1) * PERIOD_NS, poses[first : tick + 1])


def sweep_at(scene: Scene, pose: Floats, stamp_ns: int) -> tuple[Sweep, Floats]:
    """A sweep of a stopped robot, from below the horizon upwards, and its hits above the floor, (n, 2) m, map frame."""
    pitches, bearings = np.radians(np.linspace(-20.0, 5.0, 60)), np.radians(np.linspace(-50.0, 50.0, 101))
    tilt, turn = pitches[:, None], bearings + pose[2]
    ways = np.stack(np.broadcast_arrays(np.cos(tilt) * np.cos(turn), np.cos(tilt) * np.sin(turn), np.sin(tilt)), 2)
    from_laser = np.tile([pose[0], pose[1], MOUNT], (ways[..., 0].size, 1)), ways.reshape(-1, 3)
    ranges, ahead = (cast(scene.world, *from_laser, floor=floor).reshape(60, 101) for floor in (True, False))
    times = np.linspace(0.0, 1.2, 60)
    sweep = Sweep(stamp_ns, 0, ranges, pitches, times, bearings, "paper", 0.0, 0.0, MOUNT, 0.1, 80.0)
    level = np.where(ranges == ahead, ahead * np.cos(tilt), np.inf).min(axis=0)
    seen = np.isfinite(level)
    local = np.stack([level[seen] * np.cos(bearings[seen]), level[seen] * np.sin(bearings[seen])], axis=1)
    return sweep, transform(pose, local)


def _shown_sweeps(make: Maker, scene: Scene) -> MapperSeen:
    mapper, update, hits = make(scene, map=grid_of(scene)), None, []
    first = np.array([scene.start.x, scene.start.y, scene.start.heading])
    for number, turn in enumerate((0.0, 1.6, 3.1, -1.6)):
        pose = compose(first, np.array([0.0, 0.0, turn]))
        begin = number * 5_000_000_000
        sweep, places = sweep_at(scene, pose, begin)
        stamps = begin + np.arange(41) * PERIOD_NS
        track = PoseTrack(stamps, np.tile(pose, (41, 1)))
        extra = make.extra(scene, int(stamps[-1]), tuple(pose))
        answer = mapper.update(MapperInput(int(stamps[-1]), (sweep,), (), track, sweep_sensors=("laser",), extra=extra))
        update = answer or update
        hits.append(places)
    return MapperSeen(update, np.concatenate(hits))


def accurate_mapper(make: Maker, scene: Scene) -> Measured:
    """Judge the maps of sweeps and of scans separately if the mapper takes both; the worse one counts."""
    shows = []
    if make.sees(Sweep):
        shows.append(_shown_sweeps)
    if make.sees(RangeScan) or (make.cls.needs_map and not shows):
        shows.append(_shown_scans)
    if not shows:
        raise Unfit("it takes neither RangeScan nor Sweep: it sees nothing of the scenes")
    return min((_accuracy(show(make, scene), scene) for show in shows), key=lambda one: (one.holds, one.value))


def _accuracy(seen: MapperSeen, scene: Scene) -> Measured:
    if not len(seen.hits):
        raise Unfit("nothing in the scene is seen")
    if seen.update is None:
        return Measured(False, "gave no map", 0.0, (Line("hits", seen.hits, is_dots=True),))
    grid = seen.update.grid
    origin = np.array([grid.origin.x, grid.origin.y, grid.origin.heading])
    rows, cols = np.nonzero(grid.cells >= OCCUPIED)
    cells = transform(origin, (np.stack([cols, rows], axis=1) + 0.5) * grid.resolution)
    slack = grid.resolution + 0.05
    right = _near_share(cells, _surface(scene), slack)
    found = _near_share(seen.hits, cells, slack)
    lines = (Line("occupied cells", cells, is_dots=True), Line("hits", seen.hits[::7], is_dots=True))
    said = (
        f"had {right:.0%} of its occupied cells at obstacles, and {found:.0%} of the hits in them, within {slack:.2f} m"
    )
    x, y, gain = _best_shift(grid, seen.hits)
    if gain > BETTER:
        said = f"is shifted: moved by ({x:g}, {y:g}) cells, it has {gain:.0%} more of the hits in occupied cells"
        return Measured(False, said, min(right, found), lines)
    return Measured(right >= TRUE_SHARE and found >= FOUND_SHARE, said, min(right, found), lines)


def _best_shift(grid: OccupancyGrid, hits: Floats) -> tuple[float, float, float]:
    """Half cells along the raster's axes that fit the hits best, and the share of hits in occupied cells they gain.

    Hits lie in occupied cells, unless the raster as a whole is shifted.
    """
    moves = [(x, y) for x in (0.0, -0.5, 0.5) for y in (0.0, -0.5, 0.5)]
    turn = np.array([0.0, 0.0, grid.origin.heading])
    shares = [_occupied_share(grid, hits - transform(turn, grid.resolution * np.array(move))) for move in moves]
    best = int(np.argmax(shares))
    return *moves[best], shares[best] - shares[0]


def _occupied_share(grid: OccupancyGrid, points: Floats) -> float:
    """Share of points, (n, 2) m, map frame, that lie in occupied cells."""
    cells = cells_at(grid, points)
    known = cells[has_cells(grid, cells)]
    return float((grid.cells[known[:, 0], known[:, 1]] >= OCCUPIED).sum()) / len(points)


def _near_share(points: Floats, others: Floats, reach: float) -> float:
    from scipy.spatial import KDTree

    if not len(points) or not len(others):
        return 0.0
    return float((KDTree(others).query(points)[0] <= reach).mean())


def _surface(scene: Scene) -> Floats:
    """(n, 2) points on the posts and walls of a scene, 2 cm apart, m, map frame."""
    found = []
    for one in scene.obstacles:
        if isinstance(one, Box):
            start, end = ends_of(one)
            share = np.linspace(0.0, 1.0, 2 + int(np.hypot(*(end - start)) / 0.02))[:, None]
            found.append((1.0 - share) * start + share * end)
        else:
            turns = np.linspace(0.0, math.tau, max(8, int(math.tau * one.radius / 0.02)))
            found.append(np.stack([one.x + one.radius * np.cos(turns), one.y + one.radius * np.sin(turns)], axis=1))
    return np.concatenate(found) if found else np.empty((0, 2))


def _alike(
    measure: Callable[[Maker, Scene], Measured], other_of: Callable[[Scene], Scene]
) -> Callable[[Maker, Scene], Measured]:
    """Measure whether another scene gives the same value: errors within 2 cm, shares within 2 percentage points."""

    def measured(make: Maker, scene: Scene) -> Measured:
        other = other_of(scene)
        here, there = measure(make, scene), measure(make, other)
        off = abs(here.value - there.value)
        said = f"{here.said}, and {there.said} in the other scene"
        return Measured(off <= 0.02, said, off, (*here.lines, *there.lines), (scene, other))

    return measured


def _moved(scene: Scene) -> Scene:
    return scene.moved(Place(3.37, -1.81))


def _turned(scene: Scene) -> Scene:
    return scene.moved(Place(0.0, 0.0, 0.7))


LOCALIZERS = (
    Behaviour("localizer", Claim.ACCURATE, f"at most {NEAR} m and {TURNED} rad off with exact odometry",
              room, accurate_localizer, 3, False),
    Behaviour("localizer", Claim.CORRECTS_DRIFT, f"at most {NEAR_DRIFTING} m and {TURNED} rad off",
              room, corrects_drift, 3, False),
    Behaviour("localizer", Claim.TRANSLATION, "the same error within 2 cm", room, _alike(accurate_localizer, _moved), 2,
              False),
    Behaviour("localizer", Claim.ROTATION, "the same error within 2 cm", room, _alike(accurate_localizer, _turned), 2,
              False),
)  # fmt: skip
MAPPERS = (
    Behaviour("mapper", Claim.ACCURATE,
              f"{TRUE_SHARE:.0%} of the occupied cells at obstacles, and {FOUND_SHARE:.0%} of the hits in them",
              open_room, accurate_mapper, 3),
    Behaviour("mapper", Claim.TRANSLATION, "the same shares within 2 %", open_room, _alike(accurate_mapper, _moved), 2),
    Behaviour("mapper", Claim.ROTATION, "the same shares within 2 %", open_room, _alike(accurate_mapper, _turned), 2),
)  # fmt: skip

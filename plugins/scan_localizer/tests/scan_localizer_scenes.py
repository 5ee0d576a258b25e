"""Made scenes for the localizer's judgement: maps, what they lack, drives, lasers and wrong beliefs, from a seed."""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass, field

import numpy as np
from navloom import Context, LocalizerInput, OccupancyGrid, Odometry, Pose2D, RangeScan, RobotSpec, Twist2D
from navloom_scan_localizer.adapter import ScanMatching
from navloom_scan_localizer.params import ScanMatchingParams
from navloom_scans.poses import compose, relative
from scan_localizer_rooms import fan, ranges_in
from scipy.ndimage import distance_transform_edt, uniform_filter1d

CELL, PERIOD, SPEED, STANDING = 0.05, 0.1, 0.5, 3.0
"""Edge of a cell, m; time of a tick, s; speed, m/s; time that the robot stands before it drives, s."""
LOST_AFTER = 5.0
"""Time without tracking after which a goal ends lost, s."""
BODY = 0.4
"""Least distance of the path from what is in the world, m."""
ROBOT = RobotSpec(np.array([[-0.2, -0.2], [0.2, -0.2], [0.2, 0.2], [-0.2, 0.2]]), 0.6, 0.05, 0.2, 0.5, 1.0, 0.5, 1.0)


@dataclass
class Scene:
    """One drive. Poses are x, y, m, heading, rad, in the frame of the raster, whose cell (0, 0) begins at (0, 0).

    Attributes:
        kind: What is tried.
        known, world: (rows, columns) occupied cells of the map and of the world.
        path: (n, 3) true poses, SPEED * PERIOD apart.
        belief: (3,) pose at which the robot believes it starts.
        laser: Field of view, degrees; range, m; standard deviation of a range, m.
        people: (k, 4) x, y, m, and velocity, m/s, of discs of 0.25 m at the start.
        taken_at: Tick of the drive at which the robot is carried off; None if it is not.
        taken_to: (n, 3) the true poses after that.
    """

    kind: str
    known: np.ndarray
    world: np.ndarray
    path: np.ndarray
    belief: np.ndarray
    laser: tuple[float, float, float]
    people: np.ndarray = field(default_factory=lambda: np.empty((0, 4)))
    taken_at: int | None = None
    taken_to: np.ndarray | None = None


# --- maps -----------------------------------------------------------------------------------------------------------


def cells(*edges):
    """Numbers of cells that lengths in m have."""
    return [round(edge / CELL) for edge in edges]


def box(raster, x, y, width, depth, value=True):
    """Fill a box, m, whose lower left corner is x, y."""
    left, bottom, right, top = cells(x, y, x + width, y + depth)
    raster[max(0, bottom) : max(0, top), max(0, left) : max(0, right)] = value


def empty(width, depth):
    raster = np.ones(cells(depth, width), dtype=np.bool_)
    box(raster, 0.1, 0.1, width - 0.2, depth - 0.2, False)
    return raster


def rooms(rng):
    """Six rooms of random sizes with doors of 1 m and some mapped cupboards."""
    width, depth = 14.0, 9.0
    raster = empty(width, depth)
    walls, middle = [rng.uniform(4.0, 5.2), rng.uniform(8.8, 10.0)], rng.uniform(4.0, 5.0)
    box(raster, 0.0, middle, width, 0.1)
    for wall in walls:
        box(raster, wall, 0.0, 0.1, depth)
        for low, high in ((0.5, middle - 1.5), (middle + 0.5, depth - 1.5)):
            box(raster, wall, rng.uniform(low, high), 0.1, 1.0, False)
    for low, high in zip([0.5, *(w + 0.5 for w in walls)], [*(w - 1.5 for w in walls), width - 1.5], strict=True):
        box(raster, rng.uniform(low, high), middle, 1.0, 0.1, False)
    for _ in range(8):
        box(raster, rng.uniform(0.1, width - 1.0), rng.choice([0.1, depth - 0.6]), rng.uniform(0.5, 1.2), 0.5)
    return raster


def hall(rng):
    """A hall with pillars at random places."""
    raster = empty(18.0, 12.0)
    for _ in range(7):
        box(raster, rng.uniform(1.0, 16.0), rng.uniform(1.0, 10.0), rng.uniform(0.3, 1.2), rng.uniform(0.3, 1.2))
    return raster


def corridor(rng):
    """A corridor of 2.2 m with niches of random width at random distances."""
    raster = np.ones(cells(5.0, 26.0), dtype=np.bool_)
    box(raster, 0.1, 1.4, 25.8, 2.2, False)
    for y in (0.9, 3.6):
        at = rng.uniform(1.0, 4.0)
        while at < 24.0:
            box(raster, at, y, rng.uniform(0.8, 1.6), 0.5, False)
            at += rng.uniform(2.5, 7.0)
    return raster


def aisles(rng):
    """Racks of one size with aisles of 1.8 m between them, and a way round."""
    raster = empty(20.0, 13.0)
    for k in range(4):
        box(raster, 2.5, 1.9 + 2.8 * k, 15.0, 1.0)
    box(raster, rng.uniform(3.0, 16.0), 0.1, 1.0, 0.3)
    box(raster, rng.choice([0.1, 19.4]), rng.uniform(2.0, 10.0), 0.5, 1.0)
    return raster


def cabins(rng):
    """Five rooms that look the same along a corridor."""
    raster = empty(20.2, 6.6)
    box(raster, 0.0, 4.5, 20.2, 0.1)
    at = rng.uniform(0.5, 2.5)
    for k in range(5):
        box(raster, 4.0 + 4.0 * k, 0.0, 0.1, 4.5)
        box(raster, 4.0 * k + at, 4.5, 1.0, 0.1, False)
        box(raster, 4.0 * k + 0.1, 1.0, 0.5, 1.2)
    return raster


MAPS = (rooms, hall, corridor, aisles, cabins)


# --- drives ---------------------------------------------------------------------------------------------------------


def way(world, metres, rng, start=None):
    """(n, 3) poses on a shortest path of about that length, BODY from walls, from a cell or a random one; or None."""
    free = (distance_transform_edt(~world) * CELL > BODY)[::2, ::2]
    places = np.argwhere(free)
    if not len(places):
        return None
    begin = tuple(places[rng.integers(len(places))]) if start is None else start
    best, parents, heap, done = {begin: 0.0}, {}, [(0.0, begin)], []
    while heap:
        cost, at = heapq.heappop(heap)
        if cost > best[at]:
            continue
        done.append(at)
        if cost >= metres / (2 * CELL):
            break
        for down, across in ((0, 1), (1, 0), (0, -1), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)):
            other, further = (at[0] + down, at[1] + across), cost + math.hypot(down, across)
            inside = 0 <= other[0] < free.shape[0] and 0 <= other[1] < free.shape[1]
            if inside and free[other] and further < best.get(other, math.inf):
                best[other], parents[other] = further, at
                heapq.heappush(heap, (further, other))
    points = [done[-1]]
    while points[-1] != begin:
        points.append(parents[points[-1]])
    points = (2 * np.array(points[::-1])[:, ::-1] + 0.5) * CELL
    along = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))))
    if along[-1] < 0.4 * metres:
        return None
    at = np.arange(0.0, along[-1], SPEED * PERIOD)
    dense = np.column_stack([uniform_filter1d(np.interp(at, along, points[:, k]), 11, mode="nearest") for k in (0, 1)])
    steps = np.diff(dense, axis=0)
    return np.column_stack((dense[:-1], np.arctan2(steps[:, 1], steps[:, 0])))


def some_way(world, metres, rng):
    while True:
        found = way(world, metres, rng)
        if found is not None:
            return found


def some_laser(rng):
    return (
        float(rng.choice([180.0, 270.0, 360.0])),
        float(rng.choice([5.0, 20.0])),
        float(rng.choice([0.01, 0.02, 0.03])),
    )


def is_clear(path, x, y, width, depth, gap=0.45):
    """Whether a box leaves a path free."""
    off = np.maximum(0.0, np.maximum((x, y) - path[:, :2], path[:, :2] - (x + width, y + depth)))
    return np.hypot(*off.T).min() > gap


def beside(known, path, rng, count, low, high, away):
    """The world with boxes of random edges, m, placed within a distance of the path, m, but not on it."""
    world = known.copy()
    for _ in range(count):
        at = path[rng.integers(len(path))]
        x, y = at[:2] + rng.uniform(-away, away, 2)
        width, depth = rng.uniform(low, high, 2)
        if is_clear(path, x, y, width, depth):
            box(world, x, y, width, depth)
    return world


def unmapped(kind, rng):
    """A drive past things that are not on the map."""
    make = {"door": rooms}.get(kind) or MAPS[rng.integers(len(MAPS))]
    known = make(rng)
    path, people = some_way(known, 14.0, rng), np.empty((0, 4))
    if kind == "pallets":
        world = beside(known, path, rng, 12, 0.8, 1.4, 2.5)
    elif kind == "furniture":
        world = beside(known, path, rng, 40, 0.3, 0.9, 3.0)
    elif kind == "clutter":
        world = beside(known, path, rng, 250, 0.2, 0.8, 1.8)
    elif kind == "door":  # it drives up to a door that is closed by a pallet, stands there, and drives back
        world, middle = known.copy(), path[len(path) // 2]
        there = path[: len(path) // 2]
        c, s = math.cos(middle[2]), math.sin(middle[2])
        x, y = middle[0] + 1.2 * c, middle[1] + 1.2 * s
        wide, deep = (0.8, 1.8) if abs(c) > abs(s) else (1.8, 0.8)
        if is_clear(there, x - 0.5 * wide, y - 0.5 * deep, wide, deep, 0.3):
            box(world, x - 0.5 * wide, y - 0.5 * deep, wide, deep)
        back = there[::-1] + (0.0, 0.0, math.pi)
        path = np.vstack((there, np.repeat(there[-1:], 60, axis=0), back))
    else:  # a crowd
        world = known.copy()
        count = int(rng.integers(15, 45))
        near = path[rng.integers(len(path), size=count), :2] + rng.normal(0.0, 1.2, (count, 2))
        people = np.column_stack((near, rng.uniform(-0.8, 0.8, (count, 2))))
    return Scene(kind, known, world, path, path[0].copy(), some_laser(rng), people)


def is_free(known, x, y):
    column, row = int(x / CELL), int(y / CELL)
    return 0 <= row < known.shape[0] and 0 <= column < known.shape[1] and not known[row, column]


def lost(kind, rng):
    """A robot that is not where it believes."""
    which = rng.integers(len(MAPS))
    known = MAPS[which](rng)
    path = some_way(known, 14.0, rng)
    world = beside(known, path, rng, int(rng.choice([0, 8])), 0.3, 0.9, 3.0)
    scene = Scene(kind, known, world, path, path[0].copy(), some_laser(rng))
    if kind == "offset":
        while True:
            way_off, bearing = rng.uniform(0.3, 2.0), rng.uniform(-math.pi, math.pi)
            turn = math.radians(rng.uniform(10.0, 180.0)) * rng.choice([-1.0, 1.0])
            scene.belief = path[0] + (way_off * math.cos(bearing), way_off * math.sin(bearing), turn)
            if is_free(known, *scene.belief[:2]):
                break
    elif kind == "half a metre":
        bearing = rng.uniform(-math.pi, math.pi)
        turn = math.radians(15.0) * rng.choice([-1.0, 1.0])
        scene.belief = path[0] + (0.5 * math.cos(bearing), 0.5 * math.sin(bearing), turn)
    elif kind == "wrong map":
        scene.known = MAPS[(which + rng.integers(1, len(MAPS))) % len(MAPS)](rng)
        rows, columns = scene.known.shape
        scene.belief = np.zeros(3)
        while not is_free(scene.known, *scene.belief[:2]):
            scene.belief = rng.uniform((0.0, 0.0, -math.pi), (columns * CELL, rows * CELL, math.pi))
    else:  # carried off
        scene.taken_at = 0 if kind == "carried while standing" else len(path) // 3
        while True:
            scene.taken_to = some_way(world, 12.0, rng)
            if math.dist(scene.taken_to[0, :2], path[scene.taken_at, :2]) > 1.0:
                break
    return scene


UNMAPPED = ("pallets", "furniture", "clutter", "door", "crowd")
LOST = ("offset", "half a metre", "wrong map", "carried while standing", "carried while driving")


def scenes(make, kinds, count, seed):
    """`count` scenes, the kinds in turn, each with a stream of its own."""
    for k in range(count):
        yield make(kinds[k % len(kinds)], np.random.default_rng((seed, k)))


# --- the drive ------------------------------------------------------------------------------------------------------


@dataclass
class Drive:
    """What the localizer said: one row a tick.

    Attributes:
        states: State of each tick. errors: Error of the position, m. sigmas: Its standard deviation, m.
        moving: Whether the robot was driven in that tick.
    """

    states: list[str]
    errors: list[float]
    sigmas: list[float]
    moving: list[bool]

    def falsely_lost(self):
        """Whether it says lost, or ends because it is not tracking, while the position is less than 0.1 m off."""
        ends = zip(self.states, self.errors, strict=True)
        return any(state == "lost" and error < 0.1 for state, error in ends) or (
            self.states[-1] != "tracking" and self.errors[-1] < 0.1
        )

    def missed(self):
        """Longest time of motion in one go in which it says tracking while the position is more than 0.3 m off, s."""
        longest = now = 0.0
        for state, error, moves in zip(self.states, self.errors, self.moving, strict=True):
            if state == "tracking" and error > 0.3:
                now += PERIOD * moves
                longest = max(longest, now)
            else:
                now = 0.0
        return longest


def look(scene, true, time, bearings, rng):
    """(n,) ranges from a true pose, m; +inf for no echo."""
    _, range_max, sigma = scene.laser
    ranges = ranges_in(scene.world, CELL, true, bearings, range_max)
    ways = true[2] + bearings
    for x, y, vx, vy in scene.people:
        dx, dy = x + vx * math.sin(0.3 * time) / 0.3 - true[0], y + vy * math.sin(0.3 * time) / 0.3 - true[1]
        if math.hypot(dx, dy) > 0.6:
            along = dx * np.cos(ways) + dy * np.sin(ways)
            half = 0.25**2 - (dy * np.cos(ways) - dx * np.sin(ways)) ** 2
            hit = (half > 0.0) & (along > 0.0)
            ranges[hit] = np.minimum(ranges[hit], along[hit] - np.sqrt(half[hit]))
    noisy = ranges + sigma * rng.standard_normal(len(ranges))
    return np.where(noisy < range_max, np.maximum(noisy, 0.05), np.inf)


def localizer_of(scene):
    """The localizer with the map and the belief of a scene."""
    grid = OccupancyGrid(np.where(scene.known, 100, 0).astype(np.int8), CELL, Pose2D(0.0, 0.0, 0.0))
    start = Pose2D(float(scene.belief[0]), float(scene.belief[1]), math.remainder(float(scene.belief[2]), math.tau))
    return ScanMatching(ScanMatchingParams(), Context("main", PERIOD, ROBOT, np.random.default_rng, start, map=grid))


def run(scene, seed, observe=None):
    """Drive a scene. The robot stops while it is not tracking, as a goal does, and ends where that lasts.

    Args:
        scene: The scene. seed: Seed of slip and of the ranges' noise.
        observe: Called with the localizer after each tick.
    """
    rng, localizer = np.random.default_rng(seed), localizer_of(scene)
    bearings = fan(round(scene.laser[0]) + 1, scene.laser[0])
    halves, nowhere, none = np.zeros(len(bearings)), np.zeros((len(bearings), 2)), np.zeros(len(bearings))
    odometry, drive, at, path, stopped = np.zeros(3), Drive([], [], [], []), 0, scene.path, 0.0
    is_taken, tick, is_moving = False, 0, False
    while at < len(path) - 1 and stopped < LOST_AFTER:
        time = tick * PERIOD
        true = path[at]
        stamp = round(1e9 * time)
        scan = RangeScan(
            stamp, nowhere, bearings, halves, none, look(scene, true, time, bearings, rng), 0.05, scene.laser[1]
        )
        said = localizer.localize(
            LocalizerInput(Odometry(stamp, Pose2D(*odometry.tolist()), Twist2D(0.0, 0.0, 0.0)), (scan,), None)
        )
        error = math.hypot(said.pose.x - true[0], said.pose.y - true[1])
        if scene.kind == "wrong map":
            error = math.inf
        sigma = math.sqrt(float(np.linalg.eigvalsh(said.covariance[:2, :2]).max()))
        for row, value in zip(
            (drive.states, drive.errors, drive.sigmas, drive.moving), (said.state, error, sigma, is_moving), strict=True
        ):
            row.append(value)
        if observe:
            observe(localizer, true, drive)
        stopped = 0.0 if said.state == "tracking" else stopped + PERIOD
        if not is_taken and scene.taken_at is not None and time >= 1.0 and at >= scene.taken_at:
            path, at, is_taken, is_moving = scene.taken_to, 0, True, False
        else:
            is_moving = said.state == "tracking" and time >= STANDING
            if is_moving:
                odometry = compose(odometry, slipped(relative(true, path[at + 1]), rng))
                at += 1
        tick += 1
    return drive


def slipped(step, rng):
    """Odometry of a step, with a slip of 0.01 m/sqrt(m) of each wheel."""
    length, turn = math.hypot(step[0], step[1]), step[2]
    wheels = np.array([length + 0.2 * turn, length - 0.2 * turn])
    wheels += 0.01 * np.sqrt(np.abs(wheels)) * rng.standard_normal(2)
    ds, dw = 0.5 * wheels.sum(), 0.5 * (wheels[0] - wheels[1]) / 0.2
    return np.array([ds * math.cos(0.5 * dw), ds * math.sin(0.5 * dw), dw])

"""A small closed world for the campaigns: unicycle, ring of cone sonars, circles and boxes, exact contact.

Independent of the plugin and of the framework, so that neither can hide an error of the other.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
HALF = 0.4  # half side of the robot, m
PERIOD = 0.05
BEARINGS = np.radians([90.0, 50.0, 30.0, 10.0, -10.0, -30.0, -50.0, -90.0])
HALF_ANGLE = math.radians(15.0)
RANGE_MIN, RANGE_MAX = 0.3, 4.0
RAYS = 15


def rim_origins() -> Floats:
    """(8, 2), m: where the axis of each sonar leaves the square body."""
    direction = np.column_stack((np.cos(BEARINGS), np.sin(BEARINGS)))
    return direction * (HALF / np.abs(direction).max(axis=1))[:, None]


@dataclass
class World:
    """Circles (n, 3): x, y, radius; boxes (m, 5): x, y of the centre, half extents, yaw; m and rad."""

    circles: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    boxes: Floats = field(default_factory=lambda: np.zeros((0, 5)))


@njit(cache=True)
def cast(circles, boxes, ox, oy, dx, dy, max_incidence):
    """Distance of the first echo along a ray, else inf: a surface that is hit too obliquely gives no echo."""
    best, cosine = np.inf, 1.0
    for i in range(circles.shape[0]):
        cx, cy = circles[i, 0] - ox, circles[i, 1] - oy
        along = cx * dx + cy * dy
        square = circles[i, 2] ** 2 - (cx * cx + cy * cy - along * along)
        if square >= 0.0:
            t = along - math.sqrt(square)
            if 0.0 <= t < best:
                best, cosine = t, math.sqrt(square) / circles[i, 2]
    for i in range(boxes.shape[0]):
        c, s = math.cos(boxes[i, 4]), math.sin(boxes[i, 4])
        x, y = ox - boxes[i, 0], oy - boxes[i, 1]
        px, py = x * c + y * s, y * c - x * s
        ux, uy = dx * c + dy * s, dy * c - dx * s
        enter, leave, normal = -np.inf, np.inf, 1.0
        for p, u, h in ((px, ux, boxes[i, 2]), (py, uy, boxes[i, 3])):
            if u == 0.0:
                if abs(p) > h:
                    leave = -np.inf
                continue
            a, b = (-h - p) / u, (h - p) / u
            if min(a, b) > enter:
                enter, normal = min(a, b), abs(u)
            leave = min(leave, max(a, b))
        if 0.0 <= enter <= leave and enter < best:
            best, cosine = enter, normal
    return best if cosine >= math.cos(max_incidence) else np.inf


@njit(cache=True)
def ring(circles, boxes, pose, origins, bearings, half_angle, rays, max_incidence, out):
    """Nearest echo in the cone of each sonar, m."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for i in range(bearings.size):
        ox, oy = pose[0] + origins[i, 0] * c - origins[i, 1] * s, pose[1] + origins[i, 0] * s + origins[i, 1] * c
        out[i] = np.inf
        for k in range(rays):
            angle = pose[2] + bearings[i] + half_angle * (2.0 * k / (rays - 1) - 1.0)
            out[i] = min(out[i], cast(circles, boxes, ox, oy, math.cos(angle), math.sin(angle), max_incidence))


@njit(cache=True)
def clearance(circles, boxes, pose, half):
    """Exact gap between the square robot and the nearest obstacle, m; 0 or less is contact.

    Circle to square: distance of the centre to the square. Box to square: separating axes; a gap along one of the four
    axes means no contact (the value is then a lower bound of the distance).
    """
    gap = np.inf
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for i in range(circles.shape[0]):
        dx, dy = circles[i, 0] - pose[0], circles[i, 1] - pose[1]
        x, y = abs(dx * c + dy * s) - half, abs(dy * c - dx * s) - half
        distance = math.hypot(max(x, 0.0), max(y, 0.0)) + min(max(x, y), 0.0)
        gap = min(gap, distance - circles[i, 2])
    for i in range(boxes.shape[0]):
        dx, dy = boxes[i, 0] - pose[0], boxes[i, 1] - pose[1]
        turn = boxes[i, 4] - pose[2]
        ct, st = abs(math.cos(turn)), abs(math.sin(turn))
        hx, hy = boxes[i, 2], boxes[i, 3]
        bc, bs = math.cos(boxes[i, 4]), math.sin(boxes[i, 4])
        axes = max(abs(dx * c + dy * s) - half - hx * ct - hy * st, abs(dy * c - dx * s) - half - hx * st - hy * ct)
        other = max(abs(dx * bc + dy * bs) - hx - half * (ct + st), abs(dy * bc - dx * bs) - hy - half * (ct + st))
        gap = min(gap, max(axes, other))
    return gap


@dataclass
class Noise:
    """Noise of sonars: sigma = base + share * range, m; probability of a lost echo; largest incidence, rad."""

    base: float = 0.01
    share: float = 0.01
    dropout: float = 0.02
    max_incidence: float = math.pi / 2


@dataclass
class Episode:
    """Outcome of a run: reached, trapped, contact or timeout; smallest gap, m; time, s; track (n, 3)."""

    outcome: str
    least_gap: float
    time: float
    track: Floats
    why: str


Step = Callable[[Floats, tuple[float, float, float], float, tuple[float, float]], tuple[float, float, str, str]]


def drive(
    world: World,
    start: tuple[float, float, float],
    target: tuple[float, float],
    step: Step,
    rng: np.random.Generator,
    noise: Noise,
    limit: float = 180.0,
    tolerance: float = 0.3,
) -> Episode:
    """Run one episode; `step` takes ranges, pose, speed and target and gives speed, turn rate, status and why."""
    x, y, heading = start
    v = 0.0
    origins, ranges = rim_origins(), np.zeros(BEARINGS.size)
    least, track, why = math.inf, [start], ""
    for tick in range(int(limit / PERIOD)):
        ring(
            world.circles,
            world.boxes,
            (x, y, heading),
            origins,
            BEARINGS,
            HALF_ANGLE,
            RAYS,
            noise.max_incidence,
            ranges,
        )
        error, lost = rng.standard_normal(8), rng.random(8) < noise.dropout
        seen = ranges + (noise.base + noise.share * np.minimum(ranges, RANGE_MAX)) * error
        seen = np.where(lost | (ranges > RANGE_MAX), np.inf, np.maximum(seen, RANGE_MIN))
        goal, w, status, why = step(seen, (x, y, heading), v, target)
        if status == "trapped":
            return Episode("trapped", least, tick * PERIOD, np.array(track), why)
        v_next = min(goal, v + 0.5 * PERIOD) if goal >= v else max(goal, v - 1.0 * PERIOD)
        w = max(-math.radians(25.0), min(math.radians(25.0), w))
        middle = heading + 0.5 * w * PERIOD
        x += 0.5 * (v + v_next) * PERIOD * math.cos(middle)
        y += 0.5 * (v + v_next) * PERIOD * math.sin(middle)
        heading = (heading + w * PERIOD + math.pi) % (2.0 * math.pi) - math.pi
        v = min(v_next, 0.5)
        track.append((x, y, heading))
        least = min(least, clearance(world.circles, world.boxes, (x, y, heading), HALF))
        if least <= 0.0:
            return Episode("contact", least, tick * PERIOD, np.array(track), why)
        if math.dist((x, y), target) < tolerance:
            return Episode("reached", least, tick * PERIOD, np.array(track), why)
    return Episode("timeout", least, limit, np.array(track), why)


def post_field(rng: np.random.Generator, posts: int = 20, gap: float = 1.6, side: float = 12.0) -> World:
    """Posts of 0.2 m diameter in a square field, x 0..side and y -side/2..side/2, surfaces at least `gap` apart."""
    centres: list[tuple[float, float]] = []
    while len(centres) < posts:
        p = (rng.uniform(0.1, side - 0.1), rng.uniform(0.1 - side / 2, side / 2 - 0.1))
        if all(math.dist(p, q) >= gap + 0.2 for q in centres):
            centres.append(p)
    return World(circles=np.column_stack((np.array(centres), np.full(posts, 0.1))))


def doorway(width: float) -> World:
    """A wall along y at x = 0..0.2, 24 m long, with a door of the given width in its middle."""
    half = 0.5 * (12.0 - 0.5 * width)
    side = [0.1, 0.5 * width + half, 0.1, half, 0.0]
    return World(boxes=np.array([side, [0.1, -side[1], 0.1, half, 0.0]]))


def u_trap(width: float, depth: float) -> World:
    """A U open towards -x, its bottom at x = 0, walls 0.2 m thick."""
    return World(
        boxes=np.array(
            [
                [0.1, 0.0, 0.1, 0.5 * width + 0.2, 0.0],
                [-0.5 * depth, 0.5 * width + 0.1, 0.5 * depth, 0.1, 0.0],
                [-0.5 * depth, -0.5 * width - 0.1, 0.5 * depth, 0.1, 0.0],
            ]
        )
    )

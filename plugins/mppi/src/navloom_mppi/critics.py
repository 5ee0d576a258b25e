"""The critics: what a roll-out costs, one function each, by the names of Nav2's MPPI controller.

Each returns a cost without its weight. Those that look at every pose are averaged over the roll-out, so that a weight
does not depend on the number of steps.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from navloom_dwa.field import CHAMFER, UNIT, field_value
from navloom_dwa.moving import NO_BODIES_AHEAD
from numba import njit
from numpy.typing import NDArray

from navloom_mppi.nearest import Numbers

Floats = NDArray[np.float64]
Counts = NDArray[np.int32]
Cells = NDArray[np.int64]
CRITICS = (
    "constraint", "collision", "obstacle", "goal", "goal_angle", "path_align", "path_follow", "path_angle",
    "prefer_forward", "twirling", "control",
)  # fmt: skip
"""Columns of the costs of roll-outs."""
TIGHT = 10.0
"""Weight of a gap to a body below the clearance that is wanted, per that of nearness."""
EVERY = 4
"""Steps between two poses that the critics of path and goal look at, as in Nav2."""
(CONSTRAINT, COLLISION, OBSTACLE, GOAL, GOAL_ANGLE, PATH_ALIGN, PATH_FOLLOW, PATH_ANGLE, PREFER_FORWARD, TWIRLING,
 CONTROL) = range(len(CRITICS))  # fmt: skip


class Scene(NamedTuple):
    """Surroundings of the robot in one tick, base frame.

    Attributes:
        obstacles: (n, 3) x, y and the margin to keep, m. nearest: From nearest.fill_nearest().
        cells_per_metre: Of `nearest`, 1/m.
        nose: Distance of the nose from the base, m.
        body: (k, 2) from nearest.body_points(), m. edges: Half planes of the footprint.
        soft: Distance beyond the margin over which nearness falls to 0, m.
        cost_to_go, path_distance: Fields of navloom_dwa.field. origin, cell: Of these fields.
        goal: End of the trajectory, m. is_near_goal: Whether the goal critic replaces those of the path.
        ahead: Point of the trajectory ahead, m. turns_away: Whether the robot must first turn to it.
        is_path_free: Whether the path is free enough to align to it.
        turn_to: Heading at the goal, rad; NaN for none.
        bodies: (steps, n, 5) from moving.bodies_ahead(). body_weight: Of their nearness, per that of obstacles.
        clear: Gap to a body below which nearness counts most, m.
    """

    obstacles: Floats
    nearest: Numbers
    cells_per_metre: float
    nose: float
    body: Floats
    edges: Floats
    soft: float
    cost_to_go: Counts
    path_distance: Counts
    origin: Cells
    cell: float
    goal: tuple[float, float]
    is_near_goal: bool
    ahead: tuple[float, float]
    turns_away: bool
    is_path_free: bool
    turn_to: float
    bodies: Floats = NO_BODIES_AHEAD
    body_weight: float = 1.0
    clear: float = 0.3


@njit(cache=True, nogil=True)
def deviation(angle: float, other: float) -> float:
    """Magnitude of the difference of two angles, rad, in [0, pi]."""
    return abs((angle - other + math.pi) % (2.0 * math.pi) - math.pi)


@njit(cache=True, nogil=True)
def constraint(v: float, w: float, slowest: float, fastest: float, turn: float) -> float:
    """What is asked for beyond the limits: m/s of the speed plus rad/s of the turn rate."""
    return max(0.0, v - fastest, slowest - v) + max(0.0, abs(w) - turn)


@njit(cache=True, nogil=True)
def obstacles(scene: Scene, track: Floats) -> tuple[int, float]:
    """Obstacle and collision: nearness of obstacles, averaged, and the first step in which a margin is touched.

    Nearness is 1 at the margin and 0 from `soft` beyond it on. For each point of the body, the obstacle that is nearest
    to its cell counts, by its distance beyond the sides of the footprint. Tracked bodies count where they will be in
    each step.

    Args:
        scene: Surroundings. track: (steps, 5) x, y, m, heading, rad, its cosine and sine.

    Returns:
        First step with a collision, `steps` for none; nearness.
    """
    # Arrays in local names, and no calls that take them: each would count references in every step.
    nearest, points, body, edges = scene.nearest, scene.obstacles, scene.body, scene.edges
    bodies = scene.bodies
    steps, size, per_metre, soft = track.shape[0], nearest.shape[0], scene.cells_per_metre, scene.soft
    total = 0.0
    for t in range(steps):
        x, y, c, s = track[t, 0], track[t, 1], track[t, 3], track[t, 4]
        least = soft
        for i in range(body.shape[0]):
            bx, by = body[i, 0], body[i, 1]
            column, row = (x + c * bx - s * by) * per_metre + 0.5 * size, (y + s * bx + c * by) * per_metre + 0.5 * size
            if not (0.0 <= column < size and 0.0 <= row < size):
                continue
            k = nearest[int(row), int(column)]
            if k < 0:
                continue
            dx, dy = points[k, 0] - x, points[k, 1] - y
            ahead, left, beyond = c * dx + s * dy, c * dy - s * dx, -np.inf
            for e in range(edges.shape[0]):
                beyond = max(beyond, edges[e, 0] * ahead + edges[e, 1] * left - edges[e, 2])
            least = min(least, beyond - points[k, 2])
        if least < 0.0:
            return t, total / steps
        total += 1.0 - least / soft
        near = 0.0
        for b in range(bodies.shape[1]):
            dx, dy = bodies[t, b, 0] - x, bodies[t, b, 1] - y
            if dx * dx + dy * dy >= bodies[t, b, 4]:
                continue
            ahead, left, beyond = c * dx + s * dy, c * dy - s * dx, -np.inf
            for e in range(edges.shape[0]):
                beyond = max(beyond, edges[e, 0] * ahead + edges[e, 1] * left - edges[e, 2])
            gap = beyond - bodies[t, b, 2]
            if gap < 0.0:
                return t, total / steps
            far, tight = 1.0 - gap / bodies[t, b, 3], max(0.0, 1.0 - gap / scene.clear)
            near = max(near, far * far + TIGHT * tight * tight)
        total += scene.body_weight * near
    return steps, total / steps


@njit(cache=True, nogil=True)
def collision(step: int, steps: int) -> float:
    """Cost of the first collision: 0 for none, else more than 1, and the more the earlier it comes."""
    return 2.0 - step / steps if step < steps else 0.0


@njit(cache=True, nogil=True)
def goal(scene: Scene, track: Floats, until: int) -> float:
    """Mean distance of the poses before a step from the end of the trajectory, m."""
    total = 0.0
    for t in range(EVERY - 1, until, EVERY):
        total += math.hypot(track[t, 0] - scene.goal[0], track[t, 1] - scene.goal[1])
    return float(total * EVERY / track.shape[0])


@njit(cache=True, nogil=True)
def goal_angle(scene: Scene, track: Floats, until: int) -> float:
    """Mean deviation of the poses before a step from the heading wanted at the goal, rad."""
    total = 0.0
    for t in range(EVERY - 1, until, EVERY):
        total += deviation(track[t, 2], scene.turn_to)
    return float(total * EVERY / track.shape[0])


@njit(cache=True, nogil=True)
def path_align(scene: Scene, track: Floats, until: int) -> float:
    """Mean distance of the poses before a step from the path, m: chamfer distance to its cells."""
    field, origin, cell = scene.path_distance, scene.origin, scene.cell
    total = 0.0
    for t in range(EVERY - 1, until, EVERY):
        total += field_value(field, origin, cell, track[t, 0], track[t, 1])
    return float(total * cell / CHAMFER * EVERY / track.shape[0])


@njit(cache=True, nogil=True)
def path_follow(scene: Scene, x: float, y: float, c: float, s: float) -> float:
    """Cost, m, of the way left to the farthest point of the path in the field, around obstacles: mean of base and nose.

    Nav2 takes the straight distance of the base. Only the nose tells a robot before an obstacle to which side to turn.

    Args:
        scene: Surroundings. x, y: Last position, m. c, s: Cosine and sine of the last heading.
    """
    base = field_value(scene.cost_to_go, scene.origin, scene.cell, x, y)
    nose = field_value(scene.cost_to_go, scene.origin, scene.cell, x + c * scene.nose, y + s * scene.nose)
    return float(0.5 * (base + nose) * scene.cell / UNIT)


@njit(cache=True, nogil=True)
def path_angle(scene: Scene, track: Floats, until: int) -> float:
    """Mean angle between the heading of the poses before a step and the direction to the path ahead, rad."""
    total = 0.0
    for t in range(EVERY - 1, until, EVERY):
        bearing = math.atan2(scene.ahead[1] - track[t, 1], scene.ahead[0] - track[t, 0])
        total += deviation(bearing, track[t, 2])
    return float(total * EVERY / track.shape[0])


@njit(cache=True, nogil=True)
def prefer_forward(v: float) -> float:
    """Speed backwards, m/s."""
    return max(0.0, -v)


@njit(cache=True, nogil=True)
def twirling(w: float) -> float:
    """Turn rate, rad/s."""
    return abs(w)

"""The critics: what a roll-out costs, one function each, by the names of Nav2's MPPI controller.

Each returns a cost without its weight. Those that look at every pose are averaged over the roll-out, so that a weight does
not depend on the number of steps.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from navloom_avoidance.clearance import outside_distance
from navloom_dwa.field import UNIT, field_value
from numba import njit
from numpy.typing import NDArray

from navloom_mppi.nearest import Numbers

Floats = NDArray[np.float64]
Counts = NDArray[np.int32]
CRITICS = (
    "constraint", "collision", "obstacle", "goal", "goal_angle", "path_align", "path_follow", "path_angle",
    "prefer_forward", "twirling", "control",
)  # fmt: skip
"""Columns of the costs of roll-outs."""
(CONSTRAINT, COLLISION, OBSTACLE, GOAL, GOAL_ANGLE, PATH_ALIGN, PATH_FOLLOW, PATH_ANGLE, PREFER_FORWARD, TWIRLING,
 CONTROL) = range(len(CRITICS))  # fmt: skip


class Scene(NamedTuple):
    """Surroundings of the robot in one tick, base frame.

    Attributes:
        obstacles: (n, 3) x, y and the margin to keep, m. nearest, near_cell: From nearest.fill_nearest().
        body: (k, 2) from nearest.body_points(), m. edges: Half planes of the footprint.
        soft: Distance beyond the margin over which nearness falls to 0, m.
        cost_to_go, path_distance: Fields of navloom_dwa.field. origin, cell: Of these fields.
        goal: End of the trajectory, m. is_near_goal: Whether the goal critic replaces those of the path.
        ahead: Point of the trajectory ahead, m. turns_away: Whether the robot must first turn to it.
        is_path_free: Whether the path is free enough to align to it.
        turn_to: Heading at the goal, rad; NaN for none.
    """

    obstacles: Floats
    nearest: Numbers
    near_cell: float
    body: Floats
    edges: Floats
    soft: float
    cost_to_go: Counts
    path_distance: Counts
    origin: NDArray[np.int64]
    cell: float
    goal: tuple[float, float]
    is_near_goal: bool
    ahead: tuple[float, float]
    turns_away: bool
    is_path_free: bool
    turn_to: float


@njit(cache=True, nogil=True)
def wrapped(angle: float) -> float:
    """Magnitude of an angle, rad, in [0, pi]."""
    return abs((angle + math.pi) % (2.0 * math.pi) - math.pi)


@njit(cache=True, nogil=True)
def constraint(v: float, w: float, slowest: float, fastest: float, turn: float) -> float:
    """What is asked for beyond the limits, as shares of the highest speed and turn rate."""
    return max(0.0, v - fastest, slowest - v) / fastest + max(0.0, abs(w) - turn) / turn


@njit(cache=True, nogil=True)
def clearance(scene: Scene, x: float, y: float, c: float, s: float) -> float:
    """Least distance, m, beyond its margin, of the obstacles nearest to the body's points; inf beyond `soft`.

    Args:
        scene: The surroundings. x, y: Position, m. c, s: Cosine and sine of the heading.
    """
    size = scene.nearest.shape[0]
    least = np.inf
    for i in range(scene.body.shape[0]):
        bx, by = scene.body[i, 0], scene.body[i, 1]
        u, t = (x + c * bx - s * by) / scene.near_cell + 0.5 * size, (y + s * bx + c * by) / scene.near_cell + 0.5 * size
        if not (0.0 <= u < size and 0.0 <= t < size):
            continue
        k = scene.nearest[int(t), int(u)]
        if k >= 0:
            dx, dy = scene.obstacles[k, 0] - x, scene.obstacles[k, 1] - y
            beyond = outside_distance(scene.edges, c * dx + s * dy, c * dy - s * dx) - scene.obstacles[k, 2]
            least = min(least, beyond)
    return least


@njit(cache=True, nogil=True)
def obstacle(beyond: float, soft: float) -> float:
    """Nearness of a pose to obstacles: 1 at the margin, 0 from `soft`, m, beyond it on."""
    return min(1.0, max(0.0, 1.0 - beyond / soft))


@njit(cache=True, nogil=True)
def collision(step: int, steps: int) -> float:
    """Cost of a collision in a step: more than 1, and the more the earlier it comes."""
    return 2.0 - step / steps


@njit(cache=True, nogil=True)
def goal(scene: Scene, x: float, y: float) -> float:
    """Distance of a pose from the end of the trajectory, m."""
    return math.hypot(x - scene.goal[0], y - scene.goal[1])


@njit(cache=True, nogil=True)
def goal_angle(scene: Scene, heading: float) -> float:
    """Deviation of a pose from the heading wanted at the goal, rad."""
    return wrapped(heading - scene.turn_to)


@njit(cache=True, nogil=True)
def path_align(scene: Scene, x: float, y: float) -> float:
    """Distance of a pose from the path, m: chamfer distance to its cells, 3 units each."""
    return field_value(scene.path_distance, scene.origin, scene.cell, x, y) * scene.cell / 3.0


@njit(cache=True, nogil=True)
def path_follow(scene: Scene, x: float, y: float) -> float:
    """Cost, m, of the way left from the last pose to the farthest point of the path in the field, around obstacles.

    Nav2 takes the straight distance to that point.
    """
    return field_value(scene.cost_to_go, scene.origin, scene.cell, x, y) * scene.cell / UNIT


@njit(cache=True, nogil=True)
def path_angle(scene: Scene, x: float, y: float, heading: float) -> float:
    """Angle between a heading and the direction to the point of the path ahead, rad."""
    return wrapped(math.atan2(scene.ahead[1] - y, scene.ahead[0] - x) - heading)


@njit(cache=True, nogil=True)
def prefer_forward(v: float, fastest: float) -> float:
    """Speed backwards, as a share of the highest speed."""
    return max(0.0, -v) / fastest


@njit(cache=True, nogil=True)
def twirling(w: float, turn: float) -> float:
    """Turn rate as a share of the highest."""
    return abs(w) / turn

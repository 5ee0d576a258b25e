"""What the robot can do, what it costs, and curves among obstacles. Lengths are in cells; a move is a row of curvature,
signed length and angle of a turn in place, see `clearance.advanced`."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from navloom_hybrid_astar.clearance import Body, Ground, advanced, is_free_along
from navloom_hybrid_astar.compiled import compiled
from navloom_hybrid_astar.curves import Costs, cheapest_curve

__all__ = ["Motion", "cost_of", "curve_between", "direction_at", "is_curve_free", "poses_after"]

Floats = NDArray[np.float64]


class Motion(NamedTuple):
    """Abilities of the robot and costs of its motion.

    Attributes:
        radius: Least radius of an arc, cells.
        reverse: Extra cost of each cell backwards, no unit.
        switch: Cost of each change of direction, cells.
        steer: Cost of a change from straight to the sharpest arc, cells.
        turn: Cost of each rad turned in place, cells; infinite for a robot that cannot.
        backwards: Whether it may drive backwards.
    """

    radius: float
    reverse: float
    switch: float
    steer: float
    turn: float
    backwards: bool

    def in_radii(self) -> Costs:
        """The costs of a curve."""
        return self.reverse, self.switch / self.radius, self.turn / self.radius, self.backwards


@compiled
def curve_between(first: Floats, last: Floats, radius: float, costs: Costs, moves: Floats) -> float:
    """The cheapest curve between two poses (3,), cells and rad; fills `moves` (MOVES, 3). Returns its cost, cells."""
    dx, dy = (last[0] - first[0]) / radius, (last[1] - first[1]) / radius
    cosine, sine = math.cos(first[2]), math.sin(first[2])
    cost = cheapest_curve(cosine * dx + sine * dy, cosine * dy - sine * dx, last[2] - first[2], costs, moves)
    for n in range(moves.shape[0]):
        moves[n, 0] /= radius
        moves[n, 1] *= radius
    return cost * radius


@compiled
def is_curve_free(first: Floats, moves: Floats, ground: Ground, body: Body) -> bool:
    """Whether the moves (n, 3) from a free pose (3,) keep clear."""
    x, y, heading = first[0], first[1], first[2]
    for n in range(moves.shape[0]):
        curvature, length, angle = moves[n, 0], moves[n, 1], moves[n, 2]
        if length != 0.0 or angle != 0.0:
            if not is_free_along(x, y, heading, curvature, length, angle, ground, body):
                return False
            x, y, heading = advanced(x, y, heading, curvature, length, angle)
    return True


@compiled
def direction_at(moves: Floats, is_last: bool) -> float:
    """1.0 where the first or last of the moves that has a length leads forwards, -1.0 backwards, 0.0 for none."""
    for k in range(moves.shape[0]):
        length = moves[moves.shape[0] - 1 - k if is_last else k, 1]
        if length != 0.0:
            return 1.0 if length > 0.0 else -1.0
    return 0.0


@compiled
def cost_of(moves: Floats, reverse: float, switch: float, turn: float) -> float:
    """Cost of moves (n, 3), cells."""
    cost, before = 0.0, 0.0
    for n in range(moves.shape[0]):
        length = moves[n, 1]
        if length != 0.0:
            cost += length if length > 0.0 else -length * (1.0 + reverse)
            cost += switch if before * length < 0.0 else 0.0
            before = length
        if moves[n, 2] != 0.0:
            cost += abs(moves[n, 2]) * turn
    return cost


@compiled
def poses_after(first: Floats, moves: Floats) -> Floats:
    """(n + 1, 3) the first pose and those after each move (n, 3)."""
    poses = np.empty((moves.shape[0] + 1, 3))
    x, y, heading = first[0], first[1], first[2]
    poses[0, 0], poses[0, 1], poses[0, 2] = x, y, heading
    for n in range(moves.shape[0]):
        x, y, heading = advanced(x, y, heading, moves[n, 0], moves[n, 1], moves[n, 2])
        poses[n + 1, 0], poses[n + 1, 1], poses[n + 1, 2] = x, y, heading
    return poses

"""Hybrid A*: search over poses, one for each cell of a lattice, with motions that the robot can drive.

Source: Dolgov, Thrun, Montemerlo & Diebel 2010, *Path planning for autonomous vehicles in unknown semi-structured
environments*, IJRR 29(5): continuous poses in lattice cells, the two heuristics, analytic expansion. Unlike there, the
search continues after the first curve that reaches the goal, until no open pose promises a cheaper path or the bound
of expansions is used up.
"""

from __future__ import annotations

import heapq
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from navloom_hybrid_astar.clearance import Body, Ground, advanced, is_free_along
from navloom_hybrid_astar.compiled import compiled
from navloom_hybrid_astar.curves import MOVES, Costs
from navloom_hybrid_astar.motion import Motion, curve_between, direction_at, is_curve_free

__all__ = ["Lattice", "search", "steps_of"]

Floats = NDArray[np.float64]

_GENERATED = 6
"""Poses that are kept for each expansion, more than the search needs on average."""


class Lattice(NamedTuple):
    """Cells of poses.

    Attributes:
        edge: Edge of a cell in x and y, cells of the map.
        headings: Number of headings.
        step: Length of a motion, cells of the map.
        most: Most expansions.
        further: After the first path, the search goes on for at most this times the expansions so far.
    """

    edge: float
    headings: int
    step: float
    most: int
    further: float


def steps_of(motion: Motion, lattice: Lattice) -> Floats:
    """(n, 3) the moves of an expansion: five curvatures, forwards and backwards, and turns in place."""
    ways = (1.0, -1.0) if motion.backwards else (1.0,)
    arcs = [(bend / motion.radius, way * lattice.step, 0.0) for way in ways for bend in (0.0, 0.5, -0.5, 1.0, -1.0)]
    angle = 2.0 * 2.0 * math.pi / lattice.headings
    return np.array([*arcs, *((0.0, 0.0, a) for a in (angle, -angle) if math.isfinite(motion.turn))])


def search(
    start: Floats,
    goals: Floats,
    ahead: NDArray[np.float32],
    ground: Ground,
    body: Body,
    motion: Motion,
    lattice: Lattice,
) -> tuple[Floats | None, int, tuple[float, float]]:
    """The cheapest path that the search finds between free poses, cells and rad.

    Args:
        start: Pose (3,).
        goals: (m, 3) poses in one place; any of them will do.
        ahead: (rows, columns) lower bound of the way from a cell to the goal, cells, see `flood.distances_to`.
        ground, body: See `clearance`.
        motion, lattice: See there.

    Returns:
        (n, 3) moves or None, the number of expansions, and the place of the expanded pose that was nearest to the goal.
    """
    steps = steps_of(motion, lattice)
    count, moves, expanded, x, y = _search(start, goals, ahead, ground, body, motion, motion.in_radii(), lattice, steps)
    return (moves if count > 0 else None), expanded, (x, y)


@compiled
def _ahead_of(
    pose: Floats, goals: Floats, ahead: NDArray[np.float32], motion: Motion, costs: Costs, moves: Floats
) -> float:
    """The larger of the two heuristics, cells; only the holonomic one if there are several goals."""
    holonomic = float(ahead[int(pose[1]), int(pose[0])])
    if goals.shape[0] > 1:
        return holonomic
    return max(holonomic, curve_between(pose, goals[0], motion.radius, costs, moves))


@compiled
def _place_of(keys: NDArray[np.int64], key: int) -> int:
    """Place of a key in an open-addressed table, or of the empty place where it belongs."""
    mask = keys.shape[0] - 1
    place = ((key * 0x9E3779B1) >> 7) & mask
    while keys[place] >= 0 and keys[place] != key:
        place = (place + 1) & mask
    return int(place)


@compiled
def _search(
    start: Floats, goals: Floats, ahead: NDArray[np.float32], ground: Ground, body: Body, motion: Motion, costs: Costs,
    lattice: Lattice, steps: Floats,
) -> tuple[int, Floats, int, float, float]:  # fmt: skip
    most = _GENERATED * lattice.most + 16
    size = 1
    while size < 2 * most:
        size *= 2
    keys, owner = np.full(size, -1, np.int64), np.empty(size, np.int32)
    poses, sofar, promised = np.empty((most, 3)), np.empty(most), np.empty(most)
    parent, arrival = np.empty(most, np.int32), np.empty(most, np.int16)
    is_closed = np.zeros(most, np.bool_)
    curve, pose = np.zeros((MOVES, 3)), np.empty(3)
    best_curve, best, best_node = np.zeros((MOVES, 3)), np.inf, -1
    across = int(ahead.shape[1] / lattice.edge) + 2
    poses[0, 0], poses[0, 1], poses[0, 2] = start[0], start[1], start[2]
    sofar[0], promised[0] = 0.0, _ahead_of(start, goals, ahead, motion, costs, curve)
    parent[0], arrival[0] = -1, -1
    heap, count, expanded, limit = [(promised[0], 0)], 1, 0, lattice.most
    until_shot, nearest, near = 0, np.inf, 0
    while len(heap) > 0 and expanded < limit and count + steps.shape[0] < most:
        promise, node = heapq.heappop(heap)
        if promise >= best:
            break
        if is_closed[node] or promise > promised[node]:
            continue
        is_closed[node] = True
        expanded += 1
        here = poses[node]
        left = promised[node] - sofar[node]
        if left < nearest:
            nearest, near = left, node
        before = arrival[node]
        way = 0.0 if before < 0 else steps[before, 1]
        until_shot -= 1
        if until_shot <= 0:
            until_shot = int(left / (4.0 * lattice.step))
            for goal in range(goals.shape[0]):
                cost = sofar[node] + curve_between(here, goals[goal], motion.radius, costs, curve)
                if way * direction_at(curve, False) < 0.0:
                    cost += motion.switch
                if cost < best and is_curve_free(here, curve, ground, body):
                    if best_node < 0:
                        limit = min(limit, int(expanded * (1.0 + lattice.further)) + 200)
                    best, best_node = cost, node
                    for n in range(MOVES):
                        for k in range(3):
                            best_curve[n, k] = curve[n, k]
        for n in range(steps.shape[0]):
            bend, length, angle = steps[n, 0], steps[n, 1], steps[n, 2]
            cost = sofar[node]
            if length != 0.0:
                cost += length if length > 0.0 else -length * (1.0 + motion.reverse)
                if way * length < 0.0:
                    cost += motion.switch
                if before >= 0 and way != 0.0:
                    cost += motion.steer * motion.radius * abs(bend - steps[before, 0])
            else:
                if before >= 0 and steps[before, 2] * angle < 0.0:
                    continue
                cost += motion.turn * abs(angle)
            x, y, heading = advanced(here[0], here[1], here[2], bend, length, angle)
            if not (0.0 <= x < ahead.shape[1] and 0.0 <= y < ahead.shape[0]):
                continue
            holonomic = float(ahead[int(y), int(x)])
            if cost + holonomic >= best:
                continue
            turn = math.floor(heading / (2.0 * math.pi) * lattice.headings + 0.5) % lattice.headings
            key = (int(y / lattice.edge) * across + int(x / lattice.edge)) * lattice.headings + turn
            place = _place_of(keys, key)
            old = owner[place] if keys[place] >= 0 else -1
            if old >= 0 and (is_closed[old] or cost >= sofar[old] + 2.0 * lattice.edge):
                continue
            if not is_free_along(here[0], here[1], here[2], bend, length, angle, ground, body):
                continue
            pose[0], pose[1], pose[2] = x, y, heading
            promise = cost + _ahead_of(pose, goals, ahead, motion, costs, curve)
            if promise >= best or (old >= 0 and promise >= promised[old]):
                continue
            if old >= 0:
                is_closed[old] = True
            keys[place], owner[place] = key, count
            poses[count, 0], poses[count, 1], poses[count, 2] = x, y, heading
            sofar[count], promised[count], parent[count], arrival[count] = cost, promise, node, n
            heapq.heappush(heap, (promise, count))
            count += 1
    if best_node < 0:
        return 0, best_curve, expanded, poses[near, 0], poses[near, 1]
    depth, node = 0, best_node
    while parent[node] >= 0:
        depth, node = depth + 1, parent[node]
    moves, node = np.empty((depth + MOVES, 3)), best_node
    for n in range(depth - 1, -1, -1):
        for k in range(3):
            moves[n, k] = steps[arrival[node], k]
        node = parent[node]
    for n in range(MOVES):
        for k in range(3):
            moves[depth + n, k] = best_curve[n, k]
    return depth + MOVES, moves, expanded, goals[0, 0], goals[0, 1]

"""Look-ahead verification: A* over the candidates at projected places (Ulrich & Borenstein 2000, VFH*)."""

import math

import numpy as np
from navloom_avoidance.histogram import free_slots, slot_directions
from numba import njit
from numpy.typing import NDArray

from navloom_vfh.costs import Weights, primary_cost, projected_cost, remaining_cost
from navloom_vfh.histogram import binary_histogram, polar_histogram
from navloom_vfh.turning import masked_histogram, turning_limits

Floats = NDArray[np.float64]
Place = tuple[float, float, float]
# Columns of a node of the search tree
X, Y, THETA, DIRECTION, COST, TOTAL, DEPTH, ROOT, IS_OPEN, IS_GOAL = range(10)


@njit(cache=True, nogil=True)
def projected_place(place: Place, direction: float, step: float, circle: float) -> Place:
    """Pose of the robot after a step towards a direction: along its turning circle, then straight.

    Args:
        place: x, y, m, and heading, rad. direction: rad, same frame. step: d_s, m. circle: Turning radius, m.

    Returns:
        x, y, m, and heading, rad. The heading does not reach the direction if the step ends on the circle.
    """
    x, y, theta = place
    turn = (direction - theta + math.pi) % (2.0 * math.pi) - math.pi
    arc = circle * abs(turn)
    if arc > step:
        # The step ends before the turn does.
        turn *= step / arc
    if circle > 0.0:
        side = circle if turn > 0.0 else -circle
        x += side * (math.sin(theta + turn) - math.sin(theta))
        y += side * (math.cos(theta) - math.cos(theta + turn))
    theta += turn
    straight = max(0.0, step - arc)
    return x + straight * math.cos(theta), y + straight * math.sin(theta), theta


@njit(cache=True, nogil=True)
def candidates(
    cells: Floats,
    place: Place,
    target: tuple[float, float],
    circle: float,
    radius: float,
    reach: float,
    slack: float,
    threshold: float,
    certainty: float,
    widest: int,
    density: Floats,
    blocked: Floats,
    slots: NDArray[np.int64],
    directions: Floats,
) -> int:
    """Compute the candidate directions at a projected place: the stages of VFH+ without an earlier histogram.

    Args:
        cells: (n, 3), x, y, m, base frame, and certainty. place: x, y, m, heading, rad, base frame.
        target: m, base frame. circle, radius, certainty: As for turning_limits(). reach: m.
        slack: Cells farther from the place than the target distance plus this do not count, m.
        threshold: tau_high: without an earlier histogram, a sector is free up to it. widest: s_max, sectors.
        density, blocked: (sectors,), slots: (sectors // 2 + 1, 2); work arrays.
        directions: (3 * (sectors // 2 + 1),), filled in, rad, base frame.

    Returns:
        Number of directions.
    """
    dx, dy = target[0] - place[0], target[1] - place[1]
    horizon = math.hypot(dx, dy) + slack
    polar_histogram(cells, (place[0], place[1]), 0.0, radius, reach, horizon, True, density)
    blocked[:] = 0.0
    binary_histogram(density, threshold, threshold, blocked)
    right, left = turning_limits(cells, place, circle, radius, certainty)
    masked_histogram(blocked, place[2], right, left, density)
    count = free_slots(density, 0.5, slots)
    return slot_directions(slots, count, density.size, widest, 0.5 * widest, math.atan2(dy, dx), directions)


@njit(cache=True, nogil=True)
def next_node(nodes: Floats, count: int) -> int:
    """Index of the open node with the least total cost f = g + h, the first of equals; -1 where none is open."""
    best, least = -1, np.inf
    for i in range(count):
        if nodes[i, IS_OPEN] > 0.0 and nodes[i, TOTAL] < least:
            best, least = i, nodes[i, TOTAL]
    return best


@njit(cache=True, nogil=True)
def deepest(nodes: Floats, count: int) -> int:
    """Index of the deepest node, of equals the one with the least cost g: the best path when no node is open."""
    best = 0
    for i in range(1, count):
        further = nodes[i, DEPTH] - nodes[best, DEPTH]
        if further > 0.0 or (further == 0.0 and nodes[i, COST] < nodes[best, COST]):
            best = i
    return best


@njit(cache=True, nogil=True)
def add_node(
    nodes: Floats,
    index: int,
    parent: int,
    place: Place,
    direction: float,
    target: tuple[float, float],
    previous: float,
    first: Weights,
    later: Weights,
    discount: float,
    goal_depth: int,
    step: float,
    circle: float,
) -> None:
    """Fill one row of the tree: a candidate direction taken from a place, its cost, and where it leads.

    Args:
        nodes: (limit, 10). index: Row to fill. parent: Row of the parent, -1 for the primary candidates.
        place: Place of the parent. target: m. previous: Direction taken before it, rad. All in the base frame.
        first, later: Weights of the primary and of the projected candidates.
        discount, goal_depth, step, circle: As for look_ahead().
    """
    after = projected_place(place, direction, step, circle)
    bearing = math.atan2(target[1] - place[1], target[0] - place[0])
    depth = 0 if parent < 0 else int(nodes[parent, DEPTH]) + 1
    if parent < 0:
        cost = primary_cost(direction, bearing, place[2], previous, first)
    else:
        effective = math.atan2(after[1] - place[1], after[0] - place[0])
        cost = nodes[parent, COST] + projected_cost(
            direction, effective, bearing, place[2], previous, later, discount, depth
        )
    dx, dy = target[0] - after[0], target[1] - after[1]
    is_goal = depth == goal_depth - 1 or math.hypot(target[0] - place[0], target[1] - place[1]) <= step
    rest = 0.0
    if not is_goal:
        rest = remaining_cost(math.atan2(dy, dx), after[2], direction, later, discount, depth + 1)
    nodes[index, X], nodes[index, Y], nodes[index, THETA] = after
    nodes[index, DIRECTION], nodes[index, DEPTH] = direction, depth
    nodes[index, COST], nodes[index, TOTAL] = cost, cost + rest
    nodes[index, ROOT] = index if parent < 0 else nodes[parent, ROOT]
    nodes[index, IS_OPEN], nodes[index, IS_GOAL] = 1.0, 1.0 if is_goal else 0.0


@njit(cache=True, nogil=True)
def look_ahead(
    cells: Floats,
    roots: Floats,
    target: tuple[float, float],
    previous: float,
    first: Weights,
    later: Weights,
    discount: float,
    goal_depth: int,
    step: float,
    circle: float,
    radius: float,
    reach: float,
    slack: float,
    threshold: float,
    certainty: float,
    sectors: int,
    widest: int,
    nodes: Floats,
) -> tuple[int, int, int]:
    """Find the primary candidate on the cheapest path of goal_depth steps, by A*.

    If every path ends before that depth, the result is the deepest path; if `nodes` is full, the path to the cheapest
    open node.

    Args:
        cells: (n, 3), x, y, m, base frame, and certainty.
        roots: (k,), primary candidates, rad; candidates beyond the rows of `nodes` are ignored.
        target: m. previous: Direction chosen last, rad.
        first, later: mu_1.. and mu_1'.., see costs.py. discount: lambda.
        goal_depth: n_g, number of steps to look ahead; 1 is VFH+. A node within a step of the target is a goal too.
        step: d_s, m. circle, radius, reach, slack, threshold, certainty, widest: As for candidates(). sectors: n.
        nodes: (limit, 10), filled with the tree; the columns are named at the top of this module.

    Returns:
        Row of the last node of the path (-1 without roots), number of rows filled, number of nodes expanded. Column
        ROOT of the last node is the index of the path's primary candidate.
    """
    density, blocked = np.empty(sectors), np.empty(sectors)
    slots, directions = np.empty((sectors // 2 + 1, 2), np.int64), np.empty(3 * (sectors // 2 + 1))
    count = 0
    for i in range(min(roots.size, nodes.shape[0])):
        add_node(
            nodes, count, -1, (0.0, 0.0, 0.0), roots[i], target, previous, first, later, discount, goal_depth, step,
            circle,
        )  # fmt: skip
        count += 1
    expanded = 0
    while True:
        best = next_node(nodes, count)
        if best < 0:
            return deepest(nodes, count) if count else -1, count, expanded
        if nodes[best, IS_GOAL] > 0.0:
            return best, count, expanded
        place = (nodes[best, X], nodes[best, Y], nodes[best, THETA])
        found = candidates(
            cells, place, target, circle, radius, reach, slack, threshold, certainty, widest, density, blocked, slots,
            directions,
        )  # fmt: skip
        if count + found > nodes.shape[0]:
            return best, count, expanded
        nodes[best, IS_OPEN] = 0.0
        expanded += 1
        for i in range(found):
            add_node(
                nodes, count, best, place, directions[i], target, nodes[best, DIRECTION], first, later, discount,
                goal_depth, step, circle,
            )  # fmt: skip
            count += 1

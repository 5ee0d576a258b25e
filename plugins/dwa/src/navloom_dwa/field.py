"""Cost to go around known obstacles near the robot: the wave of the goal distance critic.

Brock & Khatib 1999 (*High-Speed Navigation Using the Global Dynamic Window Approach*) add such a field to the dynamic
window; the goal distance of Nav2's DWB is one on its local cost map. The field is computed in three steps: a chamfer
distance to occupied cells (Borgefors 1986), costs from that distance, and a shortest-path wave from the target by
sweeps over the rows until nothing changes (Zhao 2005, *A Fast Sweeping Method for Eikonal Equations*, on a graph).
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Counts = NDArray[np.int32]
CHAMFER = 3.0  # chamfer units per cell: 3 straight, 4 diagonally
UNIT = 10  # wave units per cell at cost 1: 10 straight, 14 diagonally
COSTLIEST = 25.0
FARTHEST = 2**30


@njit(cache=True, nogil=True)
def centre_field(origin: NDArray[np.int64], x: float, y: float, cell: float, size: int) -> None:
    """Centre the field on the robot, m, pose frame: set column and row of its first cell from the frame's origin."""
    origin[0], origin[1] = math.floor(x / cell) - size // 2, math.floor(y / cell) - size // 2


@njit(cache=True, nogil=True)
def obstacle_distance(
    obstacles: Floats, pose: tuple[float, float, float], origin: NDArray[np.int64], cell: float, distance: Counts
) -> None:
    """Compute the chamfer distance of each cell to the nearest one that holds an obstacle.

    Args:
        obstacles: (n, >= 2), x, y, m, base frame. pose: x, y, m, heading, rad, of the base in the pose frame.
        origin, cell: First cell of the field, see centre_field(), and side of a cell, m.
        distance: (rows, cols), filled in: 3 units per cell.
    """
    rows, cols = distance.shape
    # More than any chamfer distance in the field, and small enough that sums do not overflow.
    distance[:, :] = 30000
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for i in range(obstacles.shape[0]):
        bx, by = obstacles[i, 0], obstacles[i, 1]
        column = math.floor((pose[0] + bx * c - by * s) / cell) - origin[0]
        row = math.floor((pose[1] + bx * s + by * c) / cell) - origin[1]
        if 0 <= row < rows and 0 <= column < cols:
            distance[row, column] = 0
    for r in range(rows):
        if r > 0:
            spread_from(distance[r - 1], distance[r])
        best = FARTHEST
        for k in range(cols):
            best = min(best + 3, distance[r, k])
            distance[r, k] = best
    for r in range(rows - 1, -1, -1):
        if r < rows - 1:
            spread_from(distance[r + 1], distance[r])
        best = FARTHEST
        for k in range(cols - 1, -1, -1):
            best = min(best + 3, distance[r, k])
            distance[r, k] = best


@njit(cache=True, nogil=True)
def spread_from(before: Counts, row: Counts) -> None:
    """Chamfer steps from one row to the next, in place. Cells do not depend on their neighbours: this can vectorise."""
    last = row.size - 1
    row[0] = min(row[0], before[0] + 3, before[1] + 4)
    row[last] = min(row[last], before[last] + 3, before[last - 1] + 4)
    left, above, right, inner = before[:-2], before[1:-1], before[2:], row[1:-1]
    for k in range(inner.size):
        inner[k] = min(inner[k], above[k] + 3, min(left[k], right[k]) + 4)


@njit(cache=True, nogil=True)
def cell_cost(clearance: float, inner: float, soft: float, weight: float) -> float:
    """Cost per metre at a clearance of the base.

    Args:
        clearance: Distance to the nearest obstacle, m. inner: Radius of the inscribed disc, m; nearer is contact.
        soft: Width beyond `inner` over which costs fall to 1, m. weight: Added to 1 at `inner`.
    """
    if clearance < inner:
        return COSTLIEST
    return 1.0 + weight * max(0.0, 1.0 - (clearance - inner) / soft)


@njit(cache=True, nogil=True)
def relax_from(before: Counts, row: Counts, along: Counts, across: Counts) -> bool:
    """Steps of the wave from one row to the next, in place; return whether a cell became cheaper.

    Cells do not depend on their neighbours, so the loop can vectorise as long as sums are 32 bits wide.

    Args:
        before, row: (cols,), wave units.
        along, across: (cols,), cost of a straight and of a diagonal step into each cell of `row`.
    """
    last = row.size - 1
    cheaper = 0
    for k, beside in ((0, 1), (last, last - 1)):
        value = min(np.int32(before[k] + along[k]), np.int32(before[beside] + across[k]))
        cheaper |= value < row[k]
        row[k] = min(row[k], value)
    left, above, right, inner = before[:-2], before[1:-1], before[2:], row[1:-1]
    straight, diagonal = along[1:-1], across[1:-1]
    for k in range(inner.size):
        value = min(np.int32(above[k] + straight[k]), np.int32(min(left[k], right[k]) + diagonal[k]))
        cheaper |= value < inner[k]
        inner[k] = min(inner[k], value)
    return cheaper != 0


@njit(cache=True, nogil=True)
def relax_along(row: Counts, along: Counts) -> None:
    """Steps of the wave along a row, both ways, in place; arguments as for relax_from()."""
    best = np.int32(FARTHEST)
    for k in range(row.size):
        best = min(np.int32(best + along[k]), row[k])
        row[k] = best
    best = np.int32(FARTHEST)
    for k in range(row.size - 1, -1, -1):
        best = min(np.int32(best + along[k]), row[k])
        row[k] = best


@njit(cache=True, nogil=True)
def spread(costs: NDArray[np.uint8], seeds: Counts, cost_to_go: Counts) -> None:
    """Compute the least cost from each cell to a seed over 8 neighbours.

    Sweeps up and down the rows are repeated until no row changes the next one. Least costs are unique, so the order in
    which cells become cheaper does not matter; whole rows are several times as fast as a queue of cells.

    Args:
        costs: (rows, cols), cost per metre in each cell, in tenths, 10 .. 255.
        seeds: (rows, cols), cost at which the wave starts in a cell, wave units; negative for cells without a seed.
        cost_to_go: (rows, cols), filled in, wave units: 10 per straight, 14 per diagonal step, at cost 1.
    """
    rows, cols = costs.shape
    along, across = np.empty((rows, cols), np.int32), np.empty((rows, cols), np.int32)
    news_up, news_down = np.zeros(rows, np.bool_), np.zeros(rows, np.bool_)
    for r in range(rows):
        is_seeded = False
        for k in range(cols):
            along[r, k], across[r, k] = costs[r, k], 14 * costs[r, k] // 10
            cost_to_go[r, k] = seeds[r, k] if seeds[r, k] >= 0 else FARTHEST
            is_seeded |= seeds[r, k] >= 0
        if is_seeded:
            relax_along(cost_to_go[r], along[r])
            news_up[r], news_down[r] = True, True
    goes_on = True
    while goes_on:
        goes_on = False
        for r in range(1, rows):
            if news_up[r - 1]:
                news_up[r - 1] = False
                if relax_from(cost_to_go[r - 1], cost_to_go[r], along[r], across[r]):
                    relax_along(cost_to_go[r], along[r])
                    news_up[r], news_down[r] = True, True
        for r in range(rows - 2, -1, -1):
            if news_down[r + 1]:
                news_down[r + 1] = False
                if relax_from(cost_to_go[r + 1], cost_to_go[r], along[r], across[r]):
                    relax_along(cost_to_go[r], along[r])
                    news_up[r], news_down[r] = True, True
                    goes_on = True


@njit(cache=True, nogil=True)
def straight_cost(origin: NDArray[np.int64], cell: float, row: int, column: int, x: float, y: float) -> int:
    """Cost at 1 per metre, wave units, of the straight line from a cell's centre to a place, m, pose frame."""
    dx, dy = (origin[0] + column + 0.5) * cell - x, (origin[1] + row + 0.5) * cell - y
    return round(math.sqrt(dx * dx + dy * dy) / cell * UNIT)


@njit(cache=True, nogil=True)
def seed_field(seeds: Counts, origin: NDArray[np.int64], cell: float, x: float, y: float) -> None:
    """Start the wave in the nine cells around the target, or in all border cells if it is outside the field.

    Each starts at its distance to the target, so that the minimum is at the target and not at the centre of its cell.

    Args:
        seeds: (rows, cols), filled in, wave units. origin, cell: As for obstacle_distance().
        x, y: Target, m, pose frame.
    """
    rows, cols = seeds.shape
    seeds[:, :] = -1
    column, row = math.floor(x / cell) - origin[0], math.floor(y / cell) - origin[1]
    if 0 <= row < rows and 0 <= column < cols:
        for r in range(max(0, row - 1), min(rows, row + 2)):
            for k in range(max(0, column - 1), min(cols, column + 2)):
                seeds[r, k] = straight_cost(origin, cell, r, k, x, y)
        return
    for r in range(rows):
        for k in range(0, cols, 1 if r == 0 or r == rows - 1 else cols - 1):
            seeds[r, k] = straight_cost(origin, cell, r, k, x, y)


@njit(cache=True, nogil=True)
def fill_field(
    obstacles: Floats,
    pose: tuple[float, float, float],
    target: tuple[float, float],
    origin: NDArray[np.int64],
    cell: float,
    inner: float,
    soft: float,
    weight: float,
    distance: Counts,
    cost_to_go: Counts,
) -> None:
    """Compute both fields from obstacles and target; arguments as for the functions above."""
    rows, cols = distance.shape
    centre_field(origin, pose[0], pose[1], cell, cols)
    obstacle_distance(obstacles, pose, origin, cell, distance)
    table = np.empty(math.ceil((inner + soft) * CHAMFER / cell) + 2, np.uint8)  # cells farther away cost no more
    for k in range(table.size):
        table[k] = min(255, int(10.0 * cell_cost(k * cell / CHAMFER, inner, soft, weight)))
    costs, seeds = np.empty((rows, cols), np.uint8), np.empty((rows, cols), np.int32)
    for r in range(rows):
        for k in range(cols):
            costs[r, k] = table[min(table.size - 1, distance[r, k])]
    seed_field(seeds, origin, cell, target[0], target[1])
    spread(costs, seeds, cost_to_go)


@njit(cache=True, nogil=True)
def field_value(field: Counts, origin: NDArray[np.int64], cell: float, x: float, y: float) -> float:
    """Value of a field at a place, m, pose frame, bilinear between cell centres; outside, the value at the border."""
    rows, cols = field.shape
    # A little less than the last cell, so that the next one exists.
    u = min(cols - 1.001, max(0.0, x / cell - origin[0] - 0.5))
    t = min(rows - 1.001, max(0.0, y / cell - origin[1] - 0.5))
    k, r = int(u), int(t)
    u, t = u - k, t - r
    low = (1.0 - u) * field[r, k] + u * field[r, k + 1]
    high = (1.0 - u) * field[r + 1, k] + u * field[r + 1, k + 1]
    return float((1.0 - t) * low + t * high)

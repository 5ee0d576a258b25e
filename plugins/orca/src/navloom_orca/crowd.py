"""One step of a crowd: each agent takes the velocity that avoids those it sees (van den Berg et al. 2011)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from navloom_orca.half_planes import put_agent, put_line
from navloom_orca.neighbours import cell_width, fill_cells, insert, nearest_seen
from navloom_orca.programme import best_velocity

Floats = NDArray[np.float64]
NO_LINES = np.zeros((0, 4))


class Reaction(NamedTuple):
    """How agents react.

    Attributes:
        horizon: Time for which agents keep clear of each other, s; the sooner they meet, the harder they turn.
        line_horizon: The same for line obstacles, s.
        reach: Farthest distance of an agent that is avoided, m.
        most: Number of agents that one avoids; the nearest.
        period: Time until the next step, s; agents that overlap part within it.
    """

    horizon: float = 5.0
    line_horizon: float = 1.0
    reach: float = 10.0
    most: int = 10
    period: float = 0.05


def react(
    positions: Floats, velocities: Floats, radii: Floats, preferred: Floats, max_speeds: Floats,
    sees: NDArray[np.bool_], lines: Floats = NO_LINES, reaction: Reaction | None = None,
) -> Floats:  # fmt: skip
    """Velocities with which agents avoid each other and line obstacles: all at once, from the same moment.

    An agent takes half of the change that two need, if the other sees it too, else all of it. An agent that sees nobody
    is an obstacle to others with the velocity given; of what it gets here, only the lines are avoided.

    Args:
        positions: (n, 2) m, any frame. velocities: (n, 2) current, m/s. radii: (n,) m.
        preferred: (n, 2) m/s. max_speeds: (n,) m/s.
        sees: (n, n) row i: which agents i avoids; the diagonal does not matter.
        lines: (k, 4) ends x, y, x, y of static line obstacles, m; points where both ends are one.
        reaction: Horizons and reaches; by default those of `Reaction`.

    Returns:
        (n, 2) m/s. The same arguments give the same bits, and in another order of agents the same velocities, unless
        two neighbours are equally far.
    """
    n = len(positions)
    found = np.empty((n, 2))
    if n:
        p, v, r, wanted, fastest = (
            np.ascontiguousarray(array, np.float64) for array in (positions, velocities, radii, preferred, max_speeds)
        )
        mask, walls = np.ascontiguousarray(sees, np.bool_), np.ascontiguousarray(lines, np.float64)
        step(p, v, r, wanted, fastest, mask, walls, reaction or Reaction(), found)
    return found


@njit(cache=True, nogil=True)
def step(
    positions: Floats, velocities: Floats, radii: Floats, preferred: Floats, max_speeds: Floats,
    sees: NDArray[np.bool_], lines: Floats, reaction: Reaction, found: Floats,
) -> None:  # fmt: skip
    """React with arrays that are C-contiguous and of at least one agent; found (n, 2) is filled in; see react()."""
    n, most = positions.shape[0], min(reaction.most, positions.shape[0])
    cells = fill_cells(positions, cell_width(positions, reaction.reach))
    others, squares = np.empty(most, np.int64), np.empty(most)
    walls, gaps = np.empty(lines.shape[0], np.int64), np.empty(lines.shape[0])
    planes, scratch = np.empty((most + lines.shape[0], 4)), np.empty((most + lines.shape[0], 4))
    for i in range(n):
        x, y, velocity = positions[i, 0], positions[i, 1], (velocities[i, 0], velocities[i, 1])
        reach = radii[i] + reaction.line_horizon * max_speeds[i]
        hard = put_lines(lines, x, y, velocity, radii[i], reach, reaction.line_horizon, walls, gaps, planes)
        count = nearest_seen(positions, i, sees, reaction.reach, cells, others, squares)
        for k in range(count):
            j = others[k]
            put_agent(
                planes, hard + k, (positions[j, 0] - x, positions[j, 1] - y), velocity,
                (velocity[0] - velocities[j, 0], velocity[1] - velocities[j, 1]), radii[i] + radii[j],
                reaction.horizon, reaction.period, 0.5 if sees[j, i] else 1.0,
            )  # fmt: skip
        found[i, 0], found[i, 1] = best_velocity(
            planes, hard + count, 0, hard, max_speeds[i], preferred[i, 0], preferred[i, 1], scratch
        )


@njit(cache=True, nogil=True)
def put_lines(
    lines: Floats, x: float, y: float, velocity: tuple[float, float], radius: float, reach: float, horizon: float,
    walls: NDArray[np.int64], gaps: Floats, planes: Floats,
) -> int:  # fmt: skip
    """Half planes of the line obstacles near an agent, from row 0 on, the nearest first, since these cover others.

    Args:
        lines: (k, 4) ends, m. x, y: Agent, m. velocity: m/s. radius: m. reach: m. horizon: s.
        walls, gaps: (k,), overwritten. planes: (>= k, 4), filled in.

    Returns:
        Rows in use.
    """
    near = 0
    for k in range(lines.shape[0]):
        ax, ay = lines[k, 0] - x, lines[k, 1] - y
        sx, sy = lines[k, 2] - lines[k, 0], lines[k, 3] - lines[k, 1]
        square = sx * sx + sy * sy
        t = min(max(-(ax * sx + ay * sy) / square, 0.0), 1.0) if square > 0.0 else 0.0
        gap = (ax + t * sx) ** 2 + (ay + t * sy) ** 2
        if gap < reach * reach:
            near = insert(walls, gaps, near, k, gap)
    row = 0
    for k in range(near):
        i = walls[k]
        segment = (lines[i, 0] - x, lines[i, 1] - y, lines[i, 2] - x, lines[i, 3] - y)
        row = put_line(planes, row, segment, velocity, radius, horizon)
    return row

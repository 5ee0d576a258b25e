"""Clearance ahead of the footprint: the paper's d30, the free run straight ahead, and the roll-out of a command."""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

LONGEST_ROLL = 64  # most steps of one check
APPROACH = 0.25  # share of its distance above the floor by which a cell within the margin may come nearer in one check
STOPPED = 0.01  # m/s: a lagging robot at this speed stops within a millimetre or two


def footprint_edges(vertices: NDArray[np.float64]) -> NDArray[np.float64]:
    """Half planes of a convex footprint.

    Args:
        vertices: (k, 2), m, base frame, counter-clockwise.

    Returns:
        (k, 3): outward unit normal x, y and offset, m, of each side; inside is normal . p <= offset.
    """
    side = np.roll(vertices, -1, axis=0) - vertices
    normal = np.column_stack((side[:, 1], -side[:, 0])) / np.hypot(side[:, 0], side[:, 1])[:, None]
    return np.ascontiguousarray(np.column_stack((normal, np.sum(normal * vertices, axis=1))))


def disc_radius(footprint: NDArray[np.float64], disc: str) -> float:
    """Radius, m, of the disc around the base that encloses the (k, 2) footprint, or is within it; 0 for a point."""
    if disc == "point":
        return 0.0
    if disc == "enclosing":
        return float(np.hypot(footprint[:, 0], footprint[:, 1]).max())
    return float(footprint_edges(footprint)[:, 2].min())


@njit(cache=True, nogil=True)
def outside_distance(edges: NDArray[np.float64], x: float, y: float) -> float:
    """Largest distance of a point beyond a side, m: negative inside, never more than the true distance outside."""
    greatest = -1.0e9
    for k in range(edges.shape[0]):
        greatest = max(greatest, edges[k, 0] * x + edges[k, 1] * y - edges[k, 2])
    return greatest


@njit(cache=True, nogil=True)
def nearest_ahead(
    cells: NDArray[np.float64], half_sector: float, front: float, half_width: float, margin: float
) -> tuple[float, float]:
    """Distance to the nearest cell in the sector ahead (d30) and free run straight ahead, both from the front.

    Args:
        cells: (n, 3), x, y, m, base frame, and certainty.
        half_sector: 30 deg in the paper, rad.
        front: Distance of the robot's front from its centre, m; 0 measures d30 from the centre.
        half_width: Half width of the footprint, m. margin: Distance kept on both sides and ahead, m.

        Returns:
            d30 and the free run, m; +inf for nothing ahead.
    """
    nearest, run = np.inf, np.inf
    for i in range(cells.shape[0]):
        x, y = cells[i, 0], cells[i, 1]
        if abs(math.atan2(y, x)) <= half_sector:
            nearest = min(nearest, math.hypot(x, y) - front)
        if x > 0.0 and abs(y) < half_width + margin:
            run = min(run, x - front - margin)
    return nearest, run


@njit(cache=True, nogil=True)
def is_free(
    cells: NDArray[np.float64],
    edges: NDArray[np.float64],
    twist: tuple[float, float],
    command: tuple[float, float],
    period: float,
    acceleration: float,
    deceleration: float,
    turn_horizon: float,
    margin: float,
    floor: float,
    in_flight: NDArray[np.float64],
    lag: float,
    dead_time: float,
) -> bool:
    """Whether one period of a command, and then braking along the same arc, keeps the margin to every occupied cell.

    A cell that is already within the margin may come nearer only by a share of its distance above the floor, so that
    the robot can still leave, and noise does not hold it in a gap.

    Args:
        cells: (n, 3), x, y, m, base frame, and certainty. edges: From footprint_edges().
        twist: Current forward speed, m/s, and turn rate, rad/s.
        command: Forward speed, m/s, and turn rate, rad/s, sent now.
        period: Control tick, s. acceleration, deceleration: Of the command gate, m/s^2.
        turn_horizon: Shortest look-ahead time, s: a turn in place has no braking distance.
        margin: m. floor: m, at most the margin; a cell that is this near may not come nearer at all.
        in_flight, lag, dead_time: From motors.Motors; without lag and dead time the robot turns at once as commanded.
    """
    step = 0.05
    keeps = math.exp(-step / lag) if lag > 0.0 else 0.0
    x = y = heading = elapsed = 0.0
    v, w = twist
    commanded = in_flight[-1, 0]
    for _ in range(LONGEST_ROLL):
        driven = elapsed - dead_time
        if driven < -1.0e-9:
            row = max(0, in_flight.shape[0] - math.ceil(-driven / period - 1.0e-9))
            v_next, w_next = in_flight[row, 0], in_flight[row, 1]
        else:
            goal = command[0] if driven < period else 0.0
            if goal >= commanded:
                commanded = min(goal, commanded + acceleration * step)
            else:
                commanded = max(goal, commanded - deceleration * step)
            v_next, w_next = commanded, command[1]
        if lag > 0.0:
            v_next, w_next = v_next + keeps * (v - v_next), w_next + keeps * (w - w_next)
        w = w_next
        travel, turn = 0.5 * (v + v_next) * step, w * step
        x += travel * math.cos(heading + 0.5 * turn)
        y += travel * math.sin(heading + 0.5 * turn)
        heading += turn
        v = v_next
        elapsed += step
        cos_t, sin_t = math.cos(heading), math.sin(heading)
        for i in range(cells.shape[0]):
            dx, dy = cells[i, 0] - x, cells[i, 1] - y
            distance = outside_distance(edges, dx * cos_t + dy * sin_t, dy * cos_t - dx * sin_t)
            if distance < margin:
                now = min(outside_distance(edges, cells[i, 0], cells[i, 1]), margin)
                if distance < now - max(APPROACH * (now - floor), 1.0e-6):
                    return False
        if elapsed >= period + turn_horizon + lag + dead_time and v <= (STOPPED if lag > 0.0 else 0.0):
            break
    return True


@njit(cache=True, nogil=True)
def free_command(
    cells: NDArray[np.float64],
    edges: NDArray[np.float64],
    twist: tuple[float, float],
    command: tuple[float, float],
    creep: float,
    period: float,
    acceleration: float,
    deceleration: float,
    turn_horizon: float,
    margin: float,
    floor: float,
    in_flight: NDArray[np.float64],
    lag: float,
    dead_time: float,
) -> tuple[float, float]:
    """The wanted command, reduced until is_free(): speed first, then turn rate; last, creeping out along a free arc.

    Args:
        creep: Speed, m/s, that is tried if there is no room for the wanted turn: driving ahead moves the corners past
            the obstacle.

    Returns:
        Forward speed, m/s, and turn rate, rad/s; (0, 0) if nothing is free.
    """
    v, w = command
    delay = lag + dead_time
    reach, fastest = max(v, twist[0], creep), abs(w)
    if delay > 0.0:
        reach, fastest = max(reach, in_flight[-1, 0]), max(fastest, abs(twist[1]), abs(in_flight[-1, 1]))
    turning = fastest * (period + delay + turn_horizon + reach / deceleration)
    reach = reach * (2.0 * period + delay + reach / deceleration) + turning
    near = np.empty_like(cells)
    count = 0
    for i in range(cells.shape[0]):
        if outside_distance(edges, cells[i, 0], cells[i, 1]) < margin + reach:
            near[count] = cells[i]
            count += 1
    if count == 0:
        return v, w
    near = near[:count]
    trials = [
        (v * pace, w * turn)
        for turn in (1.0, 0.5, 0.25, 0.0)
        for pace in (1.0, 0.5, 0.25, 0.0)
        if not ((pace < 1.0 and v == 0.0) or (turn < 1.0 and w == 0.0) or (v * pace == 0.0 and turn == 0.0))
    ]
    if creep > 0.0 and w != 0.0:
        trials += [(creep, w * turn) for turn in (1.0, 0.5, 0.0, -0.5)]
    for trial in trials:
        if is_free(
            near, edges, twist, trial, period, acceleration, deceleration, turn_horizon, margin, floor, in_flight, lag,
            dead_time,
        ):  # fmt: skip
            return trial
    return 0.0, 0.0

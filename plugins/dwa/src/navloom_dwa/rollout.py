"""Choice of the command: the best velocity that stays free with the gate's ramps and with braking after it."""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from navloom_dwa.window import stoppable_speed

Floats = NDArray[np.float64]
LONGEST = 200  # steps of one roll-forward
TRIES = 24
STOPPED = 0.01  # m/s: a lagging robot that is this slow stops within a millimetre or two
TAIL = 6.0  # time constants until a lagging robot is that slow


@njit(cache=True, nogil=True)
def ramp(now: float, wanted: float, up: float, down: float, time: float) -> float:
    """Speed after a time, s, on the ramp to the wanted one: rate `up` away from 0, `down` towards 0, as in the gate."""
    rate = up if abs(wanted) > abs(now) and wanted * now >= 0.0 else down
    return min(max(wanted, now - rate * time), now + rate * time)


@njit(cache=True, nogil=True)
def is_nearer(edges: Floats, x: float, y: float, distance: float) -> bool:
    """Whether clearance.outside_distance() of a point is less than a distance, m. Few sides decide most points."""
    is_beyond = False
    for k in range(edges.shape[0]):
        is_beyond = edges[k, 0] * x + edges[k, 1] * y - edges[k, 2] >= distance
        if is_beyond:
            break
    return not is_beyond


@njit(cache=True, nogil=True, error_model="numpy")
def reach_of(edges: Floats, margin: float) -> float:
    """Distance from the base, m, of the farthest corner of a footprint after its sides are moved out by a margin, m."""
    reach = 0.0
    for k in range(edges.shape[0]):
        nx, ny, offset = edges[k - 1, 0], edges[k - 1, 1], edges[k - 1, 2] + margin
        across, other = nx * edges[k, 1] - ny * edges[k, 0], edges[k, 2] + margin
        x, y = (offset * edges[k, 1] - other * ny) / across, (other * nx - offset * edges[k, 0]) / across
        reach = max(reach, math.hypot(x, y) if across != 0.0 else np.inf)
    return reach


@njit(cache=True, nogil=True)
def stays_free(
    obstacles: Floats,
    gaps: Floats,
    edges: Floats,
    twist: tuple[float, float],
    command: tuple[float, float],
    period: float,
    up: float,
    down: float,
    turn_down: float,
    margin: float,
    in_flight: Floats,
    lag: float,
    dead_time: float,
) -> bool:
    """Whether one period of a command, and braking along the same arc, keeps every obstacle's margin.

    Args:
        obstacles, gaps: From points.obstacles_in_base(). edges: clearance.footprint_edges().
        twist: Current speed, m/s, and turn rate, rad/s. command: m/s and rad/s.
        period: s. up, down: Ramps of the gate, m/s^2. turn_down: rad/s^2. margin: Greatest of all obstacles, m.
        in_flight, lag, dead_time: As in motors.Motors. Without lag and dead time the robot turns as commanded at once.
    """
    (speed, turning), (v, w) = twist, command
    commanded, delay = in_flight[-1, 0], lag + dead_time
    highest = max(abs(speed), abs(v), abs(commanded))
    fastest = max(abs(w), abs(turning), abs(in_flight[-1, 1])) if delay > 0.0 else abs(w)
    reach = highest * (period + delay + 0.5 * highest / down) + 0.05
    reach += fastest * (period + delay + highest / down + 0.5 * fastest / turn_down)  # of a corner 1 m from the base
    count = np.searchsorted(gaps, margin + reach)
    step = period / math.ceil(period / 0.025)
    step = max(step, (period + dead_time + TAIL * lag + highest / down + abs(w) / turn_down) / LONGEST)
    keeps = math.exp(-step / lag) if lag > 0.0 else 0.0
    x, y, heading, elapsed = 0.0, 0.0, 0.0, 0.0
    rest = period + delay + 0.5 * abs(w) / turn_down
    rim = reach_of(edges, margin)
    for _ in range(LONGEST + 4):
        driven = elapsed - dead_time
        if driven < -1.0e-9:
            row = max(0, in_flight.shape[0] - math.ceil(-driven / period - 1.0e-9))
            goal_v, goal_w = in_flight[row, 0], in_flight[row, 1]
        else:
            commanded = ramp(commanded, v if driven < period - 1.0e-9 else 0.0, up, down, step)
            goal_v, goal_w = commanded, w
        faster = goal_v + keeps * (speed - goal_v) if lag > 0.0 else goal_v
        turning = goal_w + keeps * (turning - goal_w) if lag > 0.0 else goal_w
        middle = heading + 0.5 * turning * step
        x += 0.5 * (speed + faster) * step * math.cos(middle)
        y += 0.5 * (speed + faster) * step * math.sin(middle)
        heading += turning * step
        speed = faster
        elapsed += step
        c, s = math.cos(heading), math.sin(heading)
        # No point of the footprint has moved farther than this, so obstacles with a larger gap cannot be met yet.
        met = margin + math.hypot(x, y) + abs(heading) * rim + 1.0e-6
        for i in range(count):
            if gaps[i] > met:
                break
            dx, dy = obstacles[i, 0] - x, obstacles[i, 1] - y
            if is_nearer(edges, dx * c + dy * s, dy * c - dx * s, obstacles[i, 2] - 1.0e-6):
                return False
        if abs(speed) <= (STOPPED if lag > 0.0 else 0.0) and elapsed >= rest - 1.0e-9:
            return True
    return False


@njit(cache=True, nogil=True)
def highest_speeds(
    arcs: Floats, contacts: Floats, v_brake: float, w_brake: float, reaction: float, limits: Floats
) -> None:
    """Compute V_a on each arc: the highest u from which translation and rotation both stop before the contact.

    Args:
        arcs: (m, 4), from window.sample_arcs(). contacts: (m,), from contact.first_contacts(), s at u = 1.
        v_brake, w_brake, reaction: As for window.stoppable_speed(). limits: (m,), filled in.
    """
    for j in range(arcs.shape[0]):
        v, w = abs(arcs[j, 0]), abs(arcs[j, 1])
        limits[j] = np.inf
        if v > 0.0:
            limits[j] = stoppable_speed(v * contacts[j], v_brake, reaction) / v
        if w > 0.0:
            limits[j] = min(limits[j], stoppable_speed(w * contacts[j], w_brake, reaction) / w)


@njit(cache=True, nogil=True)
def choose(
    costs: Floats,
    arcs: Floats,
    twist: tuple[float, float],
    obstacles: Floats,
    gaps: Floats,
    edges: Floats,
    period: float,
    up: float,
    down: float,
    turn: float,
    margin: float,
    is_checked: bool,
    in_flight: Floats,
    lag: float,
    dead_time: float,
) -> tuple[int, int, float, float]:
    """Choose the cheapest velocity that stays free.

    Args:
        costs: (m, n), +inf where not admissible. twist: Current speed, m/s, and turn rate, rad/s.
        turn: Greatest change of the turn rate, rad/s^2, from the newest command in flight.
        is_checked: Whether the velocity must pass stays_free().
        The others: As for window.sample_arcs() and stays_free().

    Returns:
        Indices of the chosen arc and speed, -1 for none; forward speed, m/s, and turn rate, rad/s, ramped for one
        period.
    """
    left = costs.copy()
    for _ in range(TRIES):
        best = np.argmin(left)
        j, i = best // costs.shape[1], best % costs.shape[1]
        if left[j, i] == np.inf:
            break
        u = arcs[j, 2] + (arcs[j, 3] - arcs[j, 2]) * i / (costs.shape[1] - 1)
        v, w = arcs[j, 0] * u, ramp(in_flight[-1, 1], arcs[j, 1] * u, turn, turn, period)
        if not is_checked or stays_free(
            obstacles, gaps, edges, twist, (v, w), period, up, down, turn, margin, in_flight, lag, dead_time
        ):
            return j, i, v, w
        left[j, i:] = np.inf  # faster speeds on the same arc are not free either
    return -1, -1, 0.0, 0.0

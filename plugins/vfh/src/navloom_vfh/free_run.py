"""The fastest command from which the footprint stops before what is on its arc, and the choice among such commands."""

import math

import numpy as np
from navloom_avoidance.clearance import outside_distance
from navloom_avoidance.himm import TOP
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
ECHO = TOP + 1.0e-6  # certainty of an echo point: that of a full cell, and recognisable
LONGEST = 100  # most steps of one roll-forward
STEP = 0.05  # s: at 2 m/s a step of 0.1 m, less than the depth of any obstacle that a laser sees from two sides
STOPPED = 0.01  # m/s: a lagging robot at this speed stops within a millimetre or two
APPROACH = 0.25  # share of its distance above the floor by which a point within the margin may come nearer in one check
HALVINGS = 4  # the speed is exact to 1/16 of what is wanted


@njit(cache=True, nogil=True)
def ramp(now: float, wanted: float, up: float, down: float) -> float:
    """Speed one step later on the gate's ramp: at most `up` faster, or `down` slower, m/s."""
    most = up if abs(wanted) > abs(now) and wanted * now >= 0.0 else down
    return min(max(wanted, now - most), now + most)


@njit(cache=True, nogil=True)
def stops_free(
    points: Floats,
    gaps: Floats,
    edges: Floats,
    rim: float,
    twist: tuple[float, float],
    command: tuple[float, float],
    period: float,
    limits: tuple[float, float, float],
    in_flight: Floats,
    lag: float,
    dead_time: float,
) -> bool:
    """Whether one period of a command, and then braking with the same curvature, keeps the margin to every point.

    Args:
        points: (n, 4), x, y, m, base frame, and the margin and floor of each, m, sorted by their gaps. A point within
            its margin may come nearer only by a share of its distance above its floor.
        gaps: (n,), distance of each beyond a side of the footprint, m, rising.
        edges: clearance.footprint_edges(). rim: Distance of its farthest corner from the base, m.
        twist: Present speed, m/s, and turn rate, rad/s. command: m/s and rad/s.
        period: s. limits: Acceleration and deceleration of the command gate, m/s^2, and of the turn, rad/s^2.
        in_flight, lag, dead_time: From motors.Motors.
    """
    keeps = math.exp(-STEP / lag) if lag > 0.0 else 0.0
    x = y = heading = elapsed = 0.0
    v, w = twist
    commanded = in_flight[-1, 0]
    most = points[:, 2].max() if points.shape[0] > 0 else 0.0
    last, turning = 0.0, in_flight[-1, 1]
    for _ in range(LONGEST):
        driven = elapsed - dead_time
        if driven < -1.0e-9:
            row = max(0, in_flight.shape[0] - math.ceil(-driven / period - 1.0e-9))
            v_next, w_next = in_flight[row, 0], in_flight[row, 1]
        else:
            if driven < period - 1.0e-9:
                commanded = ramp(commanded, command[0], limits[0] * STEP, limits[1] * STEP)
                turning = ramp(turning, command[1], limits[2] * STEP, limits[2] * STEP)
                last = commanded
            else:
                # As VfhSweptAvoidance brakes: on the arc that the robot is on.
                commanded = ramp(commanded, 0.0, limits[0] * STEP, limits[1] * STEP)
                bent = command[1] * commanded / last if last != 0.0 else 0.0
                turning = ramp(turning, bent, limits[2] * STEP, limits[2] * STEP)
            v_next, w_next = commanded, turning
        if lag > 0.0:
            v_next, w_next = v_next + keeps * (v - v_next), w_next + keeps * (w - w_next)
        w = w_next
        travel, turn = 0.5 * (v + v_next) * STEP, w * STEP
        x += travel * math.cos(heading + 0.5 * turn)
        y += travel * math.sin(heading + 0.5 * turn)
        heading += turn
        v = v_next
        elapsed += STEP
        cos_t, sin_t = math.cos(heading), math.sin(heading)
        # No part of the footprint has moved farther than this.
        met = most + math.hypot(x, y) + abs(heading) * rim
        for i in range(points.shape[0]):
            if gaps[i] > met:
                break
            dx, dy = points[i, 0] - x, points[i, 1] - y
            distance = outside_distance(edges, dx * cos_t + dy * sin_t, dy * cos_t - dx * sin_t)
            if distance < points[i, 2]:
                now = min(gaps[i], points[i, 2])
                if distance < now - max(APPROACH * (now - points[i, 3]), 1.0e-6):
                    return False
        if driven >= period - STEP and abs(v) <= STOPPED and abs(w) <= 2.0 * STOPPED:
            break
    return True


@njit(cache=True, nogil=True)
def near_points(
    cells: Floats, edges: Floats, reach: float, margins: Floats, beam_spacing: float, points: Floats, gaps: Floats
) -> int:
    """Cells near the footprint, with the margin to keep to each, nearest first.

    Args:
        cells: (n, 3), x, y, m, base frame, and certainty; ECHO for an echo point of a laser.
        edges: clearance.footprint_edges(). reach: Greatest distance beyond a side, m.
        margins: (2, 2), margin and floor of an echo point, and of a cell, m.
        beam_spacing: Angle between two beams, rad: an obstacle may reach beyond its echo by as much.
        points: (N, 4), gaps: (N,), filled in, see stops_free().

    Returns:
        Rows filled.
    """
    distance = np.empty(cells.shape[0])
    index = np.empty(cells.shape[0], np.int64)
    count = 0
    for i in range(cells.shape[0]):
        gap = outside_distance(edges, cells[i, 0], cells[i, 1])
        if gap <= reach:
            distance[count], index[count] = gap, i
            count += 1
    order = np.argsort(distance[:count])
    count = min(count, gaps.size)
    for k in range(count):
        i = index[order[k]]
        points[k, 0], points[k, 1] = cells[i, 0], cells[i, 1]
        if cells[i, 2] == ECHO:
            beside = beam_spacing * math.hypot(cells[i, 0], cells[i, 1])
            points[k, 2], points[k, 3] = margins[0, 0] + beside, margins[0, 1] + beside
        else:
            points[k, 2], points[k, 3] = margins[1, 0], margins[1, 1]
        gaps[k] = distance[order[k]]
    return count


@njit(cache=True, nogil=True)
def fastest_free(
    points: Floats,
    gaps: Floats,
    edges: Floats,
    rim: float,
    twist: tuple[float, float],
    wanted: float,
    turn: float,
    period: float,
    limits: tuple[float, float, float],
    in_flight: Floats,
    lag: float,
    dead_time: float,
) -> float:
    """Greatest speed up to the wanted one, m/s, that stops_free() at a turn rate, by bisection; -1 for none."""
    if stops_free(points, gaps, edges, rim, twist, (wanted, turn), period, limits, in_flight, lag, dead_time):
        return wanted
    if not stops_free(points, gaps, edges, rim, twist, (0.0, turn), period, limits, in_flight, lag, dead_time):
        # Corners may need room ahead to turn: a slow arc can be free where a turn in place is not.
        low = -1.0
    else:
        low = 0.0
    high = wanted
    for _ in range(HALVINGS):
        middle = 0.5 * (max(low, 0.0) + high)
        if stops_free(points, gaps, edges, rim, twist, (middle, turn), period, limits, in_flight, lag, dead_time):
            low = middle
        else:
            high = middle
    return low


@njit(cache=True, nogil=True)
def progress_score(v: float, w: float, error: float, time: float, nose: float) -> float:
    """Way of the nose in the chosen direction, m, after a time, s.

    Args:
        v, w: m/s and rad/s. error: Chosen direction relative to the heading, rad. nose: Its distance from the base, m.
    """
    turned = w * time
    off = abs(error - turned)
    return max(0.0, v * time * math.cos(error - 0.5 * turned)) - nose * min(off, math.pi)


@njit(cache=True, nogil=True)
def choose_command(
    points: Floats,
    gaps: Floats,
    edges: Floats,
    rim: float,
    twist: tuple[float, float],
    error: float,
    wanted: float,
    turn: float,
    max_turn: float,
    turn_rates: int,
    barred: int,
    time: float,
    nose: float,
    period: float,
    limits: tuple[float, float, float],
    in_flight: Floats,
    lag: float,
    dead_time: float,
) -> tuple[float, float]:
    """The command that brings the nose farthest in the chosen direction, of those that stop free.

    Args:
        error: Chosen direction relative to the predicted heading, rad.
        wanted: Greatest speed, m/s. turn: Turn rate of the steering law, rad/s. max_turn: rad/s.
        turn_rates: Turn rates are tried max_turn / (2 turn_rates) apart.
        barred: Sign of the turn rates that are not tried, 0 for none. time, nose: See progress_score().
        The others: As for stops_free().

    Returns:
        Speed, m/s, and turn rate, rad/s; (-1, 0) if nothing is free.
    """
    best, best_v, best_w = -np.inf, -1.0, 0.0
    # What the gate lets through: with more, the arc of the command would not be that of the robot.
    wanted = min(wanted, max(0.0, in_flight[-1, 0]) + limits[0] * period)
    step = 0.5 * max_turn / turn_rates if turn_rates > 0 else 0.0
    for k in range(-2 * turn_rates, 2 * turn_rates + 1):
        w = turn + k * step
        if abs(w) > max_turn or w * barred > 0.0:
            continue
        if progress_score(wanted, w, error, time, nose) <= best:
            continue
        v = fastest_free(points, gaps, edges, rim, twist, wanted, w, period, limits, in_flight, lag, dead_time)
        if v < 0.0 or (v == 0.0 and abs(w) < 0.05):
            continue
        score = progress_score(v, w, error, time, nose)
        if score > best:
            best, best_v, best_w = score, v, w
    return best_v, best_w

"""Half planes of permitted velocities: one for each agent and each line obstacle near an agent.

van den Berg, Guy, Lin & Manocha 2011, section 4. Positions in m, velocities in m/s, any one frame. A half plane is a
row (x, y, dx, dy), see programme.py.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
TOUCH = 1.0e-12
"""Distance, m/s, by which a half plane may be beyond another and still count as covered by it."""


@njit(cache=True, nogil=True)
def put(planes: Floats, row: int, x: float, y: float, dx: float, dy: float) -> int:
    """Write a half plane into a row; return the next row."""
    planes[row, 0], planes[row, 1], planes[row, 2], planes[row, 3] = x, y, dx, dy
    return row + 1


@njit(cache=True, nogil=True)
def put_agent(
    planes: Floats, row: int, place: tuple[float, float], velocity: tuple[float, float], speed: tuple[float, float],
    radius: float, horizon: float, period: float, share: float,
) -> int:  # fmt: skip
    """The half plane of another agent: eq. (5), with the velocity obstacle truncated at the horizon, eq. (2) to (4).

    `u` is the least change of the relative velocity that leaves the velocity obstacle. The agent takes its share of it;
    half in the paper, since the other does the same. Agents that overlap leave each other within one period.

    Args:
        planes: (n, 4). row: Row to write.
        place: Position of the other relative to the agent, m. velocity: Of the agent, m/s.
        speed: Velocity of the agent relative to the other, m/s.
        radius: Sum of both radii, m. horizon, period: s. share: 0.5 to 1, no unit.

    Returns:
        The next row.
    """
    (px, py), (vx, vy) = place, speed
    square, reach = px * px + py * py, radius * radius
    is_apart = square > reach
    rate = 1.0 / horizon if is_apart else 1.0 / period
    wx, wy = vx - rate * px, vy - rate * py
    along, length = wx * px + wy * py, math.hypot(wx, wy)
    if not is_apart or (along < 0.0 and along * along > reach * length * length):
        # Agents at one place with one velocity have no direction to leave in: any is as good.
        nx, ny = (wx / length, wy / length) if length > 0.0 else (1.0, 0.0)
        dx, dy = ny, -nx
        ux, uy = (radius * rate - length) * nx, (radius * rate - length) * ny
    else:
        leg = math.sqrt(square - reach)
        if px * wy - py * wx > 0.0:
            dx, dy = (px * leg - py * radius) / square, (px * radius + py * leg) / square
        else:
            dx, dy = -(px * leg + py * radius) / square, (px * radius - py * leg) / square
        forward = vx * dx + vy * dy
        ux, uy = forward * dx - vx, forward * dy - vy
    return put(planes, row, velocity[0] + share * ux, velocity[1] + share * uy, dx, dy)


@njit(cache=True, nogil=True)
def is_covered(planes: Floats, row: int, ax: float, ay: float, bx: float, by: float, radius: float) -> bool:
    """Whether a half plane in rows 0 to row - 1 excludes all velocities that lead into a line obstacle.

    Args:
        planes: (n, 4). ax, ay, bx, by: Ends of the obstacle over the horizon, m/s. radius: Over the horizon, m/s.
    """
    for j in range(row):
        dx, dy = planes[j, 2], planes[j, 3]
        first = (ax - planes[j, 0]) * dy - (ay - planes[j, 1]) * dx
        second = (bx - planes[j, 0]) * dy - (by - planes[j, 1]) * dx
        if min(first, second) - radius >= -TOUCH:
            return True
    return False


@njit(cache=True, nogil=True)
def put_line(
    planes: Floats, row: int, segment: tuple[float, float, float, float], velocity: tuple[float, float],
    radius: float, horizon: float,
) -> int:  # fmt: skip
    """The half plane of a static line obstacle, or of a point, for which the agent takes all of the change.

    Section 4.4: the velocity obstacle is that of the line, widened by the radius, and truncated at the horizon. Of its
    border, what is nearest to the velocity counts: the front, one of the round ends, or a leg. A line that the half
    planes so far keep away already adds none.

    Args:
        planes: (n, 4). row: Row to write.
        segment: x, y of both ends relative to the agent, m. velocity: m/s. radius: Of the agent, m. horizon: s.

    Returns:
        The next row.
    """
    ax, ay, bx, by = segment
    if ax * by - ay * bx > 0.0:  # the agent is to the right of the line from a to b
        ax, ay, bx, by = bx, by, ax, ay
    rate = 1.0 / horizon
    if is_covered(planes, row, rate * ax, rate * ay, rate * bx, rate * by, rate * radius):
        return row
    sx, sy = bx - ax, by - ay
    length = math.hypot(sx, sy)
    tx, ty = (sx / length, sy / length) if length > 0.0 else (0.0, 0.0)
    foot = -(ax * tx + ay * ty)
    aside = math.hypot(ax + foot * tx, ay + foot * ty) if length > 0.0 else math.hypot(ax, ay)
    is_point = length == 0.0 or (aside <= radius and not 0.0 <= foot <= length)
    if is_point and length > 0.0 and foot > length:
        ax, ay = bx, by
    if is_point:
        bx, by = ax, ay
    if (is_point and ax * ax + ay * ay <= radius * radius) or (not is_point and aside <= radius):
        # In contact: no velocity towards it.
        if is_point:
            size = math.hypot(ax, ay)
            tx, ty = (ay / size, -ax / size) if size > 0.0 else (1.0, 0.0)
        return put(planes, row, 0.0, 0.0, -tx, -ty)
    return put_border(planes, row, (ax, ay, bx, by), (tx, ty), is_point, velocity, radius, rate)


@njit(cache=True, nogil=True)
def put_border(
    planes: Floats, row: int, segment: tuple[float, float, float, float], along: tuple[float, float], is_point: bool,
    velocity: tuple[float, float], radius: float, rate: float,
) -> int:  # fmt: skip
    """The half plane of the part of a line's velocity obstacle that is nearest to a velocity; see put_line().

    Args:
        segment: Ends, m: a to the left as seen by the agent, b to the right. along: Unit vector from a to b.
        is_point: Whether both ends are one point. rate: 1 / horizon, 1/s.
    """
    ax, ay, bx, by = segment
    vx, vy = velocity
    square_a, square_b = ax * ax + ay * ay, bx * bx + by * by
    leg_a, leg_b = math.sqrt(square_a - radius * radius), math.sqrt(square_b - radius * radius)
    left_x, left_y = (ax * leg_a - ay * radius) / square_a, (ax * radius + ay * leg_a) / square_a
    right_x, right_y = (bx * leg_b + by * radius) / square_b, (by * leg_b - bx * radius) / square_b
    wide = radius * rate
    from_ax, from_ay, from_bx, from_by = vx - rate * ax, vy - rate * ay, vx - rate * bx, vy - rate * by
    on_left, on_right = from_ax * left_x + from_ay * left_y, from_bx * right_x + from_by * right_y
    front = rate * math.hypot(bx - ax, by - ay)
    on_front = 0.0 if is_point else from_ax * along[0] + from_ay * along[1]
    is_before_a, is_past_b = on_front < 0.0 and on_left < 0.0, on_front > front and on_right < 0.0
    if is_before_a or is_past_b or (is_point and on_left < 0.0 and on_right < 0.0):
        wx, wy, end_x, end_y = (from_bx, from_by, bx, by) if is_past_b else (from_ax, from_ay, ax, ay)
        size = math.hypot(wx, wy)
        nx, ny = (wx / size, wy / size) if size > 0.0 else (-ax / math.sqrt(square_a), -ay / math.sqrt(square_a))
        return put(planes, row, rate * end_x + wide * nx, rate * end_y + wide * ny, ny, -nx)
    to_front, to_left, to_right = np.inf, np.inf, np.inf
    if not is_point and 0.0 <= on_front <= front:
        to_front = abs(from_ax * along[1] - from_ay * along[0])
    if on_left >= 0.0:
        to_left = abs(from_ax * left_y - from_ay * left_x)
    if on_right >= 0.0:
        to_right = abs(from_bx * right_y - from_by * right_x)
    if to_front <= to_left and to_front <= to_right:
        dx, dy, end_x, end_y = -along[0], -along[1], ax, ay
    elif to_left <= to_right:
        dx, dy, end_x, end_y = left_x, left_y, ax, ay
    else:
        dx, dy, end_x, end_y = -right_x, -right_y, bx, by
    return put(planes, row, rate * end_x - wide * dy, rate * end_y + wide * dx, dx, dy)

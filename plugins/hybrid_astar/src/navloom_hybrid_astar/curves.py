"""Cheapest curves between two poses: Reeds-Shepp, Dubins, and turn, straight, turn for robots that turn in place.

All poses here are relative: the start is at the origin with heading 0, and lengths are in turn radii. A curve is up to
five moves; a move is a row of turn (1 left, 0 straight, -1 right), signed length (negative backwards) and angle of a
turn in place, rad, which has no length.

Sources: Reeds & Shepp 1990, *Optimal paths for a car that goes both forwards and backwards*, Pacific J. Math. 145(2),
formulas 8.1 to 8.11 with the transforms time flip, reflection and backwards of section 8: 48 words; Dubins 1957.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from navloom_hybrid_astar.compiled import compiled

__all__ = ["MOVES", "Costs", "cheapest_curve", "wrapped"]

Floats = NDArray[np.float64]
Costs = tuple[float, float, float, bool]
"""Extra cost of each length backwards, cost of a change of direction, cost of each rad turned in place (infinite for a
robot that cannot), all in turn radii, and whether driving backwards is allowed."""

MOVES = 5
"""Most moves of a curve."""
_QUARTER = 0.5 * math.pi
_TOUCH = 1e-9
"""Rounding below which a length counts as none, turn radii."""

_LSL, _LSR, _LRL = (1, 0, 1, 0, 0), (1, 0, -1, 0, 0), (1, -1, 1, 0, 0)
_RSL = (-1, 0, 1, 0, 0)
_LRLR, _LRSL, _LRSR = (1, -1, 1, -1, 0), (1, -1, 0, 1, 0), (1, -1, 0, -1, 0)
_LSRL, _RSRL, _LRSLR = (1, 0, -1, 1, 0), (-1, 0, -1, 1, 0), (1, -1, 0, 1, -1)


@compiled
def wrapped(angle: float) -> float:
    """An angle in [-π, π), rad."""
    return float((angle + math.pi) % (2.0 * math.pi) - math.pi)


@compiled
def cheapest_curve(x: float, y: float, heading: float, costs: Costs, moves: Floats) -> float:
    """The cheapest curve to a pose, without obstacles. With costs of 0, it is the shortest.

    Args:
        x, y, heading: The pose, turn radii and rad.
        costs: See `Costs`.
        moves: (MOVES, 3) turn, signed length, angle in place of each move; filled. Unused rows are 0.

    Returns:
        The cost, turn radii.
    """
    best, heading = np.inf, wrapped(heading)
    if costs[3]:
        best = _reeds_shepp(x, y, heading, costs, moves, best)
    else:
        best = _dubins(x, y, heading, costs, moves, best)
    if math.isfinite(costs[2]):
        best = _turn_straight_turn(x, y, heading, costs, moves, best)
    return best


@compiled
def _offer(
    turns: tuple[int, int, int, int, int], a: float, b: float, c: float, d: float, e: float, way: float, side: float,
    costs: Costs, moves: Floats, best: float,
) -> float:  # fmt: skip
    """Keep a word if it is cheaper than the best so far: `way` -1 flips time, `side` -1 reflects. Returns the best."""
    cost, before = 0.0, 0.0
    for length in (a, b, c, d, e):
        if abs(length) <= _TOUCH:
            continue
        ahead = way * length > 0.0
        cost += abs(length) * (1.0 if ahead else 1.0 + costs[0])
        if before * length < 0.0:
            cost += costs[1]
        before = length
    if not cost < best - _TOUCH:
        return best
    moves[:] = 0.0
    for n, length in enumerate((a, b, c, d, e)):
        moves[n, 0], moves[n, 1] = side * turns[n], way * length
    return cost


@compiled
def _polar(x: float, y: float) -> tuple[float, float]:
    return math.hypot(x, y), math.atan2(y, x)


@compiled
def _left_straight_left(x: float, y: float, heading: float) -> tuple[bool, float, float, float]:
    """Formula 8.1: L+ S+ L+."""
    u, t = _polar(x - math.sin(heading), y - 1.0 + math.cos(heading))
    v = wrapped(heading - t)
    return t >= -_TOUCH and v >= -_TOUCH, t, u, v


@compiled
def _left_straight_right(x: float, y: float, heading: float) -> tuple[bool, float, float, float]:
    """Formula 8.2: L+ S+ R+."""
    away, angle = _polar(x + math.sin(heading), y - 1.0 - math.cos(heading))
    if away < 2.0:
        return False, 0.0, 0.0, 0.0
    u = math.sqrt(away * away - 4.0)
    t = wrapped(angle + math.atan2(2.0, u))
    v = wrapped(t - heading)
    return t >= -_TOUCH and v >= -_TOUCH, t, u, v


@compiled
def _left_right_left(x: float, y: float, heading: float) -> tuple[bool, float, float, float]:
    """Formulas 8.3 and 8.4: L+ R- L, with the last arc either way."""
    away, angle = _polar(x - math.sin(heading), y - 1.0 + math.cos(heading))
    if away > 4.0:
        return False, 0.0, 0.0, 0.0
    u = -2.0 * math.asin(0.25 * away)
    t = wrapped(angle + 0.5 * u + math.pi)
    v = wrapped(heading - t + u)
    return t >= -_TOUCH and u <= _TOUCH, t, u, v


@compiled
def _tau_omega(u: float, v: float, xi: float, eta: float, heading: float) -> tuple[float, float]:
    """First and last arc of a word of four arcs."""
    delta = wrapped(u - v)
    a, b = math.sin(u) - math.sin(delta), math.cos(u) - math.cos(delta) - 1.0
    angle = math.atan2(eta * a - xi * b, xi * a + eta * b)
    if 2.0 * (math.cos(delta) - math.cos(v) - math.cos(u)) + 3.0 < 0.0:
        angle += math.pi
    tau = wrapped(angle)
    return tau, wrapped(tau - u + v - heading)


@compiled
def _four_arcs(x: float, y: float, heading: float) -> tuple[bool, float, float, float, bool, float, float, float]:
    """Formulas 8.7, L+ R+ L- R- with equal middle arcs, and 8.8, L+ R- L- R+."""
    xi, eta = x + math.sin(heading), y - 1.0 - math.cos(heading)
    away = math.hypot(xi, eta)
    first, t1, u1, v1 = False, 0.0, 0.0, 0.0
    rho = 0.25 * (2.0 + away)
    if rho <= 1.0:
        u1 = math.acos(rho)
        t1, v1 = _tau_omega(u1, -u1, xi, eta, heading)
        first = t1 >= -_TOUCH and v1 <= _TOUCH
    second, t2, u2, v2 = False, 0.0, 0.0, 0.0
    rho = (20.0 - away * away) / 16.0
    if 0.0 <= rho <= 1.0:
        u2 = -math.acos(rho)
        if u2 >= -_QUARTER:
            t2, v2 = _tau_omega(u2, u2, xi, eta, heading)
            second = t2 >= -_TOUCH and v2 >= -_TOUCH
    return first, t1, u1, v1, second, t2, u2, v2


@compiled
def _quarter_left(x: float, y: float, heading: float) -> tuple[bool, float, float, float]:
    """Formula 8.9: L+ R-(π/2) S- L-."""
    away, angle = _polar(x - math.sin(heading), y - 1.0 + math.cos(heading))
    if away < 2.0:
        return False, 0.0, 0.0, 0.0
    r = math.sqrt(away * away - 4.0)
    u = 2.0 - r
    t = wrapped(angle + math.atan2(r, -2.0))
    v = wrapped(heading - _QUARTER - t)
    return t >= -_TOUCH and u <= _TOUCH and v <= _TOUCH, t, u, v


@compiled
def _quarter_right(x: float, y: float, heading: float) -> tuple[bool, float, float, float]:
    """Formula 8.10: L+ R-(π/2) S- R-."""
    xi, eta = x + math.sin(heading), y - 1.0 - math.cos(heading)
    away, t = _polar(-eta, xi)
    if away < 2.0:
        return False, 0.0, 0.0, 0.0
    u = 2.0 - away
    v = wrapped(t + _QUARTER - heading)
    return t >= -_TOUCH and u <= _TOUCH and v <= _TOUCH, t, u, v


@compiled
def _two_quarters(x: float, y: float, heading: float) -> tuple[bool, float, float, float]:
    """Formula 8.11: L+ R-(π/2) S- L-(π/2) R+."""
    xi, eta = x + math.sin(heading), y - 1.0 - math.cos(heading)
    away = math.hypot(xi, eta)
    if away < 2.0:
        return False, 0.0, 0.0, 0.0
    u = 4.0 - math.sqrt(away * away - 4.0)
    if u > 0.0:
        return False, 0.0, 0.0, 0.0
    t = wrapped(math.atan2((4.0 - u) * xi - 2.0 * eta, -2.0 * xi + (u - 4.0) * eta))
    v = wrapped(t - heading)
    return t >= -_TOUCH and v >= -_TOUCH, t, u, v


@compiled
def _reeds_shepp(x: float, y: float, heading: float, costs: Costs, moves: Floats, best: float) -> float:
    """Offer all 48 words; returns the best cost."""
    q = _QUARTER
    back_x = x * math.cos(heading) + y * math.sin(heading)
    back_y = x * math.sin(heading) - y * math.cos(heading)
    for flip in range(2):
        for mirror in range(2):
            f, m = 1.0 - 2.0 * flip, 1.0 - 2.0 * mirror
            px, py, ph = f * x, m * y, f * m * heading
            ok, t, u, v = _left_straight_left(px, py, ph)
            if ok:
                best = _offer(_LSL, t, u, v, 0.0, 0.0, f, m, costs, moves, best)
            ok, t, u, v = _left_straight_right(px, py, ph)
            if ok:
                best = _offer(_LSR, t, u, v, 0.0, 0.0, f, m, costs, moves, best)
            ok, t, u, v = _left_right_left(px, py, ph)
            if ok:
                best = _offer(_LRL, t, u, v, 0.0, 0.0, f, m, costs, moves, best)
            ok, t, u, v, ok2, t2, u2, v2 = _four_arcs(px, py, ph)
            if ok:
                best = _offer(_LRLR, t, u, -u, v, 0.0, f, m, costs, moves, best)
            if ok2:
                best = _offer(_LRLR, t2, u2, u2, v2, 0.0, f, m, costs, moves, best)
            ok, t, u, v = _quarter_left(px, py, ph)
            if ok:
                best = _offer(_LRSL, t, -q, u, v, 0.0, f, m, costs, moves, best)
            ok, t, u, v = _quarter_right(px, py, ph)
            if ok:
                best = _offer(_LRSR, t, -q, u, v, 0.0, f, m, costs, moves, best)
            ok, t, u, v = _two_quarters(px, py, ph)
            if ok:
                best = _offer(_LRSLR, t, -q, u, -q, v, f, m, costs, moves, best)
            px, py = f * back_x, m * back_y  # backwards: from the goal to the start
            ok, t, u, v = _left_right_left(px, py, ph)
            if ok:
                best = _offer(_LRL, v, u, t, 0.0, 0.0, f, m, costs, moves, best)
            ok, t, u, v = _quarter_left(px, py, ph)
            if ok:
                best = _offer(_LSRL, v, u, -q, t, 0.0, f, m, costs, moves, best)
            ok, t, u, v = _quarter_right(px, py, ph)
            if ok:
                best = _offer(_RSRL, v, u, -q, t, 0.0, f, m, costs, moves, best)
    return best


@compiled
def _round(angle: float) -> float:
    """An angle in [0, 2π), rad; what is within rounding of 2π is 0."""
    angle %= 2.0 * math.pi
    return float(0.0 if angle > 2.0 * math.pi - _TOUCH else angle)


@compiled
def _dubins(x: float, y: float, heading: float, costs: Costs, moves: Floats, best: float) -> float:
    """Offer the six words of a robot that only drives forwards (Dubins 1957); returns the best cost."""
    for mirror in range(2):
        m = 1.0 - 2.0 * mirror
        py, ph = m * y, m * heading
        u, t = _polar(x - math.sin(ph), py - 1.0 + math.cos(ph))
        best = _offer(_LSL, _round(t), u, _round(ph - t), 0.0, 0.0, 1.0, m, costs, moves, best)
        away, angle = _polar(x + math.sin(ph), py - 1.0 - math.cos(ph))
        if away >= 2.0:
            u = math.sqrt(away * away - 4.0)
            t = angle + math.atan2(2.0, u)
            best = _offer(_LSR, _round(t), u, _round(t - ph), 0.0, 0.0, 1.0, m, costs, moves, best)
        away, angle = _polar(x - math.sin(ph), py - 1.0 + math.cos(ph))
        if away <= 4.0:
            u = 2.0 * math.pi - 2.0 * math.asin(0.25 * away)
            # The long middle arc: a shorter one is never the shortest word.
            t = angle + 0.5 * u
            best = _offer(_LRL, _round(t), u, _round(ph - t + u), 0.0, 0.0, 1.0, m, costs, moves, best)
    return best


@compiled
def _turn_straight_turn(x: float, y: float, heading: float, costs: Costs, moves: Floats, best: float) -> float:
    """Offer to turn towards the goal or away from it, drive straight, and turn to its heading; returns the best."""
    away, angle = _polar(x, y)
    if away <= _TOUCH:
        angle = 0.0
    for way in (1.0, -1.0):
        if way < 0.0 and not costs[3]:
            break
        first = wrapped(angle if way > 0.0 else angle + math.pi)
        last = wrapped(heading - first)
        cost = costs[2] * (abs(first) + abs(last)) + away * (1.0 if way > 0.0 else 1.0 + costs[0])
        if cost < best - _TOUCH:
            best = cost
            moves[:] = 0.0
            moves[0, 2], moves[1, 1], moves[2, 2] = first, way * away, last
    return best

"""Shorten a path of moves: join its poses by cheaper free curves, and shift the poses between curves.

Both keep the curvature within the radius, every heading continuous, and the footprint clear. Cusps are poses like
others and move with them. Lengths are in cells.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from navloom_hybrid_astar.clearance import Body, Ground, is_free
from navloom_hybrid_astar.compiled import compiled
from navloom_hybrid_astar.curves import MOVES, Costs
from navloom_hybrid_astar.motion import Motion, cost_of, curve_between, direction_at, is_curve_free, poses_after

__all__ = ["merged", "shortened", "split"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_MOST_POSES = 240
"""Poses of a path that are joined, at most: the time grows with the square."""
_GAIN = 0.01
"""Least gain of a change, cells."""
_SWEEPS = 12
"""Most sweeps over all poses with shifts of one size."""


def shortened(
    start: Floats, moves: Floats, ground: Ground, body: Body, motion: Motion, spacing: float, rounds: int
) -> Floats:
    """A path that costs no more, of a free path.

    Args:
        start: First pose (3,), cells and rad.
        moves: (n, 3).
        ground, body, motion: See there.
        spacing: Distance of the poses that are joined, cells.
        rounds: How often poses are joined and shifted.

    Returns:
        (m, 3) moves.
    """
    costs = motion.in_radii()
    for number in range(rounds):
        before = cost_of(moves, motion.reverse, motion.switch, motion.turn)
        rows = split(moves, max(spacing / (1 + number % 2), np.abs(moves[:, 1]).sum() / _MOST_POSES))
        pieces = _links(_joined(poses_after(start, rows), rows, ground, body, motion, costs))
        _shift(start, pieces, ground, body, motion, costs, 2.0 * spacing)
        moves = merged(pieces.reshape(-1, 3))
        if before - cost_of(moves, motion.reverse, motion.switch, motion.turn) < 1e-3 * before and number % 2:
            break
    return moves


def split(moves: Floats, spacing: float) -> Floats:
    """The same path with moves no longer than a spacing, cells."""
    rows = []
    for curvature, length, angle in moves.tolist():
        if length != 0.0:
            count = max(1, math.ceil(abs(length) / spacing - 1e-9))
            rows += [(curvature, length / count, 0.0)] * count
        if angle != 0.0:
            rows.append((0.0, 0.0, angle))
    return np.array(rows).reshape(-1, 3)


def merged(moves: Floats) -> Floats:
    """The same path with successive moves of one curvature and direction as one, and without empty ones."""
    rows: list[list[float]] = []
    for curvature, length, angle in moves.tolist():
        if length == 0.0 and angle == 0.0:
            continue
        last = rows[-1] if rows else [0.0, 0.0, 0.0]
        if length != 0.0 and last[2] == 0.0 and last[1] * length > 0.0 and abs(curvature - last[0]) < 1e-9:
            last[1] += length
        elif length == 0.0 and last[1] == 0.0 and last[2] != 0.0:
            last[2] += angle
        else:
            rows.append([curvature, length, angle])
    return np.array(rows).reshape(-1, 3)


def _links(pieces: Floats) -> Floats:
    """The same chain (n, MOVES, 3) with successive parts of one move as one link.

    Poses within a move would creep along it, hundreds of them for seconds.
    """
    links: list[Floats] = []
    for piece in pieces:
        moves = merged(piece)
        both = merged(np.concatenate([links[-1], moves])) if links else moves
        if links and len(both) == len(links[-1]) == 1:
            links[-1] = both
        elif len(moves):
            links.append(moves)
    chain = np.zeros((len(links), MOVES, 3))
    for link, moves in zip(chain, links, strict=True):
        link[: len(moves)] = moves
    return chain


@compiled
def _joined(poses: Floats, rows: Floats, ground: Ground, body: Body, motion: Motion, costs: Costs) -> Floats:
    """The cheapest chain of the path's own moves and of free curves between any two of its poses.

    Args:
        poses: (n + 1, 3).
        rows: (n, 3) moves between them.

    Returns:
        (m, MOVES, 3) moves of each link of the chain; empty rows are 0.
    """
    count = poses.shape[0]
    best, before, way = np.full(count, np.inf), np.zeros(count, np.int64), np.zeros(count)
    is_own = np.zeros(count, np.bool_)
    curve = np.zeros((MOVES, 3))
    best[0] = 0.0
    for last in range(1, count):
        own = rows[last - 1 : last]
        ahead = direction_at(own, False)
        best[last] = best[last - 1] + cost_of(own, motion.reverse, motion.switch, motion.turn)
        if way[last - 1] * ahead < 0.0:
            best[last] += motion.switch
        before[last], is_own[last] = last - 1, True
        way[last] = ahead if ahead != 0.0 else way[last - 1]
        for first in range(last - 1):
            if (
                best[first] + math.hypot(poses[last, 0] - poses[first, 0], poses[last, 1] - poses[first, 1])
                >= best[last] - _GAIN
            ):
                continue
            cost = best[first] + curve_between(poses[first], poses[last], motion.radius, costs, curve)
            if way[first] * direction_at(curve, False) < 0.0:
                cost += motion.switch
            if cost < best[last] - _GAIN and is_curve_free(poses[first], curve, ground, body):
                best[last], before[last], is_own[last] = cost, first, False
                end = direction_at(curve, True)
                way[last] = end if end != 0.0 else way[first]
    links, at = 0, count - 1
    while at > 0:
        links, at = links + 1, before[at]
    pieces, at = np.zeros((links, MOVES, 3)), count - 1
    for link in range(links - 1, -1, -1):
        if is_own[at]:
            for k in range(3):
                pieces[link, 0, k] = rows[at - 1, k]
        else:
            curve_between(poses[before[at]], poses[at], motion.radius, costs, pieces[link])
        at = before[at]
    return pieces


@compiled
def _shift(
    start: Floats, pieces: Floats, ground: Ground, body: Body, motion: Motion, costs: Costs, reach: float
) -> None:
    """Shift the poses between links along and across their heading and turn them while that makes the path cheaper.

    The shifts begin with `reach`, cells, and are halved down to a sixteenth of a cell. Changes `pieces` (n, MOVES, 3).
    """
    count = pieces.shape[0]
    keys = np.empty((count + 1, 3))
    keys[0] = start
    for n in range(count):
        keys[n + 1] = poses_after(keys[n], pieces[n])[MOVES]
    one, two, pose = np.zeros((MOVES, 3)), np.zeros((MOVES, 3)), np.empty(3)
    both, sweeps = np.zeros((2 * MOVES, 3)), 0
    while reach > 0.06:
        has_gained, sweeps = False, sweeps + 1
        for n in range(1, count):
            for direction in range(6):
                for _ in range(_SWEEPS):
                    offset = reach if direction % 2 == 0 else -reach
                    cosine, sine = math.cos(keys[n, 2]), math.sin(keys[n, 2])
                    pose[0], pose[1], pose[2] = keys[n, 0], keys[n, 1], keys[n, 2]
                    if direction < 2:
                        pose[0], pose[1] = pose[0] - sine * offset, pose[1] + cosine * offset
                    elif direction < 4:
                        pose[2] += offset / motion.radius
                    else:
                        pose[0], pose[1] = pose[0] + cosine * offset, pose[1] + sine * offset
                    both[:MOVES], both[MOVES:] = pieces[n - 1], pieces[n]
                    now = cost_of(both, motion.reverse, motion.switch, motion.turn)
                    cost = curve_between(keys[n - 1], pose, motion.radius, costs, one)
                    if cost >= now - _GAIN:
                        break
                    curve_between(pose, keys[n + 1], motion.radius, costs, two)
                    both[:MOVES], both[MOVES:] = one, two
                    cost = cost_of(both, motion.reverse, motion.switch, motion.turn)
                    if cost >= now - _GAIN or not is_free(pose[0], pose[1], pose[2], ground, body):
                        break
                    if not is_curve_free(keys[n - 1], one, ground, body) or not is_curve_free(pose, two, ground, body):
                        break
                    keys[n], pieces[n - 1], pieces[n], has_gained = pose, one, two, True
        if not has_gained or sweeps >= _SWEEPS:
            reach, sweeps = 0.5 * reach, 0

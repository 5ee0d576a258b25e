"""Rounds the corners of a polyline with continuous curvature: clothoid, arc, clothoid.

Along a fillet that turns by φ with smallest radius R, the curvature rises linearly from 0 to 1/R, stays there and falls
linearly to 0. `share` is the part of φ that the two clothoids turn: 1 is a pair of clothoids without arc, 0 would be a
plain arc, whose curvature (and so the turn rate of the robot) jumps. Its arc length is R φ (1 + share).

Only the radius is searched for: a fillet must fit between its neighbours and touch only free cells. If the fillet that
a robot can take at its slowest speed does not fit, the corner itself is moved outwards: a chain pulled tight around an
obstacle has free space there.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from navloom.navigation.line_of_sight import is_segment_free

__all__ = ["fillet_point", "fillet_shape", "fit_fillets", "move_corners", "stations", "turn_at", "warm_up"]

Floats = NDArray[np.float64]

_SHARES = (1.0, 0.6, 0.3)
"""Shares, tried in this order: a smaller one needs less room for the same radius but changes curvature faster."""
_SHRINK = 0.88
_SMALLEST = 1e-4
"""Radius at which the search for a free fillet gives up, m."""
_BLOCKED = 0.01
"""How far a corner in blocked cells is cut, m: the planner allowed it, although the grid does not."""
_STRAIGHT = 1e-7
"""Largest turn that counts as straight, rad."""
_SHORTEST = 0.30
"""Length of a fillet if there is room for it, m, so that a slight turn does not become a curvature spike."""
_STEP = 0.03
"""Longest chord of a fillet when it is checked against the grid, m; each half has at least four chords."""
_SHIFTS = 12
_FARTHEST = 0.6
"""Largest shift of a corner, m, reached in _SHIFTS steps."""


@njit(cache=True, nogil=True, error_model="numpy")
def _clothoid(length, rate):  # type: ignore[no-untyped-def]
    """End of a clothoid from the origin along x: series of the Fresnel integrals, to 1e-12 for angles up to π/2.

    x = s Σ (-θ²)^n / ((2n)! (4n + 1)), y = s θ Σ (-θ²)^n / ((2n + 1)! (4n + 3)), θ = rate s² / 2.
    """
    angle = 0.5 * rate * length * length
    x, y, term = 0.0, 0.0, 1.0
    for n in range(12):
        x += term / (4 * n + 1)
        term *= angle / (2 * n + 1)
        y += term / (4 * n + 3)
        term *= -angle / (2 * n + 2)
    return length * x, length * y, angle


@njit(cache=True, nogil=True, error_model="numpy")
def fillet_point(along, turn, share):  # type: ignore[no-untyped-def]
    """A point on the first half of the fillet of radius 1 that starts at the origin along x and turns left.

    Args:
        along: Arc length from its start, up to turn (1 + share) / 2.
        turn: rad, in (0, π).
        share: Part of the turn within the clothoids, in (0, 1].

    Returns:
        x, y, heading, rad, curvature: of the unit fillet.
    """
    spiral = turn * share
    if along <= spiral:
        x, y, heading = _clothoid(along, 1.0 / spiral)
        return x, y, heading, along / spiral
    x, y, heading = _clothoid(spiral, 1.0 / spiral)
    ahead = heading + along - spiral
    x += math.sin(ahead) - math.sin(heading)
    y += math.cos(heading) - math.cos(ahead)
    return x, y, ahead, 1.0


@njit(cache=True, nogil=True, error_model="numpy")
def fillet_shape(turn, share):  # type: ignore[no-untyped-def]
    """Size of the fillet of radius 1.

    Returns:
        Distance from its start to the corner (the same from the corner to its end), and from the corner to its middle.
    """
    x, y, _, _ = fillet_point(0.5 * turn * (1.0 + share), turn, share)
    return x + y * math.tan(0.5 * turn), y / math.cos(0.5 * turn)


@njit(cache=True, nogil=True, error_model="numpy")
def turn_at(corners, i):  # type: ignore[no-untyped-def]
    """Turn at corner i of a polyline (n, 2), rad in (-π, π], positive to the left; 0 at its ends."""
    if i <= 0 or i >= corners.shape[0] - 1:
        return 0.0
    ax, ay = corners[i, 0] - corners[i - 1, 0], corners[i, 1] - corners[i - 1, 1]
    bx, by = corners[i + 1, 0] - corners[i, 0], corners[i + 1, 1] - corners[i, 1]
    return math.atan2(ax * by - ay * bx, ax * bx + ay * by)


@njit(cache=True, nogil=True, error_model="numpy")
def _length(corners, i):  # type: ignore[no-untyped-def]
    """Length of segment i of a polyline, m."""
    dx, dy = corners[i + 1, 0] - corners[i, 0], corners[i + 1, 1] - corners[i, 1]
    return math.sqrt(dx * dx + dy * dy)


@njit(cache=True, nogil=True, error_model="numpy")
def _wanted_radius(turn, share, fast):  # type: ignore[no-untyped-def]
    """Radius for full speed, m; larger for a slight turn."""
    return max(fast, _SHORTEST / (turn * (1.0 + share)))


@njit(cache=True, nogil=True, error_model="numpy")
def _wanted_room(corners, i, fast):  # type: ignore[no-untyped-def]
    """How far the ideal fillet of corner i reaches along its segments, m."""
    turn = abs(turn_at(corners, i))
    if turn <= _STRAIGHT:
        return 0.0
    # The reach of a fillet grows without bound towards a turn of π; what exceeds this needs all the room there is.
    turn = min(turn, 3.0)
    return _wanted_radius(turn, 1.0, fast) * fillet_shape(turn, 1.0)[0]


@njit(cache=True, nogil=True, error_model="numpy")
def _room(corners, i, fast):  # type: ignore[no-untyped-def]
    """Length that corner i may use of each segment, m: shared with its neighbours in proportion to their needs."""
    own = _wanted_room(corners, i, fast)
    before = own / (own + _wanted_room(corners, i - 1, fast)) * _length(corners, i - 1)
    after = own / (own + _wanted_room(corners, i + 1, fast)) * _length(corners, i)
    return min(before, after)


@njit(cache=True, nogil=True, error_model="numpy")
def _is_fillet_free(corners, i, turn, share, radius, cells, frame):  # type: ignore[no-untyped-def]
    """Whether all chords of a fillet, from both its ends to its middle, touch only free cells."""
    reach = radius * fillet_shape(abs(turn), share)[0]
    half = 0.5 * abs(turn) * (1.0 + share)
    # At most 64: a chord of a wide fillet may be longer, since such a fillet bends little within one.
    chords = int(min(64.0, max(4.0, math.ceil(half * radius / _STEP))))
    for side in (-1, 1):
        length = _length(corners, i - 1 if side < 0 else i)
        ux, uy = (corners[i, 0] - corners[i + side, 0]) / length, (corners[i, 1] - corners[i + side, 1]) / length
        left = math.copysign(1.0, turn) * -side
        x_last, y_last = corners[i, 0] - reach * ux, corners[i, 1] - reach * uy
        x_start, y_start = x_last, y_last
        for k in range(1, chords + 1):
            x, y, _, _ = fillet_point(half * k / chords, abs(turn), share)
            x, y = x * radius, y * radius * left
            x_next, y_next = x_start + x * ux - y * uy, y_start + x * uy + y * ux
            if not is_segment_free(cells, frame[0], frame[1], frame[2], x_last, y_last, x_next, y_next):
                return False
            x_last, y_last = x_next, y_next
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def _fit(corners, i, cells, frame, slow, fast, beside):  # type: ignore[no-untyped-def]
    """Largest radius of corner i and its share: the smoothest share that reaches `slow`, else that with the most."""
    turn = turn_at(corners, i)
    best, best_share = 0.0, 1.0
    if abs(turn) <= _STRAIGHT or math.pi - abs(turn) <= _STRAIGHT:
        # Where the path reverses, no radius helps: the robot must turn in place.
        return (np.inf if abs(turn) <= _STRAIGHT else 0.0), 1.0
    room = _room(corners, i, fast)
    for share in _SHARES:
        reach, aside = fillet_shape(abs(turn), share)
        radius = min(_wanted_radius(abs(turn), share, fast), room / reach, beside / aside)
        while cells.size > 0 and radius > max(best, _SMALLEST):
            if _is_fillet_free(corners, i, turn, share, radius, cells, frame):
                break
            radius *= _SHRINK
        if radius > max(best, _SMALLEST):
            best, best_share = radius, share
        if best >= slow:
            break
    if best == 0.0:
        # No free fillet: the tightest share cuts least of a corner that the planner allowed.
        best_share = _SHARES[-1]
        reach, aside = fillet_shape(abs(turn), best_share)
        best = min(room / reach, _BLOCKED / aside)
    return best, best_share


@njit(cache=True, nogil=True, error_model="numpy")
def fit_fillets(corners, cells, frame, slow, fast, beside):  # type: ignore[no-untyped-def]
    """Radius and share of the fillet of each corner.

    Args:
        corners: (n, 2) polyline, m, in the frame of the grid.
        cells: (rows, cols) bool, True where the robot's centre may be; shape (0, 0): no grid, all is free.
        frame: (3,) resolution, and x, y of the lower left corner of cell (0, 0), m.
        slow, fast: Radii at which the robot can drive its lowest and its highest speed, m.
        beside: Largest distance of a fillet's middle from its corner, m; infinite with a grid.

        Returns:
            (n,) smallest radius, m, infinite for no turn, 0 where the path reverses; (n,) share.
    """
    count = corners.shape[0]
    radii, shares = np.full(count, np.inf), np.ones(count)
    for i in range(1, count - 1):
        radii[i], shares[i] = _fit(corners, i, cells, frame, slow, fast, beside)
    return radii, shares


@njit(cache=True, nogil=True, error_model="numpy")
def _move_out(corners, i, cells, frame, slow, fast):  # type: ignore[no-untyped-def]
    """Move corner i outwards until its fillet reaches the radius `slow` or is largest; both segments stay free."""
    x, y = corners[i, 0], corners[i, 1]
    before, after = _length(corners, i - 1), _length(corners, i)
    ux = (x - corners[i - 1, 0]) / before - (corners[i + 1, 0] - x) / after
    uy = (y - corners[i - 1, 1]) / before - (corners[i + 1, 1] - y) / after
    size = math.sqrt(ux * ux + uy * uy)
    # If the fillet is large enough where it is, the corner stays, because moving lengthens the path.
    best, _ = _fit(corners, i, cells, frame, slow, fast, np.inf)
    if best >= slow or size <= _STRAIGHT:
        return
    best_x, best_y = x, y
    for k in range(1, _SHIFTS + 1):
        # Fine steps first: in narrow places centimetres count.
        shift = _FARTHEST * (k / _SHIFTS) ** 2
        corners[i, 0], corners[i, 1] = x + shift * ux / size, y + shift * uy / size
        if not _are_arms_free(corners, i, cells, frame):
            # Free space outside a corner is taken to be connected: beyond the first blocked shift lies another passage.
            break
        radius, _ = _fit(corners, i, cells, frame, slow, fast, np.inf)
        # Each shift makes the path longer; a gain below 2 % does not pay for it.
        if radius > 1.02 * best:
            best, best_x, best_y = radius, corners[i, 0], corners[i, 1]
        if best >= slow:
            break
    corners[i, 0], corners[i, 1] = best_x, best_y


@njit(cache=True, nogil=True, error_model="numpy")
def _are_arms_free(corners, i, cells, frame):  # type: ignore[no-untyped-def]
    """Whether both segments of corner i touch only free cells."""
    for j in (i - 1, i):
        x0, y0, x1, y1 = corners[j, 0], corners[j, 1], corners[j + 1, 0], corners[j + 1, 1]
        if not is_segment_free(cells, frame[0], frame[1], frame[2], x0, y0, x1, y1):
            return False
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def move_corners(corners, cells, frame, slow, fast, sweeps):  # type: ignore[no-untyped-def]
    """A polyline whose corners leave more room for fillets; its ends stay. Arguments as in `fit_fillets`."""
    # The caller's corners are the planner's answer, which is also shown and recorded.
    moved = corners.copy()
    # A moved corner changes the room of its neighbours, so that the order of corners matters less with more sweeps.
    for _ in range(sweeps):
        for i in range(1, moved.shape[0] - 1):
            if abs(turn_at(moved, i)) > _STRAIGHT:
                _move_out(moved, i, cells, frame, slow, fast)
    return moved


@njit(cache=True, nogil=True, error_model="numpy")
def stations(corners, radii, shares):  # type: ignore[no-untyped-def]
    """(m, 3) for each corner: arc length where its fillet begins and ends, m, and its reach along the segments, m."""
    places = np.zeros((corners.shape[0], 3))
    for i in range(1, corners.shape[0]):
        turn = abs(turn_at(corners, i))
        reach = length = 0.0
        if 0.0 < radii[i] < np.inf and turn > 0.0:
            reach = radii[i] * fillet_shape(turn, shares[i])[0]
            length = radii[i] * turn * (1.0 + shares[i])
        dx, dy = corners[i, 0] - corners[i - 1, 0], corners[i, 1] - corners[i - 1, 1]
        start = places[i - 1, 1] + max(0.0, math.sqrt(dx * dx + dy * dy) - places[i - 1, 2] - reach)
        places[i, 0], places[i, 1], places[i, 2] = start, start + length, reach
    return places


def warm_up() -> None:
    """Compile the kernels."""
    corners, frame = np.array([[0.5, 0.5], [2.5, 0.5], [2.5, 2.5]]), np.array([1.0, 0.0, 0.0])
    cells = np.ones((3, 3), np.bool_)
    radii, shares = fit_fillets(move_corners(corners, cells, frame, 0.46, 0.92, 1), cells, frame, 0.46, 0.92, np.inf)
    stations(corners, radii, shares)

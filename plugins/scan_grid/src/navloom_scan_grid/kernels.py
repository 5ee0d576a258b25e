"""Kernels over scans and the grid: transform beams, mark the cells they cross, add cones, render values to publish."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from navloom_ipabd.track import interpolate
from numba import njit
from numpy.typing import NDArray

from navloom_scan_grid.models import beam_spans, cone_log_odds, probability

__all__ = ["Weights", "insert", "place", "render", "said_of", "span"]

_PASSED, _HIT = 1, 2
"""Marks of a cell; 0 is none."""
_WORD = 8
"""Cells in one 64-bit word, a byte each, so that empty ones are skipped together."""
CORE = 0.5
"""Share of a cone's opening round its axis in which it surely hears what is there."""
LIKELY = 0.25
"""Share of a cone's opening round its axis whose cells on the arc are the likeliest places of its echo."""
PER_ECHO, MOST, ON_ARC = 9, 49, 1
"""Readings that must see through a place to outweigh one echo; most that is held; what is left of an outweighed place.

`ON_ARC` also marks the other cells of an arc. Every cone can clear such a cell, and it is unknown as long as its log
odds are positive.
"""
HALF_DIAGONAL = math.sqrt(0.5)
"""Of a cell, in edges: an arc crosses cells whose centre is nearer to it."""
SAME_WAY = 7
"""Largest angle between two looks at a place that a smooth surface answers alike, in 1/256 of a turn: 10°."""
COS_SAME_WAY = math.cos(math.tau * SAME_WAY / 256.0)
SILENT_SHARE = 0.6
"""Share of the reach up to which a cone without an echo is believed: weaker echoes come from farther."""
NEAR = 1.0
"""Distance, m, from where an echo was heard within which its surface bounds what other cones see."""
SECTORS = 7
"""Sectors of a cone, each with its own bound."""


class Weights(NamedTuple):
    """Weights of the readings.

    Attributes:
        hit, passed: Log odds added by a beam to the cells at its echo (> 0) and before it (< 0).
        cone_hit, cone_passed: The largest log odds that a cone adds there; see `models.cone_log_odds`.
        lowest, highest: Limits of the log odds of a cell, so that its state can still change.
        thickness, clear_margin: See `models.beam_spans`, m.
        depth: See `models.cone_log_odds`, m.
        no_echo_clears: Whether a reading without an echo clears the cells before the sensor.
    """

    hit: float
    passed: float
    cone_hit: float
    cone_passed: float
    lowest: float
    highest: float
    thickness: float
    clear_margin: float
    depth: float
    no_echo_clears: bool


@njit(cache=True, nogil=True, error_model="numpy")
def span(values):  # type: ignore[no-untyped-def]
    """Smallest and largest of (n,) numbers, n >= 1."""
    least, greatest = values[0], values[0]
    for value in values:
        least, greatest = min(least, value), max(greatest, value)
    return least, greatest


@njit(cache=True, nogil=True, error_model="numpy")
def place(beams, times, track_offsets, track_poses, no_echo_from, limits, beyond):  # type: ignore[no-untyped-def]
    """Transforms beams to the map frame, and gives the area they can change and the number of readings of each kind.

    Args:
        beams: (n, 5) origin x, y, m; bearing, half angle, rad; reading, m; base frame.
        times: (n,) time of each beam, s after an epoch; (1,) if all were measured at once.
        track_offsets, track_poses: As in `track.interpolate`.
        no_echo_from: A reading of this or more counts as no echo, m.
        limits: Smallest reading and reach of the sensor, m.
        beyond: A beam affects cells up to this far behind its reading, m.

    Returns:
        (n, 6) apex x, y, m; cosine and sine of the axis; reading, m, +inf for none; half angle, rad; map frame.
        Lowest x, y, highest x, y, m, of the apexes and of the corners in which a cone's flanks meet the tangent at its
        tip. Number of readings: echoes, at the sensor's minimum, beyond the reach, no echo.
    """
    range_min, reach = limits
    count, poses = beams.shape[0], interpolate(times, track_offsets, track_poses)
    placed = np.empty((count, 6))
    low_x, low_y, high_x, high_y = np.inf, np.inf, -np.inf, -np.inf
    at_min, within, finite = 0, 0, 0
    for i in range(count):
        if i < poses.shape[0]:
            base_x, base_y, heading = poses[i]
            cos_t, sin_t = math.cos(heading), math.sin(heading)
        origin_x, origin_y, bearing, half_angle, reading = beams[i]
        if reading >= no_echo_from:
            reading = np.inf
        x, y = base_x + cos_t * origin_x - sin_t * origin_y, base_y + sin_t * origin_x + cos_t * origin_y
        cos_a, sin_a = math.cos(heading + bearing), math.sin(heading + bearing)
        placed[i, 0], placed[i, 1], placed[i, 2], placed[i, 3] = x, y, cos_a, sin_a
        placed[i, 4], placed[i, 5] = reading, half_angle
        far = min(reading, reach) + beyond
        sideways = far * math.tan(half_angle) if half_angle != 0.0 else 0.0
        tip_x, side_x, tip_y, side_y = x + far * cos_a, abs(sideways * sin_a), y + far * sin_a, abs(sideways * cos_a)
        low_x, high_x = min(low_x, x, tip_x - side_x), max(high_x, x, tip_x + side_x)
        low_y, high_y = min(low_y, y, tip_y - side_y), max(high_y, y, tip_y + side_y)
        at_min, within, finite = (
            at_min + (reading <= range_min),
            within + (reading <= reach),
            finite + (reading < np.inf),
        )
    return placed, (low_x, low_y, high_x, high_y), (within - at_min, at_min, finite - within, count - finite)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _added(before, value, lowest, highest):  # type: ignore[no-untyped-def]
    """Log odds of a cell plus a value, clipped to the limits; NaN, an unknown cell, counts as 0."""
    known = np.float64(before) if before == before else 0.0
    odds = known + value
    odds = lowest if odds < lowest else odds
    return np.float32(highest if odds > highest else odds)


def said_of(rows: int, columns: int) -> NDArray[np.uint64]:
    """Work array of `insert`: one byte per cell, eight to a word, all 0, with a margin of one row and one word.

    Rounding can put the end of a beam one cell outside the grid. The margin takes it, so no step needs a test.
    """
    return np.zeros((rows + 2, -(-columns // _WORD) + 2), np.uint64)


@njit(cache=True, nogil=True, error_model="numpy")
def _say(said, reached, shape, x0, y0, x1, y1, word):  # type: ignore[no-untyped-def]
    """Write a mark into all cells of a line (Amanatides & Woo 1987); a line that leaves the grid is skipped.

    The number of steps is the number of cell borders between the ends, so the line stops in the cell of its far end
    whatever the rounding. The ends are in cells, with (0, 0) the corner of the grid. `said` is the work array of
    `said_of` as flat bytes; `reached` holds the lowest and highest row and column of all lines so far.
    """
    column, row = math.floor(x0), math.floor(y0)
    last_column, last_row = math.floor(x1), math.floor(y1)
    low_row, high_row = min(row, last_row), max(row, last_row)
    low_column, high_column = min(column, last_column), max(column, last_column)
    if low_row < -1 or low_column < -1 or high_row > shape[0] or high_column > shape[1]:
        return
    reached[0], reached[1] = min(reached[0], low_row), max(reached[1], high_row)
    reached[2], reached[3] = min(reached[2], low_column), max(reached[3], high_column)
    stride = said.size // (shape[0] + 2)
    right, up = (1 if x1 >= x0 else -1), (stride if y1 >= y0 else -stride)
    dx, dy = abs(x1 - x0), abs(y1 - y0)
    # Fractions of the line at which it crosses the next border, times dx dy: this avoids a division by zero.
    to_column = dy * (column + 1.0 - x0 if right > 0 else x0 - column)
    to_row = dx * (row + 1.0 - y0 if up > 0 else y0 - row)
    left_columns, left_rows = high_column - low_column, high_row - low_row
    at = (row + 1) * stride + column + _WORD
    said[at] = word
    while left_columns > 0 and left_rows > 0:
        if to_column < to_row:
            at, to_column, left_columns = at + right, to_column + dy, left_columns - 1
        else:
            at, to_row, left_rows = at + up, to_row + dx, left_rows - 1
        said[at] = word
    step = right if left_columns > 0 else up
    for _ in range(left_columns + left_rows):
        at += step
        said[at] = word


@njit(cache=True, nogil=True, error_model="numpy")
def _say_beams(said, reached, shape, corner_x, corner_y, cell, placed, limits, weights):  # type: ignore[no-untyped-def]
    """Mark the cells of all beams of a scan: first as passed, then as hit, which overwrites passed."""
    range_min, reach = limits
    for word in (_PASSED, _HIT):
        for i in range(placed.shape[0]):
            cos_axis, sin_axis, reading, half_angle = placed[i, 2], placed[i, 3], placed[i, 4], placed[i, 5]
            if half_angle > 0.0 or (reading == np.inf and not weights.no_echo_clears):
                continue
            free, near, far = beam_spans(reading, range_min, reach, weights.thickness, weights.clear_margin)
            begin, end = (0.0, free) if word == _PASSED else (near, far)
            if end < begin or end == 0.0:
                continue
            x, y = (placed[i, 0] - corner_x) / cell, (placed[i, 1] - corner_y) / cell
            begin, end = begin / cell, end / cell
            _say(said, reached, shape, x + begin * cos_axis, y + begin * sin_axis, x + end * cos_axis,
                 y + end * sin_axis, word)  # fmt: skip


@njit(cache=True, nogil=True, error_model="numpy")
def _tell(odds, said, weights):  # type: ignore[no-untyped-def]
    """Add the marks of part of a row to its log odds. Without a branch, so that the compiler can vectorize it."""
    for i in range(odds.size):
        value = weights.hit if said[i] == _HIT else weights.passed
        odds[i] = _added(odds[i], value, weights.lowest, weights.highest) if said[i] != 0 else odds[i]


@njit(cache=True, nogil=True, error_model="numpy")
def _tell_all(odds, words, said, reached, weights):  # type: ignore[no-untyped-def]
    """Add the marks to the log odds, from the first to the last marked row, and clear them."""
    rows, columns = odds.shape
    first_word, after_word = max(0, reached[2]) // _WORD + 1, min(columns - 1, reached[3]) // _WORD + 2
    for row in range(max(0, reached[0]), min(rows - 1, reached[1]) + 1):
        line, first, after = words[row + 1], first_word, after_word
        while first < after and line[first] == 0:
            first += 1
        while after > first and line[after - 1] == 0:
            after -= 1
        if first < after:
            begin, end = _WORD * (first - 1), min(_WORD * (after - 1), columns)
            _tell(odds[row, begin:end], said[row + 1, begin + _WORD : end + _WORD], weights)
            line[first:after] = 0


@njit(cache=True, nogil=True, error_model="numpy")
def _bounds(cone, echoes, reach, depth, found):  # type: ignore[no-untyped-def]
    """Distances, m, up to which a cone can show free space, by sector from its right flank to its left, into `found`.

    A smooth surface answers only where the sound meets it squarely. So an echo shows a surface across its axis, and a
    cone that meets the same surface at an angle would be silent, or hear something else behind the robot's room.
    An echo of the cone's own direction sets no bound: the new reading is the later look at the same surface.

    Args:
        cone: (6,) as a row of `placed` in `insert`.
        echoes: (k, 6) cones that had an echo lately; +inf where there is none.
        reach: m.
        depth: Half the depth of an echo's arc, m: another cone clears none of it.
        found: (SECTORS,) filled.
    """
    x, y, cos_axis, sin_axis, reading, half_angle = cone
    for sector in range(found.size):
        found[sector] = SILENT_SHARE * reach if reading == np.inf else reach
        turn = half_angle * ((2.0 * sector + 1.0) / found.size - 1.0)
        way_x = cos_axis * math.cos(turn) - sin_axis * math.sin(turn)
        way_y = sin_axis * math.cos(turn) + cos_axis * math.sin(turn)
        for k in range(echoes.shape[0]):
            dx, dy = echoes[k, 0] - x, echoes[k, 1] - y
            toward = way_x * echoes[k, 2] + way_y * echoes[k, 3]
            is_other = cos_axis * echoes[k, 2] + sin_axis * echoes[k, 3] < COS_SAME_WAY
            if is_other and dx * dx + dy * dy <= NEAR * NEAR and toward > 0.0:
                away = dx * echoes[k, 2] + dy * echoes[k, 3] + echoes[k, 4] - depth
                found[sector] = min(found[sector], max(0.0, away) / toward)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _way(dx, dy):  # type: ignore[no-untyped-def]
    """Direction of a vector in 1/256 of a turn."""
    return math.floor(math.atan2(dy, dx) / math.tau * 256.0) % 256


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _speaks_against(heard_way, way, is_core, is_silent):  # type: ignore[no-untyped-def]
    """Whether a cone that shows no echo at a place speaks against the echo that was heard from it.

    Only its core does: flanks hear little. Silence does only in the direction of that echo, since a smooth surface
    sends the sound of other directions away.
    """
    return is_core and (not is_silent or abs((way - heard_way + 128) % 256 - 128) <= SAME_WAY)


@njit(cache=True, nogil=True, error_model="numpy")
def _insert_cone(odds, heard, bounds, x, y, cone, cell, limits, weights):  # type: ignore[no-untyped-def]
    """Add the log odds of one cone to every cell whose centre lies in it; apex x, y in cells, lengths in m.

    An echo has one cause, somewhere on its arc, and not in a cell that other readings have shown to be free. So the
    value for a cell known to be free is multiplied by its odds and divided by those of the likeliest cell of the arc:
    the "cancel" and "normalize" of Moravec & Elfes 1985, in log odds. Without it, the arcs of a moving ring smear every
    post over metres.

    The cells of an arc near its axis, the likeliest places of the echo, are cleared only by what `_speaks_against` it,
    its other cells by every cone: protecting the whole arc would keep the free space beside walls unknown, which
    oblique cones hear. No cone clears beyond its `bounds`. A silent cone clears nothing behind a cell with an echo, and
    nothing more than once: cells beyond a surface that no sonar has heard yet must not count as surely free.
    """
    (range_min, reach), (rows, columns) = limits, odds.shape
    cos_axis, sin_axis, reading, half_angle = cone[2], cone[3], cone[4], cone[5]
    is_silent = reading == np.inf
    far = (min(reading, reach) + weights.depth) / (cell * math.cos(half_angle))
    sin_h, cos_h = math.sin(half_angle), math.cos(half_angle)
    ex, ey = cos_axis * cos_h - sin_axis * sin_h, sin_axis * cos_h + cos_axis * sin_h
    fx, fy = cos_axis * cos_h + sin_axis * sin_h, sin_axis * cos_h - cos_axis * sin_h
    first_column = max(0, math.floor(x + far * min(0.0, ex, fx)))
    last_column = min(columns - 1, math.floor(x + far * max(0.0, ex, fx)))
    first_row = max(0, math.floor(y + far * min(0.0, ey, fy)))
    last_row = min(rows - 1, math.floor(y + far * max(0.0, ey, fy)))
    likeliest, nearest_heard = -np.inf, np.inf
    for is_adding in (False, True):
        for row in range(first_row, last_row + 1):
            dy = cell * (row + 0.5 - y)
            for column in range(first_column, last_column + 1):
                dx = cell * (column + 0.5 - x)
                along, across = dx * cos_axis + dy * sin_axis, dy * cos_axis - dx * sin_axis
                if along * sin_h <= abs(across) * cos_h:
                    continue
                distance, place = math.sqrt(dx * dx + dy * dy), heard[row, column]
                known_free = min(0.0, odds[row, column]) if odds[row, column] == odds[row, column] else 0.0
                if not is_adding:
                    likeliest = max(likeliest, known_free) if abs(distance - reading) < weights.depth else likeliest
                    if is_silent and place[0] > 0:
                        nearest_heard = min(nearest_heard, distance - weights.depth)
                    continue
                angle = math.atan2(across, along)
                value = cone_log_odds(distance, abs(angle), reading, half_angle, range_min, reach, weights.depth,
                                      weights.cone_hit, weights.cone_passed)  # fmt: skip
                is_core = abs(angle) < CORE * half_angle
                sector = min(SECTORS - 1, int(0.5 * (angle / half_angle + 1.0) * SECTORS))
                if value > 0.0:
                    value *= math.exp(known_free - likeliest)
                    if abs(angle) < LIKELY * half_angle and abs(distance - reading) < HALF_DIAGONAL * cell:
                        place[0], place[1] = min(MOST, max(place[0], ON_ARC) + PER_ECHO), _way(dx, dy)
                elif distance > bounds[sector]:
                    value = 0.0
                elif value < 0.0 and place[0] > ON_ARC:
                    if _speaks_against(place[1], _way(dx, dy), is_core, is_silent):
                        place[0] -= 1
                    else:
                        value = 0.0
                elif distance > nearest_heard:
                    value = 0.0
                if value != 0.0:
                    once = min(weights.cone_passed, known_free) if is_silent else weights.lowest
                    after = _added(odds[row, column], value, max(weights.lowest, once), weights.highest)
                    odds[row, column] = after
                    if after > 0.0 and value > 0.0:
                        place[0] = max(place[0], ON_ARC)
                    elif after <= 0.0 and place[0] == ON_ARC:
                        place[0] = 0


@njit(cache=True, nogil=True, error_model="numpy")
def insert(odds, heard, echoes, words, corner_x, corner_y, cell, placed, limits, weights):  # type: ignore[no-untyped-def]
    """Add one scan to the grid.

    Each cell is changed once by all beams of a scan, and an echo outweighs beams that passed: neighbouring beams are
    one observation, and dozens of them cross a cell near the sensor. So the beams first mark the cells, and the marks
    are then added to the log odds. The cones of a ring have different origins, so each of them counts.

    Args:
        odds: (rows, columns) float32 log odds, NaN for unknown, changed in place; must cover the whole scan.
        heard: (rows, columns, 2) uint8, changed in place: 0 without an echo of a cone, else `ON_ARC` plus the readings
            that must see through the cell; the direction in which the last was heard, in 1/256 of a turn.
        echoes: (k, 6) rows of `placed`, changed in place: the last echoes of cones, newest first; +inf for none.
        words: Work array of `said_of`; all 0 again afterwards, except in the margin.
        corner_x, corner_y: Lower left corner of the grid, m, map frame.
        cell: Edge of a cell, m.
        placed: (n, 6) apex x, y, m; cosine and sine of the axis; reading, m; half angle, rad; map frame.
        limits: Smallest reading and reach of the sensor, m.
        weights: Weights of the readings.
    """
    said, reached = words.view(np.uint8), np.array([odds.shape[0], -1, odds.shape[1], -1])
    _say_beams(said.reshape(-1), reached, odds.shape, corner_x, corner_y, cell, placed, limits, weights)
    _tell_all(odds, words, said, reached, weights)
    is_cone = placed[:, 5] > 0.0
    for i in np.flatnonzero(is_cone & (placed[:, 4] <= limits[1])):
        echoes[1:] = echoes[:-1].copy()
        echoes[0] = placed[i]
    bounds = np.empty(SECTORS)
    for i in np.flatnonzero(is_cone):
        if placed[i, 4] < np.inf or weights.no_echo_clears:
            _bounds(placed[i], echoes, limits[1], weights.depth, bounds)
            x, y = (placed[i, 0] - corner_x) / cell, (placed[i, 1] - corner_y) / cell
            _insert_cone(odds, heard, bounds, x, y, placed[i], cell, limits, weights)


@njit(cache=True, nogil=True, error_model="numpy")
def render(odds, heard, occupied_from, is_ternary):  # type: ignore[no-untyped-def]
    """(rows, columns) int8 values to publish: -1 unknown, else percent, or 100 from `occupied_from` on and 0 below.

    A place with an echo that is neither sure nor outweighed, see `insert`, is unknown: it must not look free. So is the
    rest of an arc where nothing has outweighed it: behind walls, flanks leave small positive log odds.
    """
    cells = np.empty(odds.shape, np.int8)
    for row in range(odds.shape[0]):
        for column in range(odds.shape[1]):
            value, left = odds[row, column], heard[row, column, 0]
            is_unsure = left > ON_ARC or (left == ON_ARC and value > 0.0)
            if value != value or (is_unsure and value < occupied_from):
                cells[row, column] = -1
            elif is_ternary:
                cells[row, column] = 100 if value >= occupied_from else 0
            else:
                cells[row, column] = math.floor(100.0 * probability(value) + 0.5)
    return cells

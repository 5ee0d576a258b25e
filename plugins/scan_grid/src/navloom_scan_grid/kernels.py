"""The passes over the grid: beams by integer traversal, cones cell by cell, and log odds to published values."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from navloom_scan_grid.models import beam_spans, cone_log_odds, probability

__all__ = ["Weights", "insert", "render"]


class Weights(NamedTuple):
    """What readings count.

    Attributes:
        hit, passed: Log odds added by a beam to the cells at its echo (> 0) and before it (< 0).
        cone_hit, cone_passed: The same of a cone, at most; see `models.cone_log_odds`.
        lowest, highest: What log odds are kept within, so that a cell can change its mind.
        thickness, clear_margin: See `models.beam_spans`, m.
        depth: See `models.cone_log_odds`, m.
        no_echo_clears: Whether a reading without an echo frees what lies before the sensor.
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


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _add(odds, row, column, value, lowest, highest):  # type: ignore[no-untyped-def]
    """Add to a cell, within the limits; NaN is a cell nothing is known of."""
    before = odds[row, column]
    if before != before:
        before = np.float32(0.0)
    odds[row, column] = min(max(before + value, lowest), highest)


@njit(cache=True, nogil=True, error_model="numpy")
def _walk(odds, marks, mark, x0, y0, x1, y1, value, lowest, highest):  # type: ignore[no-untyped-def]
    """Add to all cells of a line that were not yet spoken of in this scan (Amanatides & Woo 1987).

    As many steps as there are cell borders between the ends, so that it stops in the cell of the far end whatever the
    rounding. Ends in cells, with (0, 0) the corner of the grid.
    """
    rows, columns = odds.shape
    column, row = math.floor(x0), math.floor(y0)
    last_column, last_row = math.floor(x1), math.floor(y1)
    right, up = (1 if x1 >= x0 else -1), (1 if y1 >= y0 else -1)
    dx, dy = abs(x1 - x0), abs(y1 - y0)
    # Shares of the line, times dx dy, at which it crosses the next border; products spare the divisions by zero.
    to_column = dy * (column + 1.0 - x0 if right > 0 else x0 - column)
    to_row = dx * (row + 1.0 - y0 if up > 0 else y0 - row)
    left_columns, left_rows = abs(last_column - column), abs(last_row - row)
    while True:
        if 0 <= row < rows and 0 <= column < columns and marks[row, column] < mark:
            marks[row, column] = mark
            _add(odds, row, column, value, lowest, highest)
        if left_columns > 0 and (left_rows == 0 or to_column < to_row):
            column, to_column, left_columns = column + right, to_column + dy, left_columns - 1
        elif left_rows > 0:
            row, to_row, left_rows = row + up, to_row + dx, left_rows - 1
        else:
            return


@njit(cache=True, nogil=True, error_model="numpy")
def _insert_cone(odds, x, y, cos_axis, sin_axis, reading, half_angle, cell, limits, weights):  # type: ignore[no-untyped-def]
    """Add what one cone says to every cell whose centre lies in it; apex in cells, lengths in m.

    An echo has one cause, somewhere on its arc, and that is not where another reading has seen through. So a cell
    known to be free gets its part times its odds, over those of the arc's likeliest cell: the "cancel" and "normalize"
    of Moravec & Elfes 1985, in log odds. Without it the arcs of a moving ring smear every post over metres.
    """
    range_min, reach = limits
    rows, columns = odds.shape
    far = (min(reading, reach) + weights.depth) / (cell * math.cos(half_angle))
    sin_h, cos_h = math.sin(half_angle), math.cos(half_angle)
    ex, ey = cos_axis * cos_h - sin_axis * sin_h, sin_axis * cos_h + cos_axis * sin_h
    fx, fy = cos_axis * cos_h + sin_axis * sin_h, sin_axis * cos_h - cos_axis * sin_h
    first_column = max(0, math.floor(x + far * min(0.0, ex, fx)))
    last_column = min(columns - 1, math.floor(x + far * max(0.0, ex, fx)))
    first_row = max(0, math.floor(y + far * min(0.0, ey, fy)))
    last_row = min(rows - 1, math.floor(y + far * max(0.0, ey, fy)))
    likeliest = -np.inf
    for is_adding in (False, True):
        for row in range(first_row, last_row + 1):
            dy = cell * (row + 0.5 - y)
            for column in range(first_column, last_column + 1):
                dx = cell * (column + 0.5 - x)
                along, across = dx * cos_axis + dy * sin_axis, abs(dy * cos_axis - dx * sin_axis)
                if along * sin_h <= across * cos_h:
                    continue
                distance = math.sqrt(dx * dx + dy * dy)
                is_on_arc = abs(distance - reading) < weights.depth
                known_free = min(0.0, odds[row, column]) if odds[row, column] == odds[row, column] else 0.0
                if not is_adding:
                    likeliest = max(likeliest, known_free) if is_on_arc else likeliest
                    continue
                value = cone_log_odds(distance, math.atan2(across, along), reading, half_angle, range_min, reach,
                                      weights.depth, weights.cone_hit, weights.cone_passed)  # fmt: skip
                if value > 0.0:
                    value *= math.exp(known_free - likeliest)
                if value != 0.0:
                    _add(odds, row, column, value, weights.lowest, weights.highest)


@njit(cache=True, nogil=True, error_model="numpy")
def insert(odds, marks, mark, corner_x, corner_y, cell, placed, limits, weights):  # type: ignore[no-untyped-def]
    """Take one scan into the grid.

    Of all beams of a scan a cell is told one thing once, and an echo counts before what saw through: neighbouring
    beams are one look at the world, and near the sensor a cell is crossed by dozens. Cones of a ring look from
    different places, and each is counted.

    Args:
        odds: (rows, columns) float32 log odds, NaN for unknown, in place.
        marks: (rows, columns) int32, for the work; all below `mark`.
        mark: Larger than that of any scan before.
        corner_x, corner_y: Lower left corner of the grid, m, map frame.
        cell: Edge of a cell, m.
        placed: (n, 6) apex x, y, m; cosine and sine of the axis; reading, m; half angle, rad; map frame.
        limits: Least reading and reach of the sensor, m.
        weights: See there.
    """
    range_min, reach = limits
    count = placed.shape[0]
    for is_free in (False, True):
        for i in range(count):
            x, y = (placed[i, 0] - corner_x) / cell, (placed[i, 1] - corner_y) / cell
            cos_axis, sin_axis, reading, half_angle = placed[i, 2], placed[i, 3], placed[i, 4], placed[i, 5]
            if half_angle > 0.0 or (reading == np.inf and not weights.no_echo_clears):
                continue
            free, near, far = beam_spans(reading, range_min, reach, weights.thickness, weights.clear_margin)
            if is_free:
                begin, end, value = 0.0, free, weights.passed
            else:
                begin, end, value = near, far, weights.hit
            if end < begin or end == 0.0:
                continue
            begin, end = begin / cell, end / cell
            _walk(odds, marks, mark, x + begin * cos_axis, y + begin * sin_axis, x + end * cos_axis,
                  y + end * sin_axis, value, weights.lowest, weights.highest)  # fmt: skip
    for i in range(count):
        if placed[i, 5] > 0.0 and (placed[i, 4] < np.inf or weights.no_echo_clears):
            x, y = (placed[i, 0] - corner_x) / cell, (placed[i, 1] - corner_y) / cell
            _insert_cone(odds, x, y, placed[i, 2], placed[i, 3], placed[i, 4], placed[i, 5], cell, limits, weights)


@njit(cache=True, nogil=True, error_model="numpy")
def render(odds, occupied_from, is_ternary):  # type: ignore[no-untyped-def]
    """(rows, columns) int8 of log odds: -1 unknown, else percent; or 100 from `occupied_from` log odds on, 0 below."""
    cells = np.empty(odds.shape, np.int8)
    for row in range(odds.shape[0]):
        for column in range(odds.shape[1]):
            value = odds[row, column]
            if value != value:
                cells[row, column] = -1
            elif is_ternary:
                cells[row, column] = 100 if value >= occupied_from else 0
            else:
                cells[row, column] = math.floor(100.0 * probability(value) + 0.5)
    return cells

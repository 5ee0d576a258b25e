"""Certainty grid of the improved VFH: a window of cells that follows the robot (Hoang et al. 2013, III.C, Fig. 5).

The window is aligned with the axes of the pose frame and moves by whole cells, so that obstacles keep their place while
the robot drives and turns. Values are *assigned* by the sensors, not counted up as in the original VFH: 3 on the
acoustic axis, 2 on the rest of the arc, 0 in the cone nearer than the echo.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from navloom_avoidance.clearance import outside_distance
from navloom_avoidance.support import age_record, has_support

AXIS_CERTAINTY = 3
ARC_CERTAINTY = 2
Cells = NDArray[np.uint8] | NDArray[np.int64]
"""(size, size) window of certainties, or a record of echoes."""
THIN_BEAM = 0.02  # rad: narrower beams are lines, since their cone would miss the cell centres


def new_window(size: int) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
    """Empty window.

    Returns:
        grid: (size, size) uint8, certainty 0, 2 or 3; rows along y, columns along x of the pose frame.
        origin: (2,) int64, column and row of grid[0, 0], counted in cells from the origin of the pose frame.
    """
    return np.zeros((size, size), np.uint8), np.zeros(2, np.int64)


@njit(cache=True, nogil=True)
def scroll_window(grid: Cells, origin: NDArray[np.int64], x: float, y: float, cell: float) -> None:
    """Move the window, in place and by whole cells, until the robot is in its middle cell; new cells are 0.

    Args:
        grid, origin: As from new_window().
        x, y: Position of the robot, m, pose frame.
        cell: Side of a cell, m.
    """
    size = grid.shape[0]
    column = math.floor(x / cell) - size // 2
    row = math.floor(y / cell) - size // 2
    dc, dr = column - origin[0], row - origin[1]
    if dc == 0 and dr == 0:
        return
    origin[0], origin[1] = column, row
    if abs(dc) >= size or abs(dr) >= size:
        grid[:, :] = 0
        return
    for k in range(size):
        r = k if dr >= 0 else size - 1 - k
        for i in range(size):
            c = i if dc >= 0 else size - 1 - i
            inside = 0 <= r + dr < size and 0 <= c + dc < size
            grid[r, c] = grid[r + dr, c + dc] if inside else 0


@njit(cache=True, nogil=True)
def clear_cone(
    grid: Cells,
    origin: NDArray[np.int64],
    cell: float,
    apex: tuple[float, float],
    axis: tuple[float, float],
    half_angle: float,
    near: float,
    far: float,
    margin: float,
) -> None:
    """Set cells to 0 whose centre is in a cone, between two distances from its apex.

    Args:
        grid, origin, cell: Window, in place, and side of a cell, m.
        apex: Position of the sensor, m, pose frame.
        axis: Unit vector of the acoustic axis, pose frame.
        half_angle: rad, < pi/2.
        near, far: Distances from the apex, m; `near` itself is included.
        margin: Distance kept from the flanks of the cone, m: in a cell on the flank, the sensor may miss an obstacle.
    """
    size = grid.shape[0]
    cos_h, sin_h = math.cos(half_angle), math.sin(half_angle)
    # The tangent at the middle of the arc meets the flanks outside the arc: these corners bound the cone.
    reach = far / cos_h
    ex, ey = axis[0] * cos_h - axis[1] * sin_h, axis[1] * cos_h + axis[0] * sin_h
    fx, fy = axis[0] * cos_h + axis[1] * sin_h, axis[1] * cos_h - axis[0] * sin_h
    left = (apex[0] + reach * min(0.0, ex, fx)) / cell - origin[0]
    right = (apex[0] + reach * max(0.0, ex, fx)) / cell - origin[0]
    low = (apex[1] + reach * min(0.0, ey, fy)) / cell - origin[1]
    high = (apex[1] + reach * max(0.0, ey, fy)) / cell - origin[1]
    c0, c1 = max(0, math.floor(left)), min(size - 1, math.floor(right))
    r0, r1 = max(0, math.floor(low)), min(size - 1, math.floor(high))
    for r in range(r0, r1 + 1):
        dy = (origin[1] + r + 0.5) * cell - apex[1]
        for c in range(c0, c1 + 1):
            dx = (origin[0] + c + 0.5) * cell - apex[0]
            along = dx * axis[0] + dy * axis[1]
            across = abs(dy * axis[0] - dx * axis[1])
            square = dx * dx + dy * dy
            if along * sin_h - across * cos_h >= margin and near * near <= square < far * far:
                grid[r, c] = 0


@njit(cache=True, nogil=True)
def clear_ray(
    grid: NDArray[np.uint8],
    origin: NDArray[np.int64],
    cell: float,
    apex: tuple[float, float],
    axis: tuple[float, float],
    near: float,
    far: float,
) -> None:
    """Set cells to 0 that a thin beam crosses between two distances (arguments as for clear_cone())."""
    size = grid.shape[0]
    step = 0.5 * cell
    distance = near
    while distance < far:
        c = math.floor((apex[0] + distance * axis[0]) / cell) - origin[0]
        r = math.floor((apex[1] + distance * axis[1]) / cell) - origin[1]
        if 0 <= c < size and 0 <= r < size:
            grid[r, c] = 0
        distance += step


@njit(cache=True, nogil=True)
def mark_point(
    grid: NDArray[np.uint8],
    origin: NDArray[np.int64],
    cell: float,
    x: float,
    y: float,
    certainty: int,
    heard: NDArray[np.int64],
) -> None:
    """Assign a certainty to the cell of an echo, if the echo has support; echoes outside the window are ignored.

    Args:
        grid, origin, cell: Window, in place, and side of a cell, m.
        x, y: Position of the echo, m, pose frame.
        certainty: 2 or 3.
        heard: From support.new_record(), in place; (0, 0): every echo counts at once.
    """
    size = grid.shape[0]
    c = math.floor(x / cell) - origin[0]
    r = math.floor(y / cell) - origin[1]
    if not (0 <= c < size and 0 <= r < size):
        return
    if heard.size > 0:
        heard[r, c] |= 1
    if heard.size == 0 or has_support(heard, r, c):
        grid[r, c] = certainty


@njit(cache=True, nogil=True)
def is_seen_through(
    x: float,
    y: float,
    i: int,
    placed: NDArray[np.float64],
    nearest: NDArray[np.float64],
    sensors: NDArray[np.int64],
    margin: float,
) -> bool:
    """Whether a point, m, pose frame, is where another cone of beam i's sensor clears (see mark_echo())."""
    for k in range(placed.shape[0]):
        if k == i or sensors[k] != sensors[i]:
            continue
        dx, dy = x - placed[k, 0], y - placed[k, 1]
        square = dx * dx + dy * dy
        if square >= placed[k, 4] * placed[k, 4] or square < nearest[k] * nearest[k]:
            continue
        along, across = dx * placed[k, 2] + dy * placed[k, 3], abs(dy * placed[k, 2] - dx * placed[k, 3])
        if along * placed[k, 7] - across * placed[k, 6] >= margin:
            return True
    return False


@njit(cache=True, nogil=True)
def place_beams(
    pose: tuple[float, float, float],
    origins_in_base: NDArray[np.float64],
    bearings: NDArray[np.float64],
    half_angles: NDArray[np.float64],
    ranges: NDArray[np.float64],
    limits: NDArray[np.float64],
    clear_margin: float,
    extent: float,
) -> NDArray[np.float64]:
    """Beams in the pose frame (arguments as for insert_beams(); extent: largest distance of interest, m).

    Returns:
        (n, 8): apex x, y, m; unit axis x, y; distance up to which the beam is clear, m; echo, m, +inf for none;
        cosine and sine of the half angle.
    """
    x, y, heading = pose
    cos_t, sin_t = math.cos(heading), math.sin(heading)
    placed = np.empty((ranges.size, 8))
    for i in range(ranges.size):
        ox, oy = origins_in_base[i, 0], origins_in_base[i, 1]
        reach = extent + math.hypot(ox, oy)
        echo = ranges[i] if ranges[i] < limits[i, 1] else np.inf
        placed[i, 0], placed[i, 1] = x + ox * cos_t - oy * sin_t, y + ox * sin_t + oy * cos_t
        placed[i, 2], placed[i, 3] = math.cos(heading + bearings[i]), math.sin(heading + bearings[i])
        placed[i, 4] = min(reach, limits[i, 1], echo - clear_margin) if echo > limits[i, 0] else 0.0
        placed[i, 5] = echo if echo <= reach else np.inf
        placed[i, 6], placed[i, 7] = math.cos(half_angles[i]), math.sin(half_angles[i])
    return placed


@njit(cache=True, nogil=True)
def mark_echo(
    grid: NDArray[np.uint8],
    origin: NDArray[np.int64],
    cell: float,
    i: int,
    placed: NDArray[np.float64],
    half_angles: NDArray[np.float64],
    nearest: NDArray[np.float64],
    sensors: NDArray[np.int64],
    margin: float,
    distance: float,
    heard: NDArray[np.int64],
) -> None:
    """Assign 2 along the arc of beam i at a distance, m, except at points that another cone of its sensor sees through.

    Args:
        grid, origin, cell: Window, in place, and side of a cell, m.
        placed: From place_beams(). half_angles: (n,), rad. nearest: (n,), near end of what each beam clears, m.
        sensors: (n,), number of each beam's sensor; a negative number is compared with no other.
        margin: m, as for clear_cone(). heard: As for mark_point().
    """
    half = half_angles[i]
    count = math.ceil(4.0 * half * distance / cell)
    step = 2.0 * half / count if count > 0 else 0.0
    cos_h, sin_h = placed[i, 6], placed[i, 7]
    dx = distance * (placed[i, 2] * cos_h + placed[i, 3] * sin_h)
    dy = distance * (placed[i, 3] * cos_h - placed[i, 2] * sin_h)
    cos_s, sin_s = math.cos(step), math.sin(step)
    for _ in range(count + 1):
        x, y = placed[i, 0] + dx, placed[i, 1] + dy
        if sensors[i] < 0 or not is_seen_through(x, y, i, placed, nearest, sensors, margin):
            mark_point(grid, origin, cell, x, y, ARC_CERTAINTY, heard)
        dx, dy = dx * cos_s - dy * sin_s, dx * sin_s + dy * cos_s


@njit(cache=True, nogil=True)
def insert_beams(
    grid: NDArray[np.uint8],
    origin: NDArray[np.int64],
    cell: float,
    pose: tuple[float, float, float],
    origins_in_base: NDArray[np.float64],
    bearings: NDArray[np.float64],
    half_angles: NDArray[np.float64],
    ranges: NDArray[np.float64],
    limits: NDArray[np.float64],
    sensors: NDArray[np.int64],
    clear_margin: float,
    blind_depth: float,
    clears_blind_zone: bool,
    forgets: bool,
    heard: NDArray[np.int64],
    memory: int,
) -> None:
    """Move the window to the robot and assign the readings of all beams: the switch law of Fig. 5.

    All cones are cleared first, then all arcs drawn, then all axes, so that the result does not depend on the order of
    the beams, and a cone does not erase an obstacle on the flank of its neighbour.

    Args:
        grid, origin, cell: Window, in place, and side of a cell, m.
        pose: x, y, m, and heading, rad, of the base in the pose frame.
        origins_in_base: (n, 2), m. bearings: (n,), rad, base frame. half_angles: (n,), rad.
        ranges: (n,), m, +inf for no echo.
        limits: (n, 2), smallest and largest range of each beam, m. A reading of the largest or more is no echo.
        sensors: (n,), number of each beam's sensor: the part of an arc that another cone of the same sensor sees
            through is not drawn. With negative numbers every arc is drawn completely (the paper).
        clear_margin: Depth before the echo and along the flanks of a cone that is not cleared, m.
        blind_depth: Arcs at the smallest range are drawn this far before it too, m: the obstacle may be nearer.
        clears_blind_zone: Whether other readings clear cells nearer than the smallest range.
        forgets: True sets every other cell of the window to 0 (literal reading of the paper).
        heard: From support.new_record(), in place. A cone's echo counts only if there was an earlier one in the same or
            an adjacent cell, and no cone has seen through it since; thin beams count at once. (0, 0): every echo
            counts (the paper).
        memory: Number of scans for which `heard` keeps an echo.
    """
    if heard.size > 0:
        scroll_window(heard, origin.copy(), pose[0], pose[1], cell)
        age_record(heard, memory)
    at_once = np.zeros((0, 0), np.int64)
    scroll_window(grid, origin, pose[0], pose[1], cell)
    if forgets:
        grid[:, :] = 0
    extent = 0.75 * grid.shape[0] * cell
    placed = place_beams(pose, origins_in_base, bearings, half_angles, ranges, limits, clear_margin, extent)
    nearest = np.zeros(ranges.size) if clears_blind_zone else limits[:, 0]
    for i in range(ranges.size):
        apex, axis, far = (placed[i, 0], placed[i, 1]), (placed[i, 2], placed[i, 3]), placed[i, 4]
        if half_angles[i] < THIN_BEAM:
            clear_ray(grid, origin, cell, apex, axis, nearest[i], far)
        else:
            clear_cone(grid, origin, cell, apex, axis, half_angles[i], nearest[i], far, clear_margin)
            if heard.size > 0:
                clear_cone(heard, origin, cell, apex, axis, half_angles[i], nearest[i], far, clear_margin)
    for i in range(ranges.size):
        distance = placed[i, 5]
        least = distance - (blind_depth if distance <= limits[i, 0] else 0.0)
        record = at_once if half_angles[i] < THIN_BEAM else heard
        while 0.0 < distance < np.inf and distance >= least:
            mark_echo(grid, origin, cell, i, placed, half_angles, nearest, sensors, clear_margin, distance, record)
            distance -= 0.5 * cell
    for i in range(ranges.size):
        if placed[i, 5] < np.inf:
            x, y = placed[i, 0] + placed[i, 5] * placed[i, 2], placed[i, 1] + placed[i, 5] * placed[i, 3]
            mark_point(grid, origin, cell, x, y, AXIS_CERTAINTY, at_once if half_angles[i] < THIN_BEAM else heard)


@njit(cache=True, nogil=True)
def occupied_cells(
    grid: NDArray[np.uint8],
    origin: NDArray[np.int64],
    cell: float,
    pose: tuple[float, float, float],
    edges: NDArray[np.float64],
    cells_in_base: NDArray[np.float64],
) -> int:
    """List the occupied cells in the base frame; cells well inside the footprint are cleared, since the robot is there.

    Args:
        grid, origin, cell, pose: As for insert_beams().
        edges: (k, 3), outward unit normal and offset of each side of the convex footprint, base frame, m: a point p
            is inside if normal . p <= offset for every side. (0, 3) keeps the cells under the robot.
        cells_in_base: (size * size, 3) float64, output: x, y, m, and certainty.

    Returns:
        Number of filled rows.
    """
    x, y, heading = pose
    cos_t, sin_t = math.cos(heading), math.sin(heading)
    count = 0
    for r in range(grid.shape[0]):
        dy = (origin[1] + r + 0.5) * cell - y
        for c in range(grid.shape[1]):
            if grid[r, c] == 0:
                continue
            dx = (origin[0] + c + 0.5) * cell - x
            bx, by = dx * cos_t + dy * sin_t, dy * cos_t - dx * sin_t
            if edges.shape[0] > 0 and outside_distance(edges, bx, by) < -0.5 * cell:
                grid[r, c] = 0
                continue
            cells_in_base[count, 0], cells_in_base[count, 1], cells_in_base[count, 2] = bx, by, grid[r, c]
            count += 1
    return count

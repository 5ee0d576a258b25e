"""Draw segments and lines of sight on grid cells."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numba import njit
from numpy.typing import NDArray

from navloom_ipabd.errors import SettingError
from navloom_ipabd.pressure import TAU, Bins

__all__ = ["FREE", "OCCUPIED", "UNKNOWN", "Lattice", "RasterMethod", "mark_occupied", "mark_seen", "merge_cells",
           "move_cells", "parts_in_unknown", "warm_up"]  # fmt: skip

Floats = NDArray[np.float64]
Cells = NDArray[np.int8]
Extent = tuple[float, float, float, float]
RasterMethod = Literal["distance", "supercover", "paper"]

FREE, OCCUPIED, UNKNOWN = 0, 100, -1
MAX_CELLS = 64_000_000


@dataclass(frozen=True)
class Lattice:
    """Cells whose centres lie at `anchor` plus whole multiples of `resolution`.

    Attributes:
        resolution: Edge of a cell, m.
        anchor: x, y of a cell centre, m, map frame: the start position S.
        column, row: Indices of the cell with the lowest x and y, counted from the anchor's cell.
        columns, rows: Number of columns and rows.
    """

    resolution: float
    anchor: tuple[float, float]
    column: int
    row: int
    columns: int
    rows: int

    @classmethod
    def covering(cls, extent: Extent, resolution: float, anchor: tuple[float, float]) -> Lattice:
        """The smallest lattice that covers the extent: lowest x, lowest y, highest x, highest y, m, map frame."""
        low_x, low_y, high_x, high_y = extent
        if not (resolution > 0.0 and low_x <= high_x and low_y <= high_y):
            raise SettingError("map.extent, resolution", f"{extent} and {resolution:g} m", "low <= high, a cell > 0 m")
        column, row = (math.floor((low - a) / resolution + 0.5) for low, a in zip(extent[:2], anchor, strict=True))
        last_column, last_row = (
            math.floor((high - a) / resolution + 0.5) for high, a in zip(extent[2:], anchor, strict=True)
        )
        lattice = cls(resolution, anchor, column, row, last_column - column + 1, last_row - row + 1)
        if lattice.columns * lattice.rows > MAX_CELLS:
            given = f"{lattice.columns} × {lattice.rows} cells of {resolution:g} m"
            raise SettingError("map.extent, resolution", given, f"at most {MAX_CELLS} cells; enlarge the cells")
        return lattice

    @property
    def origin(self) -> tuple[float, float]:
        """Lower left corner of the first cell, m, map frame."""
        return (
            self.anchor[0] + (self.column - 0.5) * self.resolution,
            self.anchor[1] + (self.row - 0.5) * self.resolution,
        )

    @property
    def extent(self) -> Extent:
        """Lowest x, y and highest x, y of the cell *centres*, m, map frame. `covering` of it returns this lattice."""
        low_x, low_y = (o + 0.5 * self.resolution for o in self.origin)
        return low_x, low_y, low_x + (self.columns - 1) * self.resolution, low_y + (self.rows - 1) * self.resolution

    def unknown(self) -> Cells:
        """New cells, (rows, columns) int8, all unknown; row 0 has the lowest y."""
        return np.full((self.rows, self.columns), UNKNOWN, dtype=np.int8)


def mark_occupied(
    cells: Cells, lattice: Lattice, segments: Floats, method: RasterMethod = "distance", paper_t: float = 0.8
) -> None:
    """Set the cells of all segments to 100, in place.

    Args:
        cells: (rows, columns) int8 of the lattice.
        segments: (n, 4) x1, y1, x2, y2, m, map frame.
        method: Which cells are set. "distance": cells whose centre is within half a cell of the segment, and the cells
            of both ends, so that no post is lost between four centres. "supercover": every cell that the segment
            touches. "paper": the slope test as printed (Hoang et al. 2013, III.A), which does not end where the
            segment ends.
        paper_t: T of the printed test. The paper uses the size of the robot, m, and compares slopes with it.
    """
    if method not in ("distance", "supercover", "paper"):
        raise SettingError("map.raster", repr(method), "'distance', 'supercover' or 'paper'")
    in_cells = np.empty((len(segments), 4))  # cell centres at whole numbers
    in_cells[:, 0::2] = (segments[:, 0::2] - lattice.origin[0]) / lattice.resolution - 0.5
    in_cells[:, 1::2] = (segments[:, 1::2] - lattice.origin[1]) / lattice.resolution - 0.5
    if method == "paper":
        for segment in in_cells:
            cells[_printed_test(cells.shape, segment, paper_t)] = OCCUPIED
    else:
        _stamp_segments(cells, in_cells, method == "supercover")


def _printed_test(shape: tuple[int, ...], segment: Floats, t: float) -> NDArray[np.bool_]:
    """The printed test: |(m - x1)/(n - y1) - (x2 - x1)/(y2 - y1)| <= T, or |m - x1| <= T if x1 = x2, for cells (m, n).

    Two things are corrected. A division by zero gives an infinite slope; for y1 = y2 the test is |n - y1| <= 1/2. For
    x1 = x2 the test uses |m - x1| instead of m - x1.
    """
    x1, y1, x2, y2 = segment
    n, m = np.mgrid[: shape[0], : shape[1]]
    is_hit: NDArray[np.bool_]
    if x1 == x2:
        is_hit = np.abs(m - x1) <= t
    elif y1 == y2:
        is_hit = np.abs(n - y1) <= 0.5
    else:
        with np.errstate(divide="ignore", invalid="ignore"):
            is_hit = np.abs((m - x1) / (n - y1) - (x2 - x1) / (y2 - y1)) <= t
    return is_hit


def mark_seen(cells: Cells, lattice: Lattice, sensor: tuple[float, float, float], bins: Bins, seen: Floats) -> None:
    """Set the cells whose centre a ray passed, and the cell of the sensor itself, to 0, in place.

    Args:
        cells: (rows, columns) int8 of the lattice.
        sensor: x, y of the sensor, m, and heading of base, rad, in the map frame.
        bins: Azimuths in the reference frame.
        seen: (bins,) distance up to which each azimuth was observed, m.
    """
    x, y = (
        (value - origin) / lattice.resolution - 0.5 for value, origin in zip(sensor[:2], lattice.origin, strict=True)
    )
    _stamp_seen(cells, x, y, sensor[2], bins.first, bins.step, seen / lattice.resolution)


def parts_in_unknown(segments: Floats, cells: Cells, lattice: Lattice) -> Floats:
    """(m, 4) parts of segments (n, 4), m, map frame, that lie in unknown cells or outside the lattice.

    The ends of the parts are accurate to half a cell.
    """
    parts = []
    for x1, y1, x2, y2 in segments:
        count = math.ceil(2.0 * math.hypot(x2 - x1, y2 - y1) / lattice.resolution) + 2
        points = np.linspace((x1, y1), (x2, y2), count)
        columns, rows = np.floor((points - lattice.origin) / lattice.resolution).astype(np.int64).T
        is_within = (columns >= 0) & (columns < lattice.columns) & (rows >= 0) & (rows < lattice.rows)
        is_kept = ~is_within
        is_kept[is_within] = cells[rows[is_within], columns[is_within]] == UNKNOWN
        edges = np.flatnonzero(np.diff(np.concatenate([[False], is_kept, [False]])))
        parts += [(*points[first], *points[after - 1]) for first, after in edges.reshape(-1, 2)]
    return np.array(parts, dtype=np.float64).reshape(-1, 4)


def move_cells(cells: Cells, old: Lattice, new: Lattice) -> Cells:
    """Copy cells of an old lattice to a new one with the same anchor and resolution. Other cells are unknown."""
    moved = new.unknown()
    rows = slice(max(0, old.row - new.row), min(new.rows, old.row - new.row + old.rows))
    columns = slice(max(0, old.column - new.column), min(new.columns, old.column - new.column + old.columns))
    if rows.start < rows.stop and columns.start < columns.stop:
        up, right = new.row - old.row, new.column - old.column
        moved[rows, columns] = cells[rows.start + up : rows.stop + up, columns.start + right : columns.stop + right]
    return moved


def merge_cells(old: Cells, new: Cells) -> Cells:
    """Occupied where either map is, else free where either is: observations persist until the map is cleared."""
    # 100, 0 and -1: occupied goes before free, and both before unknown.
    return np.maximum(old, new)


@njit(cache=True, nogil=True)
def _stamp_segments(cells: Cells, segments: Floats, is_supercover: bool) -> None:
    """Draw segments, given in units of cells with cell centres at whole numbers."""
    rows, columns = cells.shape
    for i in range(segments.shape[0]):
        x1, y1, x2, y2 = segments[i]
        for x, y in ((x1, y1), (x2, y2)):
            column, row = math.floor(x + 0.5), math.floor(y + 0.5)
            if 0 <= row < rows and 0 <= column < columns:
                cells[row, column] = 100
        for row in range(max(0, math.floor(min(y1, y2))), min(rows - 1, math.ceil(max(y1, y2))) + 1):
            for column in range(max(0, math.floor(min(x1, x2))), min(columns - 1, math.ceil(max(x1, x2))) + 1):
                hit = _touches_square(x1 - column, y1 - row, x2 - column, y2 - row) if is_supercover else (
                    _is_within(x1 - column, y1 - row, x2 - column, y2 - row)
                )  # fmt: skip
                if hit:
                    cells[row, column] = 100


@njit(cache=True, nogil=True)
def _is_within(x1: float, y1: float, x2: float, y2: float) -> bool:
    """Whether the segment comes within 0.5 of the origin."""
    dx, dy = x2 - x1, y2 - y1
    length2 = dx * dx + dy * dy
    share = 0.0 if length2 == 0.0 else min(1.0, max(0.0, -(x1 * dx + y1 * dy) / length2))
    return (x1 + share * dx) ** 2 + (y1 + share * dy) ** 2 <= 0.25


@njit(cache=True, nogil=True)
def _touches_square(x1: float, y1: float, x2: float, y2: float) -> bool:
    """Whether the segment meets the square of half edge 0.5 around the origin (Liang-Barsky)."""
    enter, leave = 0.0, 1.0
    for start, step in ((x1, x2 - x1), (y1, y2 - y1)):
        if step == 0.0:
            if abs(start) > 0.5:
                return False
        else:
            near, far = (-0.5 - start) / step, (0.5 - start) / step
            if near > far:
                near, far = far, near
            enter, leave = max(enter, near), min(leave, far)
    return enter <= leave


@njit(cache=True, nogil=True)
def _stamp_seen(cells: Cells, x: float, y: float, heading: float, first: float, step: float, seen: Floats) -> None:
    """Mark free cells; lengths in units of cells. Every cell centre looks up its azimuth bin, so none is skipped."""
    for row in range(cells.shape[0]):
        for column in range(cells.shape[1]):
            dx, dy = column - x, row - y
            angle = math.atan2(dy, dx) - heading - first + 0.5 * step
            angle -= TAU * math.floor(angle / TAU)
            i = int(angle / step)
            # The sensor's own cell has no bearing from it, and its centre may lie behind.
            is_own = abs(dx) <= 0.5 and abs(dy) <= 0.5
            if is_own or (i < seen.size and dx * dx + dy * dy < seen[i] * seen[i]):
                cells[row, column] = 0


def warm_up() -> None:
    """Compile the kernels."""
    lattice = Lattice.covering((0.0, 0.0, 1.0, 1.0), 0.5, (0.0, 0.0))
    cells = lattice.unknown()
    mark_seen(cells, lattice, (0.0, 0.0, 0.0), Bins(0.0, 0.1, 2), np.ones(2))
    mark_occupied(cells, lattice, np.array([[0.0, 0.0, 1.0, 1.0]]))

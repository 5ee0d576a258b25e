"""The log-odds grid: position of its cells, growth and contents."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from navloom_ipabd.errors import SettingError
from numpy.typing import NDArray

from navloom_scan_grid import kernels
from navloom_scan_grid.kernels import Weights

__all__ = ["MAX_CELLS", "Bounds", "LogOddsGrid"]

Box = tuple[float, float, float, float]
"""Lowest x, y, highest x, y, m, map frame."""
MAX_CELLS = 64_000_000
ECHOES = 32
"""Last echoes of cones that are kept: those of some rounds of a ring, also if each sonar is a scan of its own."""


@dataclass(frozen=True)
class Bounds:
    """Cells of a lattice whose borders lie at multiples of the cell's edge in the map frame.

    Attributes:
        column, row: Index of the lowest x and y: its border lies at index times edge.
        columns, rows: Size.
    """

    column: int
    row: int
    columns: int
    rows: int

    @classmethod
    def of(cls, box: Box, cell: float, chunk: int) -> Bounds:
        """The smallest bounds in chunks of `chunk` × `chunk` cells that contain a box.

        Raises:
            SettingError: The bounds have more than `MAX_CELLS` cells.
        """
        column, row = (chunk * math.floor(math.floor(low / cell) / chunk) for low in box[:2])
        after_column, after_row = (chunk * (math.floor(math.floor(high / cell) / chunk) + 1) for high in box[2:])
        return cls(column, row, after_column - column, after_row - row).checked(cell)

    def hold(self, box: Box, cell: float) -> bool:
        """Whether these bounds contain every cell that a box touches."""
        low_x, low_y, high_x, high_y = box
        return (
            math.floor(low_x / cell) >= self.column
            and math.floor(low_y / cell) >= self.row
            and math.floor(high_x / cell) < self.column + self.columns
            and math.floor(high_y / cell) < self.row + self.rows
        )

    def with_(self, other: Bounds, cell: float) -> Bounds:
        """The smallest bounds that contain both.

        Raises:
            SettingError: The bounds have more than `MAX_CELLS` cells.
        """
        column, row = min(self.column, other.column), min(self.row, other.row)
        right = max(self.column + self.columns, other.column + other.columns)
        top = max(self.row + self.rows, other.row + other.rows)
        return Bounds(column, row, right - column, top - row).checked(cell)

    def checked(self, cell: float) -> Bounds:
        """These bounds; a SettingError if they have more than `MAX_CELLS` cells."""
        if self.columns * self.rows > MAX_CELLS:
            given = f"{self.columns} × {self.rows} cells of {cell:g} m"
            raise SettingError("map.extent, cell", given, f"at most {MAX_CELLS} cells; enlarge the cells")
        return self


class LogOddsGrid:
    """Log odds of occupancy in a grid that grows in chunks.

    Args:
        cell: Edge of a cell, m.
        chunk: The grid grows by this many cells at a time.
        box: Area covered from the start, m, map frame.

    Attributes:
        odds: (rows, columns) float32 log odds; NaN if unknown; row 0 has the lowest y.
        heard: (rows, columns, 2) uint8 echoes of cones that are not outweighed, see `kernels.insert`.
        bounds: Position and size of the grid, in cells.
    """

    def __init__(self, cell: float, chunk: int, box: Box) -> None:
        self.cell, self.chunk = cell, chunk
        self.bounds = Bounds.of(box, cell, chunk)
        self.odds = self._unknown()
        self.heard, self._echoes = self._unheard(), np.full((ECHOES, 6), np.inf)
        self._said = kernels.said_of(*self.odds.shape)

    @property
    def origin(self) -> tuple[float, float]:
        """Lower left corner, m, map frame."""
        return self.bounds.column * self.cell, self.bounds.row * self.cell

    def cover(self, box: Box) -> None:
        """Grow the grid to contain a box; known cells keep their values.

        Raises:
            SettingError: The grid would be too large; it is unchanged.
        """
        old = self.bounds
        if old.hold(box, self.cell):
            return
        new = old.with_(Bounds.of(box, self.cell, self.chunk), self.cell)
        self.bounds = new
        known, self.odds = self.odds, self._unknown()
        row, column = old.row - new.row, old.column - new.column
        self.odds[row : row + old.rows, column : column + old.columns] = known
        heard, self.heard = self.heard, self._unheard()
        self.heard[row : row + old.rows, column : column + old.columns] = heard
        self._said = kernels.said_of(*self.odds.shape)

    def forget(self, x: float, y: float, radius: float) -> None:
        """Reset cells to unknown if their centre is within a radius, m, of a point, m, map frame."""
        rows, columns = self.odds.shape
        dx = self.origin[0] + self.cell * (np.arange(columns) + 0.5) - x
        dy = self.origin[1] + self.cell * (np.arange(rows) + 0.5) - y
        is_near = np.hypot(dx[None, :], dy[:, None]) <= radius
        self.odds[is_near], self.heard[is_near] = np.nan, 0

    def insert(self, placed: NDArray[np.float64], limits: tuple[float, float], weights: Weights) -> None:
        """Add one scan, which the grid must cover; arguments as in `kernels.insert`."""
        kernels.insert(
            self.odds, self.heard, self._echoes, self._said, *self.origin, self.cell, placed, limits, weights
        )

    def render(self, occupied_from: float, is_ternary: bool) -> NDArray[np.int8]:
        """(rows, columns) int8 values to publish, see `kernels.render`."""
        cells: NDArray[np.int8] = kernels.render(self.odds, self.heard, occupied_from, is_ternary)
        return cells

    def _unknown(self) -> NDArray[np.float32]:
        return np.full((self.bounds.rows, self.bounds.columns), np.nan, np.float32)

    def _unheard(self) -> NDArray[np.uint8]:
        return np.zeros((self.bounds.rows, self.bounds.columns, 2), np.uint8)

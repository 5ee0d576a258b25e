"""A map as the two files of ROS's map_server: an image, and a description in YAML."""

from __future__ import annotations

from typing import Literal

import numpy as np

from navloom.geometry.grid import UNKNOWN, GridMap

__all__ = ["rosmap_files"]

_BLACK, _GREY, _WHITE = 0, 205, 254
_OCCUPIED_THRESH, _FREE_THRESH = 0.65, 0.196


def rosmap_files(grid: GridMap, name: str, mode: Literal["trinary", "raw"] = "trinary") -> dict[str, bytes]:
    """Contents of the two files of a map, by name: the image first, then the YAML file that names it.

    Args:
        grid: In trinary mode cells from 65 count as occupied, those up to 19 as free, all others as unknown; a grid of
            -1, 0 and 100 is restored exactly. In raw mode every grid is.
        name: Name of both files, without the extension.
        mode: "trinary" or "raw".
    """
    cells = grid.cells[::-1]
    if mode == "raw":
        levels = np.where(cells == UNKNOWN, 255, cells)
    else:
        known = np.where(
            cells >= 100.0 * _OCCUPIED_THRESH, _BLACK, np.where(cells <= 100.0 * _FREE_THRESH, _WHITE, _GREY)
        )
        levels = np.where(cells == UNKNOWN, _GREY, known)
    header = f"P5\n{cells.shape[1]} {cells.shape[0]}\n255\n".encode("ascii")
    origin = ", ".join(map(_number, (grid.origin.x, grid.origin.y, grid.origin.heading)))
    # Written by hand, so that the core needs no YAML library; navloom-maps reads it with one.
    text = (
        f"image: {name}.pgm\nmode: {mode}\nresolution: {_number(grid.resolution)}\norigin: [{origin}]\nnegate: 0\n"
        f"occupied_thresh: {_OCCUPIED_THRESH}\nfree_thresh: {_FREE_THRESH}\n"
    )
    return {f"{name}.pgm": header + levels.astype(np.uint8).tobytes(), f"{name}.yaml": text.encode()}


def _number(value: float) -> str:
    """A number as YAML 1.1 reads it back: without a point, 1e-05 would be a text."""
    mantissa, e, exponent = repr(float(value)).partition("e")
    return mantissa if not e else f"{mantissa if '.' in mantissa else mantissa + '.0'}e{exponent}"

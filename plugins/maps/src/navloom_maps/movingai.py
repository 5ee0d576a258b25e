"""Grid maps of the MovingAI benchmarks (Sturtevant 2012), type octile, plain or gzipped.

`.`, `G` and `S` are floor; `@`, `O`, `T` and `W` (water) are obstacles. The first row of the file has the highest y:
the scenario files count rows from the top, so their cell (x, y) has its centre at ((x + 0.5), (rows - y - 0.5)) cells.
"""

from __future__ import annotations

import gzip
import io
import zlib
from pathlib import Path

import numpy as np
from navloom.geometry.grid import FREE, MAX_CELLS, OCCUPIED, GridMap
from navloom.geometry.world import Place, Raster, World
from navloom.inputs import IMAGE_MB, bytes_of, read_past, too_large
from navloom.worlds import WorldError, file_of, length_of, options_of, raster_bounds, read_bytes, wall_height
from numpy.typing import NDArray

__all__ = ["movingai_world", "read_movingai", "scenario_place"]

_HEADER = 4096
"""Largest size of the four lines before the rows, bytes."""
_NEWLINE = ord("\n")
_CELLS = np.full(256, -1, dtype=np.int8)
_CELLS[list(b".GS")] = FREE
_CELLS[list(b"@OTW")] = OCCUPIED


def movingai_world(argument: str, base: Path) -> World:
    """World scheme `movingai:F.map[.gz]`, with options `?cell=0.25` (edge of a cell, m; default 1) and `?height=2.0`.

    Raises:
        WorldError: See `read_movingai`; or an option is not a length.
    """
    name, options = options_of(argument, {"cell": "1.0", "height": "2.4"})
    cell = length_of(f"movingai:{argument}", "cell", options["cell"])
    path = file_of(name, base)
    grid = read_movingai(path, cell)
    z = wall_height(f"movingai:{argument}", options["height"])
    raster = Raster(path.name, grid.cells == OCCUPIED, grid.resolution, grid.origin, z)
    return World(f"movingai:{argument}", raster=raster, bounds=raster_bounds(raster))


def read_movingai(path: Path, cell: float = 1.0) -> GridMap:
    """The occupancy grid of a map file; its lower left corner is the map frame's origin.

    Args:
        path: The file, plain or gzipped.
        cell: Edge of a cell, m.

    Raises:
        WorldError: The file is missing, damaged, truncated, or not of this format.
    """
    text = _text(path).replace(b"\r\n", b"\n")
    lines = text[:_HEADER].split(b"\n", 4)
    height, width = _header(lines[:4], path)
    levels = _rows(text, sum(map(len, lines[:4])) + 4, height, width, path)
    cells: NDArray[np.int8] = _CELLS[levels]
    is_wrong = cells < 0
    if is_wrong.any():
        row, col = divmod(int(is_wrong.argmax()), width)
        given = chr(levels[row, col])
        raise WorldError(f"{path}, line {row + 5}, cell {col + 1}: {given!r}, expected one of . G S @ O T W")
    return GridMap(np.ascontiguousarray(cells[::-1]), cell, Place(0.0, 0.0))


def scenario_place(x: int, y: int, rows: int, cell: float = 1.0) -> Place:
    """Centre of a scenario file's cell: column x, row y from the top, of a map with `rows` rows of `cell` m."""
    return Place((x + 0.5) * cell, (rows - y - 0.5) * cell)


def _text(path: Path) -> bytes:
    content = read_bytes(path, IMAGE_MB)
    if content[:2] != b"\x1f\x8b":
        return content
    limit = bytes_of(IMAGE_MB, WorldError)
    try:
        with gzip.GzipFile(fileobj=io.BytesIO(content)) as file:
            text = read_past(file, limit)
    except (OSError, EOFError, zlib.error) as error:
        raise WorldError(f"{path}: damaged gzip file: {error}; copy the file again") from None
    if len(text) > limit:
        raise WorldError(too_large(f"{path}: unpacks to more than {limit / 1e6:g} MB", limit))
    return text


def _rows(text: bytes, start: int, height: int, width: int, path: Path) -> NDArray[np.uint8]:
    """(height, width) characters of the map.

    They are processed as one array: a list takes 40 bytes a line, and a gzipped file can contain lines at no cost.
    """
    stride = width + 1
    whole = min(height, (len(text) - start + 1) // stride)
    body = np.frombuffer(text, dtype=np.uint8)[start:]
    if whole * stride > body.size:  # the last line needs no end
        body = np.append(body, np.uint8(_NEWLINE))
    table = body[: whole * stride].reshape(whole, stride)
    is_wrong = (table[:, -1] != _NEWLINE) | (table[:, :-1] == _NEWLINE).any(axis=1)
    if is_wrong.any() or whole < height:
        row = int(is_wrong.argmax()) if is_wrong.any() else whole
        begin = start + row * stride
        line, end, _ = text[begin:].partition(b"\n")
        if not line and not end:
            raise WorldError(f"{path}: truncated: {row} rows, expected {height}; copy the file again")
        raise WorldError(f"{path}, line {row + 5}: {len(line)} cells, expected {width}")
    return table[:, :-1]


def _header(lines: list[bytes], path: Path) -> tuple[int, int]:
    """Height and width, cells."""
    found: dict[bytes, int] = {}
    if not lines or lines[0].split() != [b"type", b"octile"]:
        raise WorldError(f"{path}, line 1: {lines[0][:40] if lines else b''!r}, expected 'type octile'")
    for number, line in enumerate(lines[1:3], start=2):
        words = line.split()
        if len(words) != 2 or words[0] not in (b"height", b"width") or not words[1].isdigit() or len(words[1]) > 9:
            raise WorldError(f"{path}, line {number}: {line[:40]!r}, expected 'height' or 'width' and a number")
        found[words[0]] = int(words[1])
    if len(found) != 2 or len(lines) < 4 or lines[3].strip() != b"map":
        raise WorldError(f"{path}: expected the lines 'height', 'width' and 'map' after 'type octile'")
    if not 1 <= found[b"height"] * found[b"width"] <= MAX_CELLS:
        raise WorldError(f"{path}: {found[b'width']} x {found[b'height']} cells, expected 1 to {MAX_CELLS} cells")
    return found[b"height"], found[b"width"]

"""Maps of the ROS map_server (a YAML file and an image), read and written like nav2_map_server.

A pixel's occupancy is p = 1 - shade (p = shade with `negate`), the image's top row has the highest y. Modes:

- trinary: 100 where p > occupied_thresh, else 0 where p < free_thresh, else -1. Transparency counts as a fourth colour.
- scale: as trinary, but 0 to 100 in proportion between the thresholds, and -1 where not opaque.
- raw: the level from 0 to 255 itself, -1 above 100.

map_saver writes unknown cells as grey 205, p = 0.196. With `free_thresh: 0.25`, Nav2's default, map_server reads them
as free, and so do we; a warning tells how many.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path, PureWindowsPath
from typing import Any

import numpy as np
from navloom.geometry.angles import wrap
from navloom.geometry.grid import FREE, OCCUPIED, UNKNOWN, GridMap
from navloom.geometry.world import Place, Raster, World
from navloom.inputs import YAML_MB, shortened
from navloom.worlds import WorldError, did_you_mean, file_of, options_of, raster_bounds, read_bytes, wall_height
from numpy.typing import NDArray

from navloom_maps.images import Shades, read_image
from navloom_maps.yaml_text import yaml_of

__all__ = ["load_raster", "read_rosmap", "rosmap_world"]

_MODES = ("trinary", "scale", "raw")
_UNKNOWNS = ("occupied", "free")
_EXAMPLES = {
    "image": "image: map.pgm", "resolution": "resolution: 0.05", "origin": "origin: [0.0, 0.0, 0.0]",
    "negate": "negate: 0", "occupied_thresh": "occupied_thresh: 0.65", "free_thresh": "free_thresh: 0.196",
}  # fmt: skip
_GREY = 205
"""Level of unknown cells in the images of map_saver, of 255."""


@dataclass(frozen=True)
class _Description:
    """The checked YAML file of a map."""

    path: Path
    image: Path
    resolution: float
    origin: Place
    negate: bool
    occupied_thresh: float
    free_thresh: float
    mode: str


def rosmap_world(argument: str, base: Path) -> World:
    """World scheme `rosmap:F.yaml`, with options `?unknown=free` and `?height=2.0`. See `load_raster`."""
    name, options = options_of(argument, {"unknown": "occupied", "height": "2.4"})
    z = wall_height(f"rosmap:{argument}", options["height"])
    raster = load_raster(file_of(name, base), unknown=options["unknown"], z=z)
    return World(f"rosmap:{argument}", raster=raster, bounds=raster_bounds(raster))


def load_raster(path: Path, unknown: str = "occupied", z: tuple[float, float] = (0.0, 2.4)) -> Raster:
    """A map as the true world.

    A cell is an obstacle from 100 on, in a raw map from `occupied_thresh` on. Unknown cells are obstacles too, unless
    `unknown` is "free": no floor was seen there, and a shortest path must not leave the building through them.

    Args:
        path: The YAML file.
        unknown: "occupied" or "free".
        z: Height interval of the walls, m.

    Raises:
        WorldError: See `read_rosmap`; or `unknown` has another value.
    """
    if unknown not in _UNKNOWNS:
        raise WorldError(f"{path}: unknown={unknown}: expected occupied or free; {did_you_mean(unknown, _UNKNOWNS)}")
    description = _describe(path)
    grid = _grid(description)
    least = math.ceil(100.0 * description.occupied_thresh) if description.mode == "raw" else OCCUPIED
    occupied = grid.cells >= least
    unseen = grid.cells == UNKNOWN if unknown == "occupied" else None
    if unseen is not None:
        occupied |= unseen
    return Raster(path.name, occupied, grid.resolution, grid.origin, z, unseen)


def read_rosmap(path: Path) -> GridMap:
    """The occupancy grid of a map_server map, as map_server would publish it.

    Args:
        path: The YAML file; the image is relative to its folder.

    Raises:
        WorldError: A file is missing, damaged or truncated, or a key is missing or has an invalid value.
    """
    return _grid(_describe(path))


def _grid(description: _Description) -> GridMap:
    shades = read_image(description.image)
    cells = np.ascontiguousarray(_cells(shades, description)[::-1])
    _warn_of_free_grey(cells, shades, description)
    return GridMap(cells, description.resolution, description.origin)


def _warn_of_free_grey(cells: NDArray[np.int8], shades: Shades, description: _Description) -> None:
    """Warn if cells, row 0 at the bottom, are free that the map's saver probably meant as unknown."""
    if description.mode == "raw":
        return
    grey = shades.levels[::-1] == round(shades.top * _GREY / 255)
    if count := int(np.count_nonzero(grey & (cells == FREE))):
        _warn(
            f"{description.path}: {count} of {cells.size} cells are grey {_GREY}, map_saver's shade of unknown, and"
            f" are read as free, as map_server reads them: write free_thresh: 0.196 (now {description.free_thresh:g})"
            " if they are unknown" + ("" if shades.opaque is None else ", and save the image without transparency")
        )


@cache
def _warn(text: str) -> None:
    """Log a warning, once a process however often a map is read."""
    logging.getLogger("navloom.maps").warning(text)


def _cells(shades: Shades, description: _Description) -> NDArray[np.int8]:
    """(rows, cols) cells, row 0 at the top, from a lookup table with one entry a level."""
    levels, top = shades.levels, shades.top
    if description.mode == "trinary" and shades.with_alpha is not None:
        levels, top = shades.with_alpha, shades.top_with_alpha
    shade = np.arange(top + 1) / top
    p = shade if description.negate else 1.0 - shade
    occupied, free = description.occupied_thresh, description.free_thresh
    if description.mode == "raw":
        level = np.floor(shade * 255.0 + 0.5)
        table = np.where(level <= 100.0, level, UNKNOWN)
    else:
        # Without a gap between the thresholds no level is scaled.
        is_scaled = description.mode == "scale" and free < occupied
        between = np.rint(100.0 * (p - free) / (occupied - free)) if is_scaled else UNKNOWN
        table = np.where(p > occupied, OCCUPIED, np.where(p < free, FREE, between))
    cells: NDArray[np.int8] = table.astype(np.int8)[levels]
    if description.mode == "scale" and shades.opaque is not None:
        cells[~shades.opaque] = UNKNOWN
    return cells


def _describe(path: Path) -> _Description:
    document = yaml_of(read_bytes(path, YAML_MB), str(path), WorldError)
    if not isinstance(document, dict):
        raise WorldError(f"{path}: expected the keys image, resolution, origin, negate, occupied_thresh, free_thresh")
    return _checked(document, path)


def _checked(document: dict[Any, Any], path: Path) -> _Description:
    def value(key: str) -> Any:
        if key not in document:
            others = [str(other) for other in document if other not in _EXAMPLES and other != "mode"]
            hint = did_you_mean(key, others) if others else f"add it, as in {_EXAMPLES[key]}"
            raise WorldError(f"{path}: key {key!r} is missing; {hint}")
        return document[key]

    def number(key: str, given: Any, fits: Callable[[float], bool], expected: str) -> float:
        try:
            # A YAML 1.1 parser reads 5e-2 as a string; map_server's reads it as a number.
            found = float(given) if isinstance(given, int | float | str) and not isinstance(given, bool) else math.nan
        except (ValueError, OverflowError):
            found = math.nan
        if not (math.isfinite(found) and fits(found)):
            raise WorldError(f"{path}: {key} = {shortened(given)}: expected {expected}")
        return found

    def share(key: str) -> float:
        return number(key, value(key), lambda v: 0.0 <= v <= 1.0, "a number from 0 to 1")

    image, origin, negate, mode = value("image"), value("origin"), value("negate"), document.get("mode", "trinary")
    if not isinstance(image, str):
        raise WorldError(f"{path}: image = {shortened(image)}: expected the name of a PGM or PNG file")
    if not isinstance(origin, list) or len(origin) != 3:
        raise WorldError(f"{path}: origin = {shortened(origin)}: expected [x, y, yaw] in metres and radians")
    x, y, yaw = (number("origin", v, lambda v: abs(v) <= 1e7, "[x, y, yaw] in metres and radians") for v in origin)
    if abs(yaw) > math.tau:
        _warn(
            f"{path}: origin: a yaw of {yaw:g} is read in radians, as {yaw / math.tau:.1f} turns;"
            f" if it is in degrees, write {math.radians(yaw):.6g}"
        )
    if negate not in (0, 1, "0", "1"):
        raise WorldError(f"{path}: negate = {shortened(negate)}: expected 0 or 1")
    if not isinstance(mode, str) or mode.lower() not in _MODES:
        near = f"; {did_you_mean(mode.lower(), _MODES)}" if isinstance(mode, str) else ""
        raise WorldError(f"{path}: mode = {shortened(mode)}: expected one of {', '.join(_MODES)}{near}")
    resolution = number(
        "resolution", value("resolution"), lambda v: 1e-4 <= v <= 1e4, "metres a pixel, 0.0001 to 10000"
    )
    occupied, free = share("occupied_thresh"), share("free_thresh")
    if free >= occupied:
        _warn(
            f"{path}: free_thresh = {free:g} is not below occupied_thresh = {occupied:g}: as map_server reads it,"
            " every cell that is not occupied is free"
        )
    place, inverted = Place(x, y, float(wrap(yaw))), bool(int(negate))
    return _Description(path, _image_of(image, path), resolution, place, inverted, occupied, free, mode.lower())


def _image_of(image: str, path: Path) -> Path:
    """The image's file; an error for one that is missing where a file of that name lies beside the YAML file."""
    file = file_of(image, path.parent)
    # A path of another computer, which may have had Windows.
    name = PureWindowsPath(image).name
    if name and name != image and not file.exists() and (path.parent / name).is_file():
        raise WorldError(f"{file}: there is no such file; one of this name lies beside {path}: write image: {name}")
    return file

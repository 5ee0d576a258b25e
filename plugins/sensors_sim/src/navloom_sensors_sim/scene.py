"""The world as arrays: which obstacles are present at a run time, and where the bodies are that move."""

from __future__ import annotations

import math
from collections.abc import Sequence
from hashlib import blake2b
from typing import Any
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from navloom_sensors_sim.casting import Obstacles

__all__ = ["Scene"]

Floats = NDArray[np.float64]
_GAPS: WeakValueDictionary[tuple[object, ...], NDArray[np.float32]] = WeakValueDictionary()
"""Gaps of rasters in use, by content: robots of one world share them."""


class Scene:
    """Ground truth at one moment.

    Attributes:
        obstacles: Arrays that the kernels read; `update` changes or replaces them.
        opaque: The same without glass, for lasers; the same object if there is no glass.
        names: Name of each obstacle by its index: boxes, cylinders, raster. Those that move come after the boxes and
            after the cylinders that stand.
    """

    def __init__(self, solids: Sequence[Any], raster: Any, sweeps: bool) -> None:
        """Build the arrays of a world.

        Args:
            solids: Boxes and cylinders (those with a `radius`), with the attributes of navloom's Box and Cylinder.
            raster: An object with the attributes of navloom's Raster, or None.
            sweeps: Whether the robot has a pitched laser. If not, obstacles that appear after its first sweep are
                present from the start.
        """
        boxes = [solid for solid in solids if not hasattr(solid, "radius")]
        cylinders = [solid for solid in solids if hasattr(solid, "radius")]
        solids = [*boxes, *cylinders]
        self._named = ([o.name for o in boxes], [o.name for o in cylinders], [] if raster is None else [raster.name])
        self.names = tuple(name for names in self._named for name in names)
        self.obstacles = self._standing = Obstacles(
            np.array([_box_row(box) for box in boxes]).reshape(-1, 9),
            np.array([_cylinder_row(cylinder) for cylinder in cylinders]).reshape(-1, 6),
            *_raster_arrays(raster),
        )
        self._sweeps = sweeps
        self.opaque = self._standing_opaque = _without_glass(self.obstacles, solids)
        arrays = (self.obstacles,) if self.opaque is self.obstacles else (self.obstacles, self.opaque)
        # Obstacles that can change, each with its row in the arrays, which is a view; glass stays absent for lasers.
        self._changing = [
            (o, row)
            for kind in arrays
            for o, row in zip(solids, _rows(kind), strict=True)
            if (o.appears_after_sweep or o.appears_at > 0.0) and (kind is self.obstacles or o.material != "glass")
        ]

    def update(self, time: float, swept: bool) -> None:
        """Update presence for a run time, s; `swept`: whether the first sweep has ended."""
        for obstacle, row in self._changing:
            if obstacle.appears_after_sweep:
                row[-1] = swept or not self._sweeps
            else:
                row[-1] = time >= obstacle.appears_at

    def put(self, parts: Floats, names: Sequence[str]) -> None:
        """Add what moves to what stands.

        Args:
            parts: (p, 9) cylinders and boxes, as in navloom's `Bodies`.
            names: Names of the bodies that they belong to.
        """
        is_box, standing = parts[:, 4] > 0.0, self._standing
        owners = [[names[int(number)] for number in parts[kind, 0]] for kind in (is_box, ~is_box)]
        boxes, cylinders, raster = self._named
        self.names = (*boxes, *owners[0], *cylinders, *owners[1], *raster)
        self.obstacles = _joined(standing, parts[is_box], parts[~is_box])
        self.opaque = self.obstacles
        if self._standing_opaque is not standing or parts[:, 8].any():
            # Absent, not left out: an index means the same obstacle to every sensor.
            self.opaque = _joined(self._standing_opaque, parts[is_box], parts[~is_box], sees_glass=False)

    def name_of(self, index: int) -> str:
        """Name of an obstacle by its index, empty for none."""
        return self.names[index] if index >= 0 else ""


def _joined(standing: Obstacles, boxes: Floats, cylinders: Floats, sees_glass: bool = True) -> Obstacles:
    """Standing obstacles, and boxes and cylinders in rows of navloom's `Bodies.parts` after them."""
    box_rows, cylinder_rows = np.empty((len(boxes), 9)), np.empty((len(cylinders), 6))
    box_rows[:, :4], box_rows[:, 4:6] = boxes[:, 1:5], boxes[:, 6:8]
    # A yaw of 0 has a sine of exactly 0, for which the kernels use a faster path.
    box_rows[:, 6], box_rows[:, 7] = np.cos(boxes[:, 5]), np.sin(boxes[:, 5])
    cylinder_rows[:, :3], cylinder_rows[:, 3:5] = cylinders[:, 1:4], cylinders[:, 6:8]
    for rows, parts in ((box_rows, boxes), (cylinder_rows, cylinders)):
        rows[:, -1] = True if sees_glass else parts[:, 8] == 0.0
    return standing._replace(
        boxes=np.concatenate([standing.boxes, box_rows]), cylinders=np.concatenate([standing.cylinders, cylinder_rows])
    )


def _without_glass(obstacles: Obstacles, solids: Sequence[Any]) -> Obstacles:
    """The arrays with all glass absent; the same object if there is none."""
    if all(solid.material != "glass" for solid in solids):
        return obstacles
    # Absent, not left out: an index means the same obstacle to every sensor.
    opaque = obstacles._replace(boxes=obstacles.boxes.copy(), cylinders=obstacles.cylinders.copy())
    for solid, row in zip(solids, _rows(opaque), strict=True):
        if solid.material == "glass":
            row[-1] = 0.0
    return opaque


def _rows(obstacles: Obstacles) -> list[NDArray[np.float64]]:
    """The row of each box and cylinder, by its index."""
    return [*obstacles.boxes, *obstacles.cylinders]


def _box_row(box: Any) -> list[float]:
    """Row of `Obstacles.boxes`. A yaw of 0 has a sine of exactly 0, for which the kernels use a faster path."""
    (x, y), size_x, size_y = box.centre, box.x[1] - box.x[0], box.y[1] - box.y[0]
    return [x, y, 0.5 * size_x, 0.5 * size_y, *box.z, math.cos(box.yaw), math.sin(box.yaw), 1.0]


def _cylinder_row(cylinder: Any) -> list[float]:
    """Row of `Obstacles.cylinders`."""
    return [cylinder.x, cylinder.y, cylinder.radius, *cylinder.z, 1.0]


def _raster_arrays(raster: Any) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """`gaps` and `raster` of `Obstacles`; in a raster without occupied cells, every gap is large."""
    if raster is None:
        return np.zeros((0, 0), np.float32), np.zeros(7)
    origin = raster.origin
    frame = [origin.x, origin.y, math.cos(origin.heading), math.sin(origin.heading), raster.resolution, *raster.z]
    return _gaps_of(np.asarray(raster.occupied, dtype=bool)), np.array(frame)


def _gaps_of(occupied: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Distance of each cell from the nearest occupied one, cells."""
    key = (blake2b(np.packbits(occupied).tobytes()).digest(), occupied.shape)
    gaps = _GAPS.get(key)
    if gaps is None:
        found = distance_transform_edt(~occupied) if occupied.any() else np.full(occupied.shape, sum(occupied.shape))
        gaps = _GAPS[key] = np.ascontiguousarray(found, dtype=np.float32)
    return gaps

"""The world as arrays: which obstacles are present, and where, at a run time."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from navloom_sensors_sim.casting import Obstacles

__all__ = ["Scene"]

PositionAt = Callable[[Any, bool, float], tuple[float, float]]


class Scene:
    """Ground truth at one moment.

    Attributes:
        obstacles: Arrays that the kernels read; `update` changes them in place.
        opaque: The same without glass, for lasers; the same object if there is no glass.
        names: Name of each obstacle by its index: boxes, cylinders, raster.
    """

    def __init__(self, solids: Sequence[Any], raster: Any, position_at: PositionAt, sweeps: bool) -> None:
        """Build the arrays of a world.

        Args:
            solids: Boxes and cylinders (those with a `radius`), with the attributes of navloom's Box and Cylinder.
            raster: An object with the attributes of navloom's Raster, or None.
            position_at: Centre of a moving obstacle, m, by its waypoints, whether it loops, and the time, s.
            sweeps: Whether the robot has a pitched laser. If not, obstacles that appear after its first sweep are
                present from the start.
        """
        boxes = [solid for solid in solids if not hasattr(solid, "radius")]
        cylinders = [solid for solid in solids if hasattr(solid, "radius")]
        solids = [*boxes, *cylinders]
        self.names = tuple(o.name for o in solids) + ((raster.name,) if raster is not None else ())
        self.obstacles = Obstacles(
            np.array([_box_row(box) for box in boxes]).reshape(-1, 9),
            np.array([_cylinder_row(cylinder) for cylinder in cylinders]).reshape(-1, 6),
            *_raster_arrays(raster),
        )
        self._sweeps, self._position_at = sweeps, position_at
        self.opaque = _without_glass(self.obstacles, solids)
        arrays = (self.obstacles,) if self.opaque is self.obstacles else (self.obstacles, self.opaque)
        # Obstacles that can change, each with its row in the arrays, which is a view; glass stays absent for lasers.
        self._changing = [
            (o, row)
            for kind in arrays
            for o, row in zip(solids, _rows(kind), strict=True)
            if (o.waypoints or o.appears_after_sweep or o.appears_at > 0.0)
            and (kind is self.obstacles or o.material != "glass")
        ]

    def update(self, time: float, swept: bool) -> None:
        """Update positions and presence for a run time, s; `swept`: whether the first sweep has ended."""
        for obstacle, row in self._changing:
            if obstacle.waypoints:
                row[:2] = self._position_at(obstacle.waypoints, obstacle.loops, time)
            if obstacle.appears_after_sweep:
                row[-1] = swept or not self._sweeps
            else:
                row[-1] = time >= obstacle.appears_at

    def name_of(self, index: int) -> str:
        """Name of an obstacle by its index, empty for none."""
        return self.names[index] if index >= 0 else ""


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
    occupied = np.asarray(raster.occupied, dtype=bool)
    if occupied.any():
        gaps = distance_transform_edt(~occupied)
    else:
        gaps = np.full(occupied.shape, float(sum(occupied.shape)))
    origin = raster.origin
    frame = [origin.x, origin.y, math.cos(origin.heading), math.sin(origin.heading), raster.resolution, *raster.z]
    return np.ascontiguousarray(gaps, dtype=np.float32), np.array(frame)

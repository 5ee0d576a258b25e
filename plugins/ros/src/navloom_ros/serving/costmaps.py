"""What Nav2's costmaps and its collision monitor publish, from the robot's map and the status of its gate."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navloom_ros.message_types import Types
from navloom_ros.serving.map_cells import OCCUPIED, UNKNOWN
from navloom_ros.translating import Translated

__all__ = ["inflated", "local_costmap", "monitor_state"]

HALF = 3.0
"""Half the width of the local costmap, m, as in Nav2's default parameters."""
INSCRIBED = 99
"""Value of cells where the robot's centre cannot be at any heading, as Nav2 publishes its inflation layer."""
_DO_NOTHING, _STOP, _SLOWDOWN = range(3)


def inflated(cells: NDArray[np.int8], radius: float) -> NDArray[np.int8]:
    """The cells of a map with the free ones near an obstacle raised to INSCRIBED; unknown ones stay unknown.

    Args:
        cells: (rows, cols) 0 free to 100 occupied, or UNKNOWN.
        radius: Inscribed radius of the robot, cells: the least distance of a cell's centre from an obstacle's cell.
    """
    rows, columns = cells.shape
    # counts[r, c]: obstacles left of column c in row r, so that a difference counts those in a part of the row.
    counts = np.zeros((rows, columns + 1), np.int32)
    np.cumsum(cells >= OCCUPIED, axis=1, out=counts[:, 1:])
    near = np.zeros(cells.shape, np.bool_)
    every = np.arange(columns)
    for row in range(math.ceil(radius + 0.5)):
        across = math.sqrt(max(0.0, radius**2 - max(0.0, row - 0.5) ** 2))
        reach = math.ceil(across + 0.5 - 1e-9) - 1
        if reach < 0 or row >= rows:
            break
        part = counts[:, np.minimum(every + reach + 1, columns)] > counts[:, np.maximum(every - reach, 0)]
        near[row:] |= part[: rows - row]
        near[: rows - row] |= part[row:]
    raised: NDArray[np.int8] = np.where(near & (cells != UNKNOWN) & (cells < OCCUPIED), np.int8(INSCRIBED), cells)
    return raised


def local_costmap(types: Types, grid: Any, base: tuple[float, float], header: dict[str, Any]) -> Translated:
    """The part of the map within HALF of the robot along the axes of the map's raster; `base`: x, y, m, map frame."""
    cos, sin, size = math.cos(grid.origin.heading), math.sin(grid.origin.heading), grid.resolution
    x, y = base[0] - grid.origin.x, base[1] - grid.origin.y
    column, row = (math.floor((value - HALF) / size) for value in (cos * x + sin * y, cos * y - sin * x))
    width = 2 * round(HALF / size)
    first = max(0, row), max(0, column)
    cells = grid.cells[first[0] : max(0, row + width), first[1] : max(0, column + width)]
    right, up = first[1] * size, first[0] * size
    turned = {"z": math.sin(grid.origin.heading / 2), "w": math.cos(grid.origin.heading / 2)}
    corner = {"x": grid.origin.x + cos * right - sin * up, "y": grid.origin.y + sin * right + cos * up}
    info = {"map_load_time": header["stamp"], "resolution": size, "width": cells.shape[1], "height": cells.shape[0],
            "origin": {"position": corner, "orientation": turned}}  # fmt: skip
    message = types.new("nav_msgs/msg/OccupancyGrid", header=header, info=info, data=cells.reshape(-1))
    return Translated("/local_costmap/costmap", message)


def monitor_state(types: Types, status: Any) -> Translated:
    """What the gate's monitor does: `status` is a `navloom.messages.GateStatus`."""
    is_stop = status.stopped and status.why is not None and status.why.kind in ("obstacle", "no_room")
    action = _STOP if is_stop else _SLOWDOWN if status.limit and status.share < 1.0 else _DO_NOTHING
    values = {"action_type": action, "polygon_name": status.limit if action else ""}
    return Translated("/collision_monitor_state", types.new("nav2_msgs/msg/CollisionMonitorState", **values))

"""What Nav2's costmaps and its collision monitor publish, from the robot's map and the status of its gate."""

from __future__ import annotations

import math
from typing import Any

from navloom_ros.message_types import Types
from navloom_ros.translating import Translated

__all__ = ["local_costmap", "monitor_state"]

HALF = 3.0
"""Half the width of the local costmap, m, as in Nav2's default parameters."""
_DO_NOTHING, _STOP, _SLOWDOWN = range(3)


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

"""The plugins `ros_map` and `ros_path`: a map and paths from a ROS network behind the roles of mapper and planner."""

from __future__ import annotations

from typing import Any

import numpy as np
from navloom import (
    Context,
    InputError,
    Mapper,
    MapperInput,
    MapUpdate,
    OccupancyGrid,
    Path,
    PlanFailure,
    Planner,
    PlannerInput,
    Point2D,
    Pose2D,
)

from navloom_ros.elsewhere.asking import PathSource
from navloom_ros.elsewhere.params import RosMapParams, RosPathParams
from navloom_ros.elsewhere.reading import cells_of
from navloom_ros.errors import RosError, Unusable
from navloom_ros.joining import Joining
from navloom_ros.node import Node
from navloom_ros.params import network_of
from navloom_ros.qos import LATCHED
from navloom_ros.topics import Subscription

__all__ = ["RosMap", "RosPath"]


class RosMap(Mapper[RosMapParams]):
    """Publishes each map that a ROS node publishes; uses no sensor."""

    name = "ros_map"
    is_bridge = True
    accepts = ()
    needs_sensor = False
    Params = RosMapParams

    def __init__(self, params: RosMapParams, context: Context) -> None:
        super().__init__(params, context)
        self._maps: Subscription | None = None
        self._last: OccupancyGrid | None = None
        self._joining = _joined(params, self._set_up)

    def configure(self, params: Any) -> None:
        self._joining.close()
        super().configure(params)

    def update(self, given: MapperInput) -> MapUpdate | None:
        """The newest map if there is a new one; on a clear request, the last one again; otherwise None.

        Raises:
            InputError: The map is in the wrong frame or has invalid values.
        """
        self._joining.start()
        newest = None
        while self._maps is not None and (received := self._maps.take()) is not None:
            newest = received.message
        if newest is not None and self._maps is not None:
            if newest.header.frame_id.lstrip("/") != self.params.frame:
                frame = newest.header.frame_id
                raise InputError(
                    f"{self._maps.entity.name}: a map in the frame {frame!r}; expected {self.params.frame!r}"
                )
            try:
                cells, resolution, place = cells_of(newest)
            except Unusable as error:
                raise InputError(f"{self._maps.entity.name}: {error}") from None
            self._last = OccupancyGrid(cells, resolution, Pose2D(*place))
        if self._last is None or (newest is None and not given.clear):
            return None
        return MapUpdate(given.stamp_ns, self._last, np.empty((0, 4)), ())

    def _set_up(self, node: Node) -> None:
        self._maps = node.subscription(self.params.topic, "nav_msgs/msg/OccupancyGrid", LATCHED)


class RosPath(Planner[RosPathParams]):
    """Requests each path from a ROS node, with a deadline."""

    name = "ros_path"
    is_bridge = True
    Params = RosPathParams

    def __init__(self, params: RosPathParams, context: Context) -> None:
        super().__init__(params, context)
        self._source = PathSource(params.service, params.goal_topic, params.path_topic, params.frame)
        self._joining = _joined(params, self._source.set_up)

    def configure(self, params: Any) -> None:
        self._joining.close()
        super().configure(params)

    def plan(self, given: PlannerInput) -> Path | PlanFailure:
        request = given.request
        start, goal = request.start, request.goal
        if self._joining.start(self.params.deadline) is None:
            return PlanFailure(request.request_id, "no_path", Point2D(start.x, start.y), self._joining.why)
        try:
            points = self._source.ask(
                (start.x, start.y, start.heading), (goal.x, goal.y, goal.heading), self.params.deadline
            )
        except RosError as error:
            return PlanFailure(request.request_id, "no_path", Point2D(start.x, start.y), str(error))
        length = float(np.hypot(*np.diff(points, axis=0).T).sum())
        return Path(request.request_id, points, length, None)


def _joined(params: RosMapParams | RosPathParams, set_up: Any) -> Joining:
    try:
        return Joining(network_of(params), set_up)
    except RosError as error:
        raise InputError(str(error)) from None

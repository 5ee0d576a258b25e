"""Requests paths on a ROS network for `ros_path`: from a service, or by a goal topic and a path topic."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from navloom_ros.elsewhere.reading import points_of, pose_of
from navloom_ros.errors import Unusable
from navloom_ros.node import Node
from navloom_ros.services import Client
from navloom_ros.topics import Publisher, Subscription

__all__ = ["PathSource"]

Pose = tuple[float, float, float]


class PathSource:
    """A planner on the ROS network.

    Args:
        service: A nav_msgs/srv/GetPlan; if empty, the topics are used.
        goal_topic, path_topic: Topics to publish the goal on and to read the path from.
        frame: Frame of goals and paths.
    """

    def __init__(self, service: str, goal_topic: str, path_topic: str, frame: str) -> None:
        self._service, self._goal_topic, self._path_topic, self._frame = service, goal_topic, path_topic, frame
        self._client: Client | None = None
        self._goals: Publisher | None = None
        self._paths: Subscription | None = None

    def set_up(self, node: Node) -> None:
        """Declare the service client, or the publisher and the subscription, on a node."""
        if self._service:
            self._client = node.client(self._service, "nav_msgs/srv/GetPlan")
        else:
            self._paths = node.subscription(self._path_topic, "nav_msgs/msg/Path")
            self._goals = node.publisher(self._goal_topic, "geometry_msgs/msg/PoseStamped")

    def ask(self, start: Pose, goal: Pose, deadline: float) -> NDArray[np.float64]:
        """Request a path and wait for it.

        Args:
            start, goal: x, y, m, heading, rad. The topics send the goal only.
            deadline: Longest wait, s.

        Returns:
            (n, 2) points from start to goal, m, in the frame.

        Raises:
            Unusable: No path arrived in time, or it has invalid values.
            RosError: The service does not answer.
        """
        if self._client is not None:
            asked = {"start": pose_of(*start, self._frame), "goal": pose_of(*goal, self._frame)}
            return points_of(self._client.call(asked, deadline).plan, self._frame)
        assert self._goals is not None and self._paths is not None
        while self._paths.take() is not None:  # answers to earlier requests
            pass
        self._goals.publish(**pose_of(*goal, self._frame))
        received = self._paths.take(deadline)
        if received is None:
            raise Unusable(f"no path on {self._paths.entity.name} within {deadline:g} s of the goal on "
                           f"{self._goals.entity.name}")  # fmt: skip
        return points_of(received.message, self._frame)

"""Parameters of the mapper `ros_map` and the planner `ros_path`."""

from __future__ import annotations

from pydantic import Field

from navloom_ros.params import Ros2Network

__all__ = ["RosMapParams", "RosPathParams"]


class RosMapParams(Ros2Network):
    """Parameters of `ros_map`."""

    topic: str = Field("map", description="A latched nav_msgs/msg/OccupancyGrid.")
    frame: str = Field("map", description="Frame that the map must be in.")
    node: str = Field("navloom_map", description="Name of the ROS node.")


class RosPathParams(Ros2Network):
    """Parameters of `ros_path`."""

    service: str = Field(
        "", description="nav_msgs/srv/GetPlan to call; if empty, goal_topic and path_topic are used instead."
    )
    goal_topic: str = Field(
        "goal_pose", description="geometry_msgs/msg/PoseStamped: where the goal of each request is published."
    )
    path_topic: str = Field("plan", description="nav_msgs/msg/Path: the next path is the answer.")
    deadline: float = Field(2.0, gt=0.0, le=30.0, description="Longest wait for a path, s.")
    frame: str = Field("map", description="Frame of goals and paths.")
    node: str = Field("navloom_path", description="Name of the ROS node.")

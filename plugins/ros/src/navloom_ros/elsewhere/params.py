"""Parameters of the mapper `ros_map` and the planner `ros_path`."""

from __future__ import annotations

from pydantic import Field

from navloom_ros.params import Ros2Network

__all__ = ["RosMapParams", "RosPathParams"]


class RosMapParams(Ros2Network):
    """Parameters of `ros_map`."""

    topic: str = Field("/map", description="nav_msgs/msg/OccupancyGrid, latched.")
    frame: str = Field("map", description="The frame it has to be in.")
    node: str = Field("navloom_map", description="Name of the ROS node.")


class RosPathParams(Ros2Network):
    """Parameters of `ros_path`."""

    service: str = Field(
        "", description="nav_msgs/srv/GetPlan that is asked; where empty, goal_topic tells and path_topic answers."
    )
    goal_topic: str = Field("/goal_pose", description="geometry_msgs/msg/PoseStamped: the goal of each request.")
    path_topic: str = Field("/plan", description="nav_msgs/msg/Path: the first one after it is the answer.")
    deadline: float = Field(2.0, gt=0.0, le=30.0, description="s to wait for a path.")
    frame: str = Field("map", description="The frame of goals and paths.")
    node: str = Field("navloom_path", description="Name of the ROS node.")

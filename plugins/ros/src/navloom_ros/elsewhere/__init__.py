"""The mapper `ros_map` and the planner `ros_path`: maps and paths from ROS nodes such as a map server or a planner."""

from navloom import Registry, hookimpl


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Register both."""
    from navloom_ros.elsewhere.adapter import RosMap, RosPath

    registry.add(RosMap)
    registry.add(RosPath)

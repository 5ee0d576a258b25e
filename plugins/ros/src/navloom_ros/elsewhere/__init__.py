"""Maps and paths of somebody else's ROS nodes: the mapper `ros_map` and the planner `ros_path`."""

from navloom import Registry, hookimpl


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add both."""
    from navloom_ros.elsewhere.adapter import RosMap, RosPath

    registry.add(RosMap)
    registry.add(RosPath)

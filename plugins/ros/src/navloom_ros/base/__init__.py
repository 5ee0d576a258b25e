"""The platform `ros2_base`: drives a robot on a ROS 2 network through the robot's Zenoh router."""

from navloom import Registry, hookimpl


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Register the platform."""
    from navloom_ros.base.adapter import Ros2Base

    registry.add(Ros2Base)

"""The platform `ros2_base`: a robot on a ROS 2 network, driven over its Zenoh router."""

from navloom import Registry, hookimpl


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add the platform."""
    from navloom_ros.base.adapter import Ros2Base

    registry.add(Ros2Base)

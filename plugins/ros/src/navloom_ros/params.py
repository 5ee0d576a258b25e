"""Parameters that all plugins on a ROS network share."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from navloom import Params
from pydantic import Field

from navloom_ros.joining import Network

__all__ = ["Ros2Network", "network_of"]

Distribution = Literal["humble", "jazzy", "kilted", "lyrical"]


class Ros2Network(Params):
    """Which ROS network to join, and how."""

    router: str = Field("tcp/127.0.0.1:7447", description="Endpoint of the robot's Zenoh router.")
    domain: int = Field(0, ge=0, le=232, description="ROS_DOMAIN_ID.")
    namespace: str = Field(
        "/", description="Namespace of all names without a leading slash, which the defaults are, as /robot1."
    )
    distribution: Distribution = Field("jazzy", description="ROS 2 distribution of the robot.")
    interfaces: list[Path] = Field([], description="Folders with your own definitions, as package/msg/Name.msg.")
    remap: dict[str, str] = Field({}, description="New topic names by old name.")
    node: str = Field("navloom", description="Name of the ROS node.")


def network_of(given: Ros2Network) -> Network:
    """The network that the parameters describe."""
    folders = tuple(given.interfaces)
    return Network(given.router, given.domain, given.namespace, given.distribution, given.node, folders, given.remap)

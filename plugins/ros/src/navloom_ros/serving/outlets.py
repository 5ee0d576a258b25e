"""Which topics `navloom ros serve` publishes, from which streams of the robot, and which of them are latched."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any

from navloom_ros.errors import UnfitMessage
from navloom_ros.node import Node
from navloom_ros.qos import DEFAULT, LATCHED, Qos
from navloom_ros.topics import Publisher
from navloom_ros.translating import Translated

__all__ = ["PUBLISHED", "STREAMS", "Outlets"]

STREAMS = {
    "map": ("mapper/map",),
    "plan": ("planner/path",),
    "local_plan": ("reference/trajectory",),
    "pose": ("localizer/pose",),
    "tf": ("localizer/pose", "platform/odometry"),
    "markers": ("avoider/status", "localizer/pose"),
    "diagnostics": ("gate/status",),
    "costmaps": ("mapper/map", "localizer/pose"),
    "odometry": ("platform/odometry",),
}
"""Names for --publish, each with the robot's streams (role/port) that it needs."""
PUBLISHED = tuple(name for name in STREAMS if name != "odometry")
"""The default of --publish, without odometry: a ROS robot already publishes its own."""
_TOPICS = {
    "map": ("/map", "/map/segments"),
    "plan": ("/plan", "/plan/traversable"),
    "local_plan": ("/local_plan",),
    "pose": ("/pose",),
    "markers": ("/avoider/markers",),
    "diagnostics": ("/diagnostics", "/collision_monitor_state"),
    "costmaps": ("/global_costmap/costmap", "/local_costmap/costmap"),
    "odometry": ("/odom",),
}
"""Topics of each name, except /tf."""
AMCL_POSE = "/amcl_pose"
"""The pose again, under the name and latched as Nav2's localizer publishes it."""
_KEPT = (
    AMCL_POSE,
    "/global_costmap/costmap",
    "/local_costmap/costmap",
    "/map",
    "/map/segments",
    "/plan",
    "/plan/traversable",
    "/local_plan",
)
"""Latched topics: late joiners get the last message."""
_TF = Qos(depth=100)
MOST_SAID = 20
"""Most reasons that are shown."""


class Outlets:
    """Publishes those messages of a `Translator` that --publish names.

    Args:
        node: Node that publishes.
        wanted: Keys of STREAMS.
        say: Shows a line to the user, once for each reason why a message cannot be published.
    """

    def __init__(self, node: Node, wanted: Collection[str], say: Callable[[str], None]) -> None:
        self._node, self._wanted, self._say = node, wanted, say
        self._topics = {topic for name in wanted for topic in _TOPICS.get(name, ())}
        self._publishers: dict[str, Publisher] = {}
        self._said: set[str] = set()

    def put(self, made: Translated) -> None:
        """Publish a message if its topic is wanted."""
        if made.topic not in self._topics and not self._is_wanted_transform(made):
            return
        if self._put(made.topic, made.message) and made.topic == "/pose":
            self._put(AMCL_POSE, made.message)

    def _put(self, topic: str, message: Any) -> bool:
        publisher = self._publishers.get(topic)
        if publisher is None:
            qos = LATCHED if topic in _KEPT else _TF if topic == "/tf" else DEFAULT
            # Relative, so that a namespace separates two robots of one network; /tf as well, as Nav2 does it.
            name, kind = topic.removeprefix("/"), str(message.__msgtype__)
            publisher = self._publishers[topic] = self._node.publisher(name, kind, qos)
        try:
            publisher.publish(message)
        except UnfitMessage as error:
            text = f"{topic} is not published: {error}"
            if text not in self._said and len(self._said) < MOST_SAID:
                self._said.add(text)
                self._say(text)
            return False
        return True

    def _is_wanted_transform(self, made: Translated) -> bool:
        if made.topic != "/tf":
            return False
        parents: set[Any] = {transform.header.frame_id for transform in made.message.transforms}
        return ("tf" in self._wanted and "map" in parents) or ("odometry" in self._wanted and "odom" in parents)

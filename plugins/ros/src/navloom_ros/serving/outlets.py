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
    "diagnostics": ("/diagnostics",),
    "odometry": ("/odom",),
}
"""Topics of each name, except /tf."""
_KEPT = ("/map", "/map/segments", "/plan", "/plan/traversable", "/local_plan")
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
        publisher = self._publishers.get(made.topic)
        if publisher is None:
            qos = LATCHED if made.topic in _KEPT else _TF if made.topic == "/tf" else DEFAULT
            kind = str(made.message.__msgtype__)
            publisher = self._publishers[made.topic] = self._node.publisher(made.topic, kind, qos)
        try:
            publisher.publish(made.message)
        except UnfitMessage as error:
            text = f"{made.topic} is not published: {error}"
            if text not in self._said and len(self._said) < MOST_SAID:
                self._said.add(text)
                self._say(text)

    def _is_wanted_transform(self, made: Translated) -> bool:
        if made.topic != "/tf":
            return False
        parents: set[Any] = {transform.header.frame_id for transform in made.message.transforms}
        return ("tf" in self._wanted and "map" in parents) or ("odometry" in self._wanted and "odom" in parents)

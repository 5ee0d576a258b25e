"""The connection of the platform `ros2_base` to the robot's ROS network: topics in, velocities out, and the guardian.

The network is joined in the background. Zenoh reconnects by itself when the router restarts.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from navloom_ros.base.guardian import Guard, velocity
from navloom_ros.joining import Joining, Network
from navloom_ros.node import Node
from navloom_ros.qos import DEFAULT, Qos
from navloom_ros.topics import Publisher, Received, Subscription

__all__ = ["FLOWING", "TRANSFORMS", "Link", "Settings", "Topic"]

READINGS = Qos(reliable=False, depth=20)
"""Quality of service of sensor data; the depth covers the messages between two ticks."""
TRANSFORMS = Qos(transient_local=True, depth=100)
"""Quality of service of /tf_static; the depth covers several nodes that each publish their own transforms."""
FLOWING = Qos(depth=200)
"""Quality of service of /tf and /clock, which arrive at hundreds of Hz."""


@dataclass(frozen=True)
class Topic:
    """A topic to read.

    Attributes:
        name: Its ROS name.
        kind: Its type, as `nav_msgs/msg/Odometry`.
        qos: Quality of service of the subscription.
    """

    name: str
    kind: str
    qos: Qos = READINGS


@dataclass(frozen=True)
class Settings:
    """Where the robot is and how it takes commands.

    Attributes:
        network: The robot's ROS network.
        command: Topic of velocity commands.
        stamped: Commands are TwistStamped.
        frame: Frame of a TwistStamped.
        silence: Time without a tick after which the guardian stops the base, s.
    """

    network: Network
    command: str
    stamped: bool
    frame: str
    silence: float

    @property
    def kind(self) -> str:
        """Message type of the commands."""
        return "geometry_msgs/msg/TwistStamped" if self.stamped else "geometry_msgs/msg/Twist"

    def for_guardian(self) -> dict[str, object]:
        """The settings of the guardian, of types that JSON has."""
        network = {**vars(self.network), "folders": [str(folder) for folder in self.network.folders]}
        network["node"] = f"{self.network.node}_guardian"
        return {**vars(self), "network": network}


class Link:
    """Reads topics and sends velocities. The first call of `send` or `problem` joins the network.

    Args:
        settings: Where the robot is and how it takes commands.
        topics: By name, the topics to read; nothing else of the network is received.

    Attributes:
        types: Types of the robot's distribution.

    Raises:
        RosError: A type that the distribution does not have, or a definition that cannot be used.
    """

    def __init__(self, settings: Settings, topics: Mapping[str, Topic]) -> None:
        self._settings, self._topics = settings, dict(topics)
        self._publisher: Publisher | None = None
        self._subscriptions: dict[str, Subscription] = {}
        types = self.types = settings.network.types()
        for topic in topics.values():
            types.fields(topic.kind)
        self._joining = Joining(settings.network, self._set_up)
        self._guard: Guard | None = None

    def problem(self) -> str:
        """Why the base cannot be driven now; empty if it can. A dead or frozen guardian is replaced."""
        guard, node = self._started(), self._joining.node
        if not guard.is_alive:
            # Killed: two guardians would both publish.
            guard.close(is_frozen=True)
            self._guard = Guard(self._settings.for_guardian())
            return "the guardian's process has ended or hangs; a new one is starting"
        if node is None:
            return self._joining.why
        if not node.wire.joined:
            return f"the link to the router {self._settings.network.router} is down"
        # Nothing moves without a guardian that could stop it.
        if not guard.is_ready:
            return "the guardian's process is starting"
        return self._base_problem(node)

    def take(self, name: str) -> Iterator[Received]:
        """Messages of a topic since the last call, oldest first."""
        subscription = self._subscriptions.get(name)
        while subscription is not None and (received := subscription.take()) is not None:
            yield received

    def why_silent(self, name: str) -> str:
        """Why no message of a topic arrives; empty if the reason is not known."""
        node, topic, subscription = self._joining.node, self._topics[name].name, self._subscriptions.get(name)
        if node is None or subscription is None:
            return self._joining.why
        if subscription.unread:
            return f"{subscription.unread} messages could not be read, the last one: {subscription.reason}"
        if others := node.mismatches(topic):
            ours = f"{subscription.entity.type_name} of {self.types.distribution}"
            return f"it is published as {others[0].type_name}, {others[0].type_hash}; expected {ours}"
        if not node.graph.find(subscription.entity.name, ("MP",)):
            return f"no node publishes it{node.graph.alike(subscription.entity.name, 'MP')}"
        return ""

    def send(self, vx: float, vy: float, wz: float, stamp_ns: int | None) -> None:
        """Send a velocity, m/s and rad/s.

        Args:
            vx, vy, wz: In the base frame.
            stamp_ns: Time on the robot's clock; None if that is unknown.
        """
        # Before the command: if this process dies in between, the guardian knows that the robot moves.
        self._started().beat(bool(vx or vy or wz), stamp_ns)
        if self._publisher is not None:
            settings = self._settings
            self._publisher.publish(velocity(self.types, settings.stamped, vx, vy, wz, settings.frame, stamp_ns))

    def close(self) -> None:
        """Leave the network. The guardian stops the base and exits."""
        if self._guard is not None:
            self._guard.close()
        self._joining.close()

    def _started(self) -> Guard:
        """The guardian. The first call starts it and begins to join the network."""
        if self._guard is None:
            self._joining.start()
            self._guard = Guard(self._settings.for_guardian())
        return self._guard

    def _set_up(self, node: Node) -> None:
        for name, topic in self._topics.items():
            self._subscriptions[name] = node.subscription(topic.name, topic.kind, topic.qos)
        self._publisher = node.publisher(self._settings.command, self._settings.kind, DEFAULT)

    def _base_problem(self, node: Node) -> str:
        """Why no base receives the commands; empty if one does."""
        assert self._publisher is not None
        ours = self._publisher.entity
        listeners = node.graph.find(ours.name, ("MS",))
        # A subscriber of another type receives nothing, and says nothing about it.
        if any((listener.type_name, listener.type_hash) == (ours.type_name, ours.type_hash) for listener in listeners):
            return ""
        if not listeners:
            alike = node.graph.alike(ours.name, "MS")
            return f"no node subscribes to {ours.name}{alike or ': is the base running?'}"
        other = listeners[0]
        hint = f"; set stamped = {str(not self._settings.stamped).lower()}" if "/Twist" in other.type_name else ""
        if other.type_name == ours.type_name:
            hint = f": hash {other.type_hash} is not that of {self.types.distribution}; set distribution"
        return f"{other.full_node_name} subscribes to {ours.name} as {other.type_name}, not {ours.type_name}{hint}"

"""`Node`: a ROS node in plain Python, which declares publishers, subscriptions, services and clients.

`topics` and `services` have what it declares, `wire` its Zenoh session, `graph` the other nodes of the network.
"""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Callable, Mapping
from types import TracebackType
from typing import Any

from navloom_ros.errors import RosError
from navloom_ros.graph import Graph
from navloom_ros.message_types import Types
from navloom_ros.names import check_namespace, check_node_name, full_name, key_of
from navloom_ros.qos import DEFAULT, SERVICES, Qos
from navloom_ros.services import Call, Client, Service
from navloom_ros.tokens import PREFIX, Entity
from navloom_ros.topics import Publisher, Subscription
from navloom_ros.wire import ROUTER, Wire, epoch_ns

__all__ = ["Node"]

LARGEST_DOMAIN = 232
"""Largest ROS_DOMAIN_ID."""


class Node:
    """A node on a robot's ROS network. Use it in a `with` statement.

    Args:
        name, namespace: ROS name and namespace of the node.
        router: Endpoint of the robot's Zenoh router.
        domain: ROS_DOMAIN_ID.
        types: Types of the robot's distribution; by default those of Jazzy.
        remap: New names by old name, as from `names.remapping`.

    Attributes:
        graph: The nodes and endpoints of the domain, this node included.
        now_ns: The node's time, ns, for stamps; that of this host, unless it is given another clock.

    Raises:
        NoRouter: No router answers at the endpoint.
        BadName: A name that ROS does not allow.
        RosError: The domain is out of range.
    """

    def __init__(
        self,
        name: str,
        *,
        namespace: str = "/",
        router: str = ROUTER,
        domain: int = 0,
        types: Types | None = None,
        remap: Mapping[str, str] | None = None,
    ) -> None:
        self.name = check_node_name(name)
        self.namespace = check_namespace(namespace)
        if not 0 <= domain <= LARGEST_DOMAIN:
            raise RosError(f"ROS domain {domain}: expected 0 to {LARGEST_DOMAIN}")
        self.domain = domain
        self.types = types or Types()
        self.graph = Graph()
        self.now_ns: Callable[[], int] = epoch_ns
        self._remap = dict(remap or {})
        self._changed = threading.Condition()
        self._ends: list[Callable[[], None]] = []
        self._numbers = itertools.count(1)
        self.wire = Wire(router, self.types.largest)
        try:
            self.keep(self.wire.watch(f"{PREFIX}/{domain}/**", self._on_token))
            self._declare(Entity("NN", domain, self.wire.session, "0", "0", self.namespace, self.name))
        # Also at Ctrl-C: an open session would keep its threads and its tokens.
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Node:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Withdraw everything that the node has declared, and leave the network."""
        # The node's own token, declared first, outlives those of its endpoints.
        for end in reversed(self._ends):
            end()
        self._ends.clear()
        self.wire.close()

    def keep(self, end: Callable[[], None]) -> None:
        """Register a function to call when the node closes."""
        self._ends.append(end)

    def publisher(self, topic: str, type_name: str, qos: Qos = DEFAULT) -> Publisher:
        """Declare a publisher."""
        entity, key = self._endpoint("MP", topic, type_name, qos)
        made = Publisher(self.wire, self.types, self.keep, entity, key)
        self._declare(entity)
        return made

    def subscription(self, topic: str, type_name: str, qos: Qos = DEFAULT) -> Subscription:
        """Declare a subscription; nothing else of the network is received."""
        entity, key = self._endpoint("MS", topic, type_name, qos)
        made = Subscription(self.wire, self.types, self.keep, entity, key)
        self._declare(entity)
        return made

    def service(self, name: str, type_name: str, handler: Callable[[Call], None]) -> Service:
        """Offer a service. `handler` receives each call on a thread of the service, and may answer it later."""
        entity, key = self._endpoint("SS", name, type_name, SERVICES)
        made = Service(self.wire, self.types, self.keep, entity, key, handler)
        self._declare(entity)
        return made

    def client(self, name: str, type_name: str) -> Client:
        """Declare a client of a service."""
        entity, key = self._endpoint("SC", name, type_name, SERVICES)
        self._declare(entity)
        return Client(self.wire, self.types, entity, key)

    def wait_for(self, condition: Callable[[Graph], Any], timeout: float) -> Any:
        """Wait until `condition` of the graph is true, at most `timeout` s; returns its last value."""
        with self._changed:
            return self._changed.wait_for(lambda: condition(self.graph), timeout)

    def settle(self, quiet: float = 0.3, longest: float = 3.0) -> None:
        """Wait until the graph has not changed for `quiet` s, at most `longest` s, to discover existing nodes."""
        end = time.monotonic() + longest
        with self._changed:
            # There is no message that says that discovery is complete; quiet is the only sign of it.
            while time.monotonic() < end and self._changed.wait(quiet):
                pass

    def mismatches(self, topic: str) -> list[Entity]:
        """Publishers of a topic that this node's subscriptions cannot receive: their type or its hash differs."""
        name = full_name(topic, self.namespace, self.name, self._remap)
        ours = {(one.type_name, one.type_hash) for one in self.graph.find(name, ("MS",)) if self._is_own(one)}
        return [one for one in self.graph.find(name, ("MP",)) if ours and (one.type_name, one.type_hash) not in ours]

    def _is_own(self, entity: Entity) -> bool:
        return entity.session == self.wire.session

    def _endpoint(self, kind: str, name: str, type_name: str, qos: Qos) -> tuple[Entity, str]:
        full = full_name(name, self.namespace, self.name, self._remap)
        type_hash = self.types.hash_of(type_name)
        number = str(next(self._numbers))
        own = (kind, self.domain, self.wire.session, "0", number, self.namespace, self.name)
        return Entity(*own, full, type_name, type_hash, qos), key_of(self.domain, full, type_name, type_hash)

    def _declare(self, entity: Entity) -> None:
        self.keep(self.wire.token(entity.token))

    def _on_token(self, token: str, is_there: bool) -> None:
        with self._changed:
            # Under the lock: Zenoh calls this on its own threads, while others read the graph.
            (self.graph.add if is_there else self.graph.remove)(token)
            self._changed.notify_all()

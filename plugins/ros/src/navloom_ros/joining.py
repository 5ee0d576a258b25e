"""A node that joins its network in the background: a robot that is switched on later is found when it is there."""

from __future__ import annotations

import threading
import weakref
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from navloom_ros.errors import RosError
from navloom_ros.message_types import Types
from navloom_ros.node import Node

__all__ = ["Joining", "Network"]

AGAIN = 1.0
"""s between two tries to join the network."""


@dataclass(frozen=True)
class Network:
    """A ROS network, and the name of a node there: as `Node` and `Types` take them."""

    router: str
    domain: int
    namespace: str
    distribution: str
    node: str
    folders: tuple[Path, ...] = ()
    remap: Mapping[str, str] = field(default_factory=dict)

    def types(self) -> Types:
        """Of the distribution. Raises RosError."""
        return Types(self.distribution, self.folders)

    def join(self, types: Types, name: str = "") -> Node:
        """A node on it, by another name perhaps. Raises RosError."""
        return Node(
            name or self.node, namespace=self.namespace, router=self.router, domain=self.domain, types=types,
            remap=self.remap,
        )  # fmt: skip


class Joining:
    """Tries until the node is there.

    Args:
        network: To join.
        set_up: Called once with the node, before others see it; it declares what the node reads and offers.

    Attributes:
        types: Of the network.
        node: None until it has joined.
        why: Why it has not joined yet.

    Raises:
        RosError: The network's types cannot be had.
    """

    def __init__(self, network: Network, set_up: Callable[[Node], None]) -> None:
        self.types = network.types()
        self.node: Node | None = None
        self.why = f"no link to {network.router} yet"
        self._network, self._set_up = network, set_up
        self._closing, self._lock = threading.Event(), threading.Lock()
        self._at_exit = weakref.finalize(self, lambda: None)
        threading.Thread(target=self._join, name="ros joining", daemon=True).start()

    def close(self) -> None:
        """Leave the network, or join no more."""
        self._closing.set()
        with self._lock:
            self._at_exit()

    def _join(self) -> None:
        while not self._closing.is_set():
            try:
                node = self._network.join(self.types)
            except RosError as error:
                self.why = str(error)
                self._closing.wait(AGAIN)
                continue
            with self._lock:
                self._at_exit = weakref.finalize(self, node.close)  # an open session hangs the process at its end
                if self._closing.is_set():
                    self._at_exit()
                    return
                self._set_up(node)
                self.node = node
            return

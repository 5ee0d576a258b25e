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
LONGEST = 5.0
"""s that one try takes at most."""


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
    """Tries until the node is there, once it was started.

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
        self._closing, self._tried, self._lock = threading.Event(), threading.Event(), threading.Lock()
        self._thread: threading.Thread | None = None

    def start(self, timeout: float = 0.0) -> Node | None:
        """Begin to join, if that has not begun; the node, where it is there within some s."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._join, name="ros joining", daemon=True)
            # A thread that is within Zenoh when Python ends would end the process by a signal.
            weakref.finalize(self, _end, self._closing, self._thread)
            self._thread.start()
        self._tried.wait(timeout)
        return self.node

    def close(self) -> None:
        """Leave the network, or join no more."""
        self._closing.set()
        with self._lock:
            if self.node is not None:
                self.node.close()

    def _join(self) -> None:
        while not self._closing.is_set():
            try:
                node = self._network.join(self.types)
            except RosError as error:
                self.why = str(error)
                self._tried.set()
                self._closing.wait(AGAIN)
                continue
            with self._lock:
                if self._closing.is_set():
                    node.close()
                    return
                self._set_up(node)
                self.node = node
                weakref.finalize(self, node.close)  # an open session hangs the process at its end
            self._tried.set()
            return


def _end(closing: threading.Event, thread: threading.Thread) -> None:
    closing.set()
    if thread is not threading.current_thread():
        thread.join(LONGEST)

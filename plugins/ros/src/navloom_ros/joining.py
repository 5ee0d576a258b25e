"""Joins a ROS network in the background, so that the robot may be switched on later than navloom.

The platform `ros2_base` and the plugins `ros_map` and `ros_path` use it: a plugin must not wait for a network.
"""

from __future__ import annotations

import threading
import weakref
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from navloom_ros.errors import RosError
from navloom_ros.message_types import Types
from navloom_ros.names import check_namespace, full_name
from navloom_ros.node import Node

__all__ = ["Joining", "Network"]

AGAIN = 1.0
"""Interval between two attempts to join the network, s."""
LONGEST = 5.0
"""Longest wait for the joining thread when the process ends, s. An attempt without a router took 2.0 to 2.1 s."""


@dataclass(frozen=True)
class Network:
    """A ROS network, and the name of a node on it: the arguments of `Node` and `Types`."""

    router: str
    domain: int
    namespace: str
    distribution: str
    node: str
    folders: tuple[Path, ...] = ()
    remap: Mapping[str, str] = field(default_factory=dict)

    def types(self) -> Types:
        """Types of the distribution and of the folders. Raises RosError."""
        return Types(self.distribution, self.folders)

    def full_name(self, name: str) -> str:
        """The full name of a topic after namespace and remapping. Raises BadName if ROS does not allow it."""
        return full_name(name, check_namespace(self.namespace), self.node, self.remap)

    def join(self, types: Types, name: str = "") -> Node:
        """A new node on the network; `name` replaces the default one. Raises RosError."""
        return Node(
            name or self.node, namespace=self.namespace, router=self.router, domain=self.domain, types=types,
            remap=self.remap,
        )  # fmt: skip


class Joining:
    """Joins a network on a thread, retrying until it succeeds. `start` begins.

    Args:
        network: The network.
        set_up: Called once with the node, before `node` is set; declares publishers and subscriptions.

    Attributes:
        types: Types of the network.
        node: The node; None until it has joined.
        why: Why it has not joined yet.

    Raises:
        RosError: The distribution is not known, or a definition cannot be used.
    """

    def __init__(self, network: Network, set_up: Callable[[Node], None]) -> None:
        self.types = network.types()
        self.node: Node | None = None
        self.why = f"no link to {network.router} yet"
        self._network, self._set_up = network, set_up
        self._closing, self._tried, self._lock = threading.Event(), threading.Event(), threading.Lock()
        self._thread: threading.Thread | None = None

    def start(self, timeout: float = 0.0) -> Node | None:
        """Begin to join, on the first call, and return the node; None if the first attempt has not succeeded in time.

        Args:
            timeout: Longest wait for the first attempt, s.
        """
        if self._thread is None:
            self._thread = threading.Thread(target=self._join, name="ros joining", daemon=True)
            # A thread that is inside Zenoh while Python shuts down would crash the process.
            weakref.finalize(self, _end, self._closing, self._thread)
            self._thread.start()
        self._tried.wait(timeout)
        return self.node

    def close(self) -> None:
        """Leave the network, or stop joining it."""
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
                weakref.finalize(self, node.close)  # an open session would hang the process at exit
            self._tried.set()
            return


def _end(closing: threading.Event, thread: threading.Thread) -> None:
    closing.set()
    if thread is not threading.current_thread():
        thread.join(LONGEST)

"""Serves a live robot's metrics over HTTP, for Prometheus."""

from __future__ import annotations

import threading
from collections.abc import Iterator

from navloom.errors import NavloomError
from prometheus_client import CollectorRegistry, Metric, generate_latest, start_http_server
from prometheus_client.registry import Collector

from navloom_live.operating.client import Client
from navloom_live.operating.prometheus_metrics import Stops, families
from navloom_live.operating.robot_nodes import listing, missing
from navloom_live.operating.stream_subscription import Listening

__all__ = ["BindError", "MetricsServer"]

STATUS_WAIT = 0.2
"""Longest wait for a message of the gate, s, and so the longest delay before `run` ends."""


class BindError(NavloomError, OSError):
    """The server cannot listen at the address."""


class MetricsServer(Collector):
    """Answers `GET /metrics` until it is closed. Each answer queries the robot's nodes.

    Args:
        client: Client of the robot; a viewer's certificate is enough.
        address: Host and port to listen at; port 0 takes a free one.

    Raises:
        BindError: The address is taken, or does not belong to this host.
    """

    def __init__(self, client: Client, address: tuple[str, int]) -> None:
        self._client, self._stops = client, Stops()
        self._listening = Listening(client, ["gate/status"])
        self._ends = threading.Event()
        self._one_query = threading.Lock()
        self._registry = CollectorRegistry()
        self._registry.register(self)
        try:
            self._http, self._thread = start_http_server(address[1], address[0], self._registry)
        except OSError as error:
            raise BindError(f"{address[0]}:{address[1]}: cannot be listened at: {error.strerror}") from None

    @property
    def url(self) -> str:
        """URL of the metrics."""
        host, port = self._http.server_address[:2]
        return f"http://{host!s}:{port}/metrics"

    def run(self) -> None:
        """Count the gate's stops until `close`, or Ctrl-C."""
        while not self._ends.is_set():
            for told in self._listening.take(STATUS_WAIT):
                self._stops.take(told)

    def close(self) -> None:
        """Stop serving, and end `run`."""
        self._ends.set()
        self._http.shutdown()
        self._http.server_close()
        self._thread.join()

    def text(self) -> str:
        """The current metrics."""
        return generate_latest(self._registry).decode()

    def describe(self) -> Iterator[Metric]:
        """No names in advance: registering must not query the robot."""
        return iter(())

    def collect(self) -> Iterator[Metric]:
        """The metrics at this moment."""
        with self._one_query:
            nodes = listing(self._client)
            return families(self._client.keys.prefix, nodes, len(missing(nodes)), self._stops)

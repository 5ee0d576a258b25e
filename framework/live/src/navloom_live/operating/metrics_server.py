"""Serves a live robot's metrics over HTTP, for Prometheus."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterable, Iterator

from prometheus_client import CONTENT_TYPE_PLAIN_0_0_4, CollectorRegistry, Metric, generate_latest
from prometheus_client.registry import Collector

from navloom_live.operating.client import Client
from navloom_live.operating.prometheus_metrics import Stops, families
from navloom_live.operating.robot_nodes import listing, missing
from navloom_live.operating.stream_subscription import Listening
from navloom_live.operating.web_server import Receive, Scope, Send, WebServer, guarded

__all__ = ["MetricsServer"]

STATUS_WAIT = 0.2
"""Longest wait for a message of the gate, s, and so the longest delay before `run` ends."""


class MetricsServer(Collector):
    """Answers `GET /metrics` until it is closed. Each answer queries the robot's nodes.

    Args:
        client: Client of the robot; a viewer's certificate is enough.
        address: Host and port to listen at; port 0 takes a free one.
        names: Names of this host by which a scraper may reach it, beside its addresses.

    Raises:
        web_server.BindError: The address is taken, or does not belong to this host.
    """

    def __init__(self, client: Client, address: tuple[str, int], names: Iterable[str] = ()) -> None:
        self._client, self._stops = client, Stops()
        self._listening = Listening(client, ["gate/status"])
        self._ends = threading.Event()
        self._one_query = threading.Lock()
        self._registry = CollectorRegistry()
        self._registry.register(self)
        self._server = WebServer(address)
        self._server.start(guarded(self._answer, names))

    @property
    def url(self) -> str:
        """URL of the metrics."""
        return f"{self._server.url}/metrics"

    def run(self) -> None:
        """Count the gate's stops until `close`, or Ctrl-C."""
        while not self._ends.is_set():
            for told in self._listening.take(STATUS_WAIT):
                self._stops.take(told)

    def close(self) -> None:
        """Stop serving, and end `run`."""
        self._ends.set()
        self._server.close()

    def text(self) -> str:
        """The current metrics."""
        return generate_latest(self._registry).decode()

    async def _answer(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            raise NotImplementedError  # nothing to start or end
        is_there = scope["path"] == "/metrics" and scope["method"] in ("GET", "HEAD")
        body = (await asyncio.to_thread(self.text)).encode() if is_there else b"metrics are at /metrics\n"
        kind = CONTENT_TYPE_PLAIN_0_0_4 if is_there else "text/plain"
        headers = [(b"content-type", kind.encode()), (b"content-length", str(len(body)).encode())]
        await send({"type": "http.response.start", "status": 200 if is_there else 404, "headers": headers})
        await send({"type": "http.response.body", "body": body})

    def describe(self) -> Iterator[Metric]:
        """No names in advance: registering must not query the robot."""
        return iter(())

    def collect(self) -> Iterator[Metric]:
        """The metrics at this moment."""
        with self._one_query:
            nodes = listing(self._client)
            return families(self._client.keys.prefix, nodes, len(missing(nodes)), self._stops)

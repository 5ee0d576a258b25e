"""Serves a live robot's metrics over HTTP, for Prometheus."""

from __future__ import annotations

import threading
from http.server import BaseHTTPRequestHandler, HTTPServer

from navloom.errors import NavloomError

from navloom_live.operating.client import Client
from navloom_live.operating.prometheus_metrics import CONTENT_TYPE, Stops, exposition
from navloom_live.operating.robot_nodes import listing, missing
from navloom_live.operating.stream_subscription import Listening

__all__ = ["BindError", "MetricsServer"]

REQUEST_WAIT = 2.0
"""Longest wait for a request after its connection, s; the next request waits at most that long."""
STATUS_WAIT = 0.2
"""Longest wait for a message of the gate, s, and so the longest delay before the listening thread ends."""


class BindError(NavloomError, OSError):
    """The server cannot listen at the address."""


class MetricsServer:
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
        server = self

        class Handler(BaseHTTPRequestHandler):
            timeout = REQUEST_WAIT

            def do_GET(self) -> None:
                server.answer(self)

            def log_message(self, format: str, *args: object) -> None:
                """Log nothing: a line for each scrape would be noise."""

        try:
            self._http = HTTPServer(address, Handler)
        except OSError as error:
            raise BindError(f"{address[0]}:{address[1]}: cannot be listened at: {error.strerror}") from None
        self._thread = threading.Thread(target=self._listen, daemon=True)

    @property
    def url(self) -> str:
        """URL of the metrics."""
        host, port = self._http.server_address[:2]
        return f"http://{host!s}:{port}/metrics"

    def run(self) -> None:
        """Serve until `close`, or Ctrl-C."""
        self._thread.start()
        self._http.serve_forever(poll_interval=STATUS_WAIT)

    def close(self) -> None:
        """End `run`, from another thread or after it has returned."""
        self._ends.set()
        if self._thread.is_alive():
            self._http.shutdown()
            self._thread.join()
        self._http.server_close()

    def text(self) -> str:
        """The current metrics."""
        nodes = listing(self._client)
        return exposition(self._client.keys.prefix, nodes, len(missing(nodes)), self._stops)

    def answer(self, request: BaseHTTPRequestHandler) -> None:
        """Answer a request."""
        is_known = request.path.partition("?")[0] == "/metrics"
        body = (self.text() if is_known else "expected GET /metrics\n").encode()
        request.send_response(200 if is_known else 404)
        request.send_header("Content-Type", CONTENT_TYPE)
        request.send_header("Content-Length", str(len(body)))
        request.end_headers()
        request.wfile.write(body)

    def _listen(self) -> None:
        while not self._ends.is_set():
            for told in self._listening.take(STATUS_WAIT):
                self._stops.take(told)

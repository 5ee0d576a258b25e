"""A bad link to a server on loopback: it passes few bytes a second, and each of them late."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from queue import SimpleQueue

__all__ = ["slow_link"]

PART = 1250
"""Most bytes that are passed on at once."""


@contextmanager
def slow_link(port: int, rate: float, latency: float) -> Iterator[int]:
    """Port that leads to another one of this host.

    Args:
        port: Of the server.
        rate: bytes/s, each way.
        latency: s, each way. The server sees a connection as late as the first bytes, as with a slow handshake.
    """
    opened: list[socket.socket] = []
    listening = socket.create_server(("127.0.0.1", 0))

    def narrow(made: socket.socket) -> socket.socket:
        # Otherwise the kernel takes megabytes from the server at once.
        made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        opened.append(made)
        return made

    def serve() -> None:
        with suppress(OSError):
            while True:
                browser = narrow(listening.accept()[0])
                server = narrow(socket.socket())
                there = threading.Event()
                for source, sink in ((browser, server), (server, browser)):
                    parts: SimpleQueue[tuple[float, bytes]] = SimpleQueue()
                    begun = there if source is server else None
                    threading.Thread(target=read, args=(source, parts, begun), daemon=True).start()
                    threading.Thread(target=write, args=(sink, parts, there), daemon=True).start()

    def read(source: socket.socket, parts: SimpleQueue[tuple[float, bytes]], begun: threading.Event | None) -> None:
        if begun is not None:
            begun.wait()
        data = b"."
        while data:
            try:
                data = source.recv(PART)
            except OSError:
                data = b""
            time.sleep(len(data) / rate)
            parts.put((time.monotonic() + latency, data))

    def write(sink: socket.socket, parts: SimpleQueue[tuple[float, bytes]], there: threading.Event) -> None:
        with suppress(OSError):
            while True:
                due, data = parts.get()
                time.sleep(max(0.0, due - time.monotonic()))
                if not there.is_set():
                    sink.connect(("127.0.0.1", port))
                    there.set()
                if not data:
                    break
                sink.sendall(data)
            sink.shutdown(socket.SHUT_RDWR)

    threading.Thread(target=serve, daemon=True).start()
    try:
        yield int(listening.getsockname()[1])
    finally:
        for one in (listening, *opened):
            with suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)
            one.close()

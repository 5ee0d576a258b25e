"""A router that is replaced in place, so that new certificates and rules take effect without losing a message.

Zenoh reads certificates and rules only when a session opens. So a second router opens, takes over the first one's port,
and connects to it by a socket, so that streams pass between the clients of both. The clients are notified and move to
the second router (see `Bus`), and the first closes.
"""

from __future__ import annotations

import contextlib
import os
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import replace

from navloom_live.hosting.runtime_folders import RobotFolder
from navloom_live.timing import ROUTER_REPLACED_WITHIN
from navloom_live.transport.access import HERE, IDENTITIES, MOVED
from navloom_live.transport.file_watch import FileWatch
from navloom_live.transport.links import Endpoint, Link, LinkError, credential_files, settings
from navloom_live.transport.zenoh_bus import Bus

__all__ = ["Router"]

SUCCESSOR_WAIT = 2.0
"""Longest wait until the second router knows the streams of the first, s."""


class Router:
    """A robot's router. Use it in a `with` statement.

    Args:
        link: Where it listens. Over TLS it is replaced when its certificate or the list of identities changes.
        say: Receives a message when that happens, or fails.
    """

    def __init__(self, link: Link, say: Callable[[str], None]) -> None:
        self._say = say
        self._number = 0
        self._folder = RobotFolder(link.realm, link.robot)
        self._watch: FileWatch | None = None
        if link.credentials is not None:
            self._watch = FileWatch([*credential_files(link), link.credentials / IDENTITIES])
            self._folder.make()
            link = replace(link, door=self._door(link))
        self._link = link
        self._bus = self._open(link)

    def __enter__(self) -> Router:
        return self

    def __exit__(self, *_: object) -> None:
        self._bus.close()

    def look(self, ending: threading.Event) -> None:
        """Replace the router if the files have changed; `ending` cuts the waits short."""
        if self._watch is None or not self._watch.has_changed():
            return
        self._number += 1
        link = replace(self._link, door=self._door(self._link), predecessor=self._link.door)
        try:
            settings(link)
        except LinkError as error:
            self._say(f"new certificates are refused, the old ones stay in use: {error}")
            return
        first = self._bus
        # The port must be free before the second router opens; open connections stay with the first.
        for end in link.listen:
            _stop_listening(Endpoint.parse(end).port)
        self._bus, self._link = self._open(link), link
        self._say("new connections use the new certificates")
        _await_streams(first, self._bus, link, ending)
        # Only when the second knows all streams: a client that moves must find the others there.
        first.tell(f"{link.realm}/{link.robot}/{MOVED}")
        limit = time.monotonic() + ROUTER_REPLACED_WITHIN
        while first.clients() and time.monotonic() < limit and not ending.wait(0.05):
            pass
        first.close()
        self._say("all connections use the new certificates")

    def _open(self, link: Link) -> Bus:
        bus = Bus(link)
        if self._watch is not None:
            bus.announce(f"{link.realm}/{link.robot}/{HERE}")
        return bus

    def _door(self, link: Link) -> str:
        port = Endpoint.parse(link.listen[0]).port
        return f"{self._folder.socket(f'router-{port}-{self._number}').removesuffix('.sock')}.door"


def _await_streams(first: Bus, second: Bus, link: Link, ending: threading.Event) -> None:
    """Wait until the second router knows the first one's declarations: the token declared last arrives last."""
    token = f"{link.realm}/{link.robot}/{MOVED}"
    first.announce(token)
    limit = time.monotonic() + SUCCESSOR_WAIT
    while not second.alive(token) and time.monotonic() < limit and not ending.wait(0.01):
        pass


def _stop_listening(port: int) -> None:
    """Stop this process from accepting connections on a port, but keep those that are open. Zenoh has no call for it.

    Shutting a listening socket down frees its port but keeps the file descriptor, by which Zenoh knows it.
    """
    for number in map(int, os.listdir("/proc/self/fd")):
        with contextlib.suppress(OSError):  # it is no socket
            # A fresh look at every number, because Zenoh does not tell which one is its listener.
            one = socket.socket(fileno=number)
            try:
                is_listening = one.getsockopt(socket.SOL_SOCKET, socket.SO_ACCEPTCONN)
                if is_listening and one.family in (socket.AF_INET, socket.AF_INET6) and one.getsockname()[1] == port:
                    one.shutdown(socket.SHUT_RDWR)
            finally:
                one.detach()  # Zenoh continues to use it

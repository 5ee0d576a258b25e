"""Keeps the robot's sockets, locks and signal handlers from child processes that a plugin starts."""

from __future__ import annotations

import os
import signal
import socket
from collections.abc import Callable, Iterator
from contextlib import suppress

from navloom_live.transport.links import Endpoint, Link

__all__ = ["keep_from_children"]


def keep_from_children(link: Link, forked: Callable[[], None]) -> None:
    """Let no child of this process hold the robot's sockets, their locks or its shared memory.

    A child that did would block this process's successor. In a fork, their file descriptors are redirected to the null
    device, not closed: the network library, of which the fork has a dead copy, may still close these numbers.
    Connections that the fork opens itself are not touched.

    Args:
        link: The link by which this process has joined the robot.
        forked: Called in each forked child.
    """
    links = (link,) if link.mesh is None else (link, link.mesh.link)
    ends = [Endpoint.parse(end) for one in links for end in (*one.listen, *one.connect)]
    paths = frozenset(end.host for end in ends if end.protocol == "unixsock-stream")

    def let_go() -> None:
        for name in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGPROF):
            signal.signal(name, signal.SIG_DFL)  # otherwise it would take 4 s to end
        nowhere = os.open(os.devnull, os.O_RDWR | os.O_CLOEXEC)
        for number in [*_ours(paths)]:
            os.dup2(nowhere, number, inheritable=False)
        os.close(nowhere)
        forked()

    for number in _ours(paths):
        os.set_inheritable(number, False)  # Zenoh leaves its socket's lock file inheritable for started programs
    os.register_at_fork(after_in_child=let_go)


def _ours(paths: frozenset[str]) -> Iterator[int]:
    """File descriptors of this process that belong to the robot's network: sockets of these paths, locks, segments."""
    locks = {f"{path}.lock{end}" for path in paths for end in ("", " (deleted)")}
    with suppress(OSError):  # no /proc
        for number in map(int, os.listdir("/proc/self/fd")):
            with suppress(OSError):
                name = os.readlink(f"/proc/self/fd/{number}")
                is_segment = name.startswith("/dev/shm/") and ".zenoh" in name
                if name in locks or is_segment or (name.startswith("socket:") and _names(number) & paths):
                    yield number


def _names(number: int) -> set[str]:
    """Paths at both ends of a socket."""
    found = set()
    # A duplicate, because the socket object closes its number.
    with socket.socket(fileno=os.dup(number)) as end:
        for name in (end.getsockname, end.getpeername):
            with suppress(OSError):
                found.add(name())
    return {name for name in found if isinstance(name, str)}

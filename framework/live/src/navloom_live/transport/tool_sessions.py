"""The session of a tool that joins a robot's network."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

from navloom_live.timing import TOOL_JOIN_WAIT
from navloom_live.transport.links import Endpoint, Link
from navloom_live.transport.zenoh_bus import Bus

__all__ = ["expiring", "joined"]


def expiring(folder: Path | None) -> tuple[str, ...]:
    """Warnings about certificates of a folder that expire soon, as text; empty without a folder."""
    if folder is None:
        return ()
    from navloom_live.transport.certificate_validity import expiry_warnings  # takes 60 ms to load: only for TLS

    return expiry_warnings(folder, datetime.now(UTC))


@contextmanager
def joined(link: Link, patience: float = 3.0) -> Iterator[Bus]:
    """A tool's session, linked to those listeners of its link that answer within TOOL_JOIN_WAIT. Raises BusError."""
    with Bus(link, patience) as bus:
        limit = time.monotonic() + TOOL_JOIN_WAIT
        # Robots that were killed leave sockets without a listener; waiting for all of them costs TOOL_JOIN_WAIT.
        wanted = sum(_may_listen(end) for end in link.connect) if link.mode == "peer" else 1
        while bus.neighbours() < wanted and time.monotonic() < limit:
            time.sleep(0.01)
        yield bus


def _may_listen(end: str) -> bool:
    """Whether a process may listen at an endpoint: for a socket, whether its file exists."""
    endpoint = Endpoint.parse(end)
    return endpoint.protocol != "unixsock-stream" or Path(endpoint.host).exists()

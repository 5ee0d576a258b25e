"""The session of a tool that joins a robot's network."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

from navloom.transport.links import Endpoint, Link
from navloom.transport.zenoh_bus import Bus

__all__ = ["expiring", "joined"]

FOUND = 2.0
"""s to wait for the robot's first process."""


def expiring(folder: Path | None) -> tuple[str, ...]:
    """Certificates of a folder that expire soon, in words; nothing where there is no folder."""
    if folder is None:
        return ()
    from navloom.transport.validity import expiry_warnings  # takes 60 ms to load, which only TLS has to pay

    return expiry_warnings(folder, datetime.now(UTC))


@contextmanager
def joined(link: Link, patience: float = 3.0) -> Iterator[Bus]:
    """A tool's session, once it has found who listens where its link calls. Raises BusError: nobody is there for s."""
    with Bus(link, patience) as bus:
        limit = time.monotonic() + FOUND
        wanted = sum(_may_listen(end) for end in link.connect) if link.mode == "peer" else 1
        while bus.neighbours() < wanted and time.monotonic() < limit:
            time.sleep(0.01)
        yield bus


def _may_listen(end: str) -> bool:
    """Whether somebody may listen at an endpoint: at a socket only where there is a file of it."""
    endpoint = Endpoint.parse(end)
    return endpoint.protocol != "unixsock-stream" or Path(endpoint.host).exists()

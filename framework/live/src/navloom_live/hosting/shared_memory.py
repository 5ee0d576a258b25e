"""Shared memory that Zenoh leaves in the system when its process is killed, or ends without Python's shutdown."""

from __future__ import annotations

import contextlib
import fcntl
import os
from pathlib import Path

__all__ = ["SEGMENTS", "is_orphan", "remove_orphans"]

SEGMENTS = Path("/dev/shm")
"""Folder of the segments on Linux; their names are NUMBER.zenoh."""


def is_orphan(path: Path) -> bool:
    """Whether no process uses a segment any more.

    Each process that opens a segment holds a shared lock on it until it ends, and its creator takes the lock before it
    sets the size. So if a segment with a size can be locked exclusively, all its users are gone.
    """
    try:
        segment = os.open(path, os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW)
    except OSError:
        return False
    try:
        # Zenoh itself looks into /proc, but a container sees only its own processes there.
        fcntl.flock(segment, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return os.fstat(segment).st_size > 0
    except OSError:
        return False
    finally:
        os.close(segment)


def remove_orphans() -> int:
    """Remove this user's segments that no process uses, as Zenoh does at its start; returns how many."""
    removed = 0
    for path in SEGMENTS.glob("*.zenoh"):
        with contextlib.suppress(OSError):
            if path.lstat().st_uid == os.getuid() and is_orphan(path):
                path.unlink()
                removed += 1
    return removed

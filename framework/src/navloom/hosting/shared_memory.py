"""Shared memory that Zenoh sessions leave in the system when their process is killed, or ends without Python's exit."""

from __future__ import annotations

import contextlib
import fcntl
import os
from pathlib import Path

__all__ = ["SEGMENTS", "is_orphan", "remove_orphans"]

SEGMENTS = Path("/dev/shm")
"""Where Linux has them, as NUMBER.zenoh."""


def is_orphan(path: Path) -> bool:
    """No process has a segment any more.

    Each process that opens one takes a shared lock on it until it ends, and the one that makes it takes the lock
    before it gives it a size. So an exclusive lock on one that has a size shows that everybody is gone.
    """
    try:
        segment = os.open(path, os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW)
    except OSError:
        return False
    try:
        fcntl.flock(segment, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return os.fstat(segment).st_size > 0
    except OSError:
        return False
    finally:
        os.close(segment)


def remove_orphans() -> int:
    """Remove this user's segments that no process has; gives how many. Zenoh does so as it starts."""
    removed = 0
    for path in SEGMENTS.glob("*.zenoh"):
        with contextlib.suppress(OSError):
            if path.lstat().st_uid == os.getuid() and is_orphan(path):
                path.unlink()
                removed += 1
    return removed

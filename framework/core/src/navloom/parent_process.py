"""A process that the system ends when its parent dies, whatever the cause."""

from __future__ import annotations

import ctypes
import os
import signal
import sys

__all__ = ["die_with_parent"]

PR_SET_PDEATHSIG = 1


def die_with_parent(parent: int, number: int = signal.SIGTERM) -> None:
    """Have the system send this process a signal when its parent dies.

    Args:
        parent: Process id of the parent.
        number: The signal.
    """
    if sys.platform == "linux":
        # The kernel sends the signal: a parent that is killed cannot.
        ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, number)
    if os.getppid() != parent:  # the parent died before the call
        os._exit(1)

"""Delays caused by the machine itself: a bare timer, counted like the ticks of the platform.

    python benchmarks/bare_timer.py SECONDS RATE

Prints the number of ticks, and of those that began more than half a period late or were skipped, as JSON. It runs at
the priority of a robot's control processes. During a soak it separates the robot's own delays from those of the host.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable

from navloom.parent_process import die_with_parent
from navloom_live.hosting.node_main import go_first

__all__ = ["late_ticks"]


def late_ticks(
    seconds: float,
    rate: float,
    clock_ns: Callable[[], int] = time.monotonic_ns,
    sleep: Callable[[float], None] = time.sleep,
) -> dict[str, int]:
    """Number of ticks of a timer at this rate, Hz, for some seconds, and of those that were late."""
    period = round(1e9 / rate)
    start = clock_ns()
    ticks = late = 0
    due = 1
    while due * period < seconds * 1e9:
        sleep(max(0.0, (start + due * period - clock_ns()) * 1e-9))
        since = clock_ns() - start
        number = since // period
        ticks += 1
        late += number - due + (since - number * period > period // 2)
        due = number + 1
    return {"ticks": ticks, "late_ticks": late}


if __name__ == "__main__":
    die_with_parent(os.getppid())
    go_first()
    print(json.dumps(late_ticks(float(sys.argv[1]), float(sys.argv[2]))))

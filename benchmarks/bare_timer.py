"""What this machine itself makes late: a timer that does nothing else, counted as the platform's ticks are.

    python benchmarks/bare_timer.py SECONDS RATE

Prints its ticks and those that began more than half a period late or were passed over, as JSON. It has the priority of
a robot's control processes. Beside a soak it tells the robot's own delays from those of the host.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable

from navloom.hosting.node_main import go_first
from navloom.hosting.process import die_with_parent

__all__ = ["late_ticks"]


def late_ticks(
    seconds: float,
    rate: float,
    clock_ns: Callable[[], int] = time.monotonic_ns,
    sleep: Callable[[float], None] = time.sleep,
) -> dict[str, int]:
    """Ticks of a timer of this rate, Hz, over s, and how many came late."""
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

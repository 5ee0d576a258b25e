"""Compares the stamps of streams, for `bag_clock`: jumps that cut a log into runs, and leads against another clock."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["AHEAD_NS", "LATE_NS", "beside", "runs_of", "span_text"]

Ints = NDArray[np.int64]
BACK_NS = 1_000_000_000
"""Largest step back of a stream's stamps, ns; messages may overtake each other."""
LEAP_NS = 10_000_000_000
"""Largest step of the stamps beyond that of the times of receipt, ns; more is a clock that was set."""
PAUSE_NS = 600_000_000_000
"""Longest pause within one run, ns: the robot may be elsewhere afterwards."""
STRAY = 3
"""Most messages between two jumps that count as strays and not as a run."""
AHEAD_NS, LATE_NS = 1_000_000_000, 5_000_000_000
"""Largest lead and delay of a stream's stamps against the odometry's, ns: processed scans are late."""


def runs_of(stamps_ns: Ints, received_ns: Ints) -> Ints:
    """The run of each message of a stream, counted from 1; 0 for a stray.

    Args:
        stamps_ns: (n,) stamps, in the order of receipt.
        received_ns: (n,) times of receipt, rising.
    """
    segments = np.cumsum(np.append(False, _jumps(stamps_ns, received_ns))[: len(stamps_ns)])
    lengths = np.bincount(segments, minlength=1)
    is_kept = lengths[segments] > STRAY if lengths.max() > STRAY else np.ones(len(stamps_ns), dtype=np.bool_)
    runs = np.zeros(len(stamps_ns), dtype=np.int64)
    # Without the strays, the stamps around one are of one run again.
    kept = np.flatnonzero(is_kept)
    runs[kept] = 1 + np.cumsum(np.append(False, _jumps(stamps_ns[kept], received_ns[kept]))[: len(kept)])
    return runs


def beside(stamps_ns: Ints, received_ns: Ints, known_ns: Ints, known_received_ns: Ints) -> tuple[Ints, Ints]:
    """What one stream's stamps are beside another's that was received at the same times.

    Args:
        stamps_ns, received_ns: (n,) stamps and times of receipt to judge.
        known_ns, known_received_ns: (m,) those to compare with, m > 0, in the order of receipt.

    Returns:
        (n,) Index of the compared message, the last or the next one, whichever fits better. (n,) Lead of the stamps
        against that message's clock, ns.
    """
    following = np.searchsorted(known_received_ns, received_ns, side="right")
    choices = [np.clip(following - 1, 0, len(known_ns) - 1), np.clip(following, 0, len(known_ns) - 1)]
    leads = [(stamps_ns - received_ns) - (known_ns[place] - known_received_ns[place]) for place in choices]
    is_last = np.abs(leads[0]) <= np.abs(leads[1])
    return np.where(is_last, *choices), np.where(is_last, *leads)


def span_text(span_ns: float) -> str:
    """A time span in the largest fitting unit, as `30.0 s` or `231 days`."""
    seconds = abs(span_ns) * 1e-9
    if seconds < 600.0:
        return f"{seconds:.1f} s"
    hours = seconds / 3600.0
    return f"{hours:.1f} h" if hours < 72.0 else f"{hours / 24.0:.0f} days"


def _jumps(stamps_ns: Ints, received_ns: Ints) -> NDArray[np.bool_]:
    """(n - 1,) Whether the clock jumps between a message and the next."""
    steps, waits = np.diff(stamps_ns), np.diff(received_ns)
    return (steps < -BACK_NS) | (steps - waits > LEAP_NS) | (steps > PAUSE_NS)

"""Whether an imported log has late scans: a quick look at the minute in which its robot turns most."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from navloom.messages import Odometry
from navloom_recording import Recording, RecordingError

from navloom_calibration.measured import measure
from navloom_calibration.recorded import read_drive

__all__ = ["late_note"]

_LATE = 0.03
"""Offset that is worth a note, s: at 1 rad/s it turns a scan by 1.7°."""
_LOOKED_AT, _LONGEST = 60.0, 3600.0
"""Time that is looked at, and the beginning of the log in which it is chosen, s."""


def late_note(path: Path) -> str:
    """Which lasers of a recording are late, and the command that measures it; empty if none is or nothing can be said.

    Args:
        path: The recording.
    """
    try:
        with Recording(path) as recording:
            begin_ns, end_ns = recording.span_ns()
            span = _most_turns(recording, begin_ns, min(end_ns, begin_ns + round(1e9 * _LONGEST)))
            drive = read_drive(recording, None, *span)
    except RecordingError:
        return ""
    late = []
    for laser in drive.lasers:
        found = measure(laser.scans, drive.way, laser.mount).offset
        if found is not None and abs(found.offset.value) > _LATE and not found.offset.low <= 0.0 <= found.offset.high:
            word = "late" if found.offset.value < 0.0 else "early"
            late.append(f"the scans of {laser.name} are about {abs(found.offset.value):.2f} s {word}")
    return f"{' and '.join(late)}: measure it with `navloom calibrate {path}`" if late else ""


def _most_turns(recording: Recording, begin_ns: int, end_ns: int) -> tuple[int, int]:
    """Receive times, ns, of the first and one past the last message of the minute with most changes of turn rate."""
    rows = [
        (recorded.received_ns, recorded.message.stamp_ns, recorded.message.pose.heading)
        for recorded in recording.messages(["platform/*/odometry"], begin_ns, end_ns)
        if isinstance(recorded.message, Odometry)
    ]
    received = np.array([row[0] for row in rows], dtype=np.int64)
    times = np.array([row[1] - rows[0][1] for row in rows]) * 1e-9
    if len(rows) < 3 or times[-1] < _LOOKED_AT:
        return begin_ns, end_ns + 1
    grid = np.arange(0.0, times[-1], 0.2)
    rates = np.diff(np.interp(grid, times, np.unwrap([row[2] for row in rows]))) / 0.2
    changes = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(rates)))))
    count = round(_LOOKED_AT / 0.2)
    first = int(np.argmax(changes[count:] - changes[:-count])) if len(changes) > count else 0
    places = np.searchsorted(times, [grid[first], grid[first] + _LOOKED_AT]).clip(max=len(rows) - 1)
    return int(received[places[0]]), int(received[places[1]]) + 1

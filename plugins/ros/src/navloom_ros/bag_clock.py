"""The clock of a bag, for `bag_import`: that of its odometry. Tells runs apart, and streams of another clock."""

from __future__ import annotations

import numpy as np
from navloom_recording import RecordingError, too_coarse
from numpy.typing import NDArray

from navloom_ros.bag_runs import AHEAD_NS, LATE_NS, beside, runs_of, span_text
from navloom_ros.bag_streams import Stream

__all__ = ["Clock"]

Ints = NDArray[np.int64]
REMEDY = "take the times of receipt instead, with --stamps received"
REPEATED = 0.05
"""Least share of different stamps of transforms, which are often sent again."""


class Clock:
    """Stamps of the odometry, with which those of all other streams are compared.

    Args:
        name: What gives the odometry.
        odometry: Its messages or transforms.
        is_transform: The odometry is transforms.
        by_receipt: Take the times of receipt as stamps.
        run: Number of the run to take, from 1; None for the one with the most odometry.

    Attributes:
        fault: Why the stamps are those of no clock; empty if they can be.
        run: Number of the run to take.

    Raises:
        RecordingError: There is no such run.
    """

    def __init__(self, name: str, odometry: Stream, is_transform: bool, by_receipt: bool, run: int | None) -> None:
        self.name, self.by_receipt = name, by_receipt
        self._stamps, self._received = odometry.times(by_receipt)
        self.fault = too_coarse(self._stamps, REPEATED) if is_transform else too_coarse(self._stamps)
        # A converted bag may lack the times of receipt.
        self._has_receipt = not too_coarse(self._received, REPEATED)
        if not self._has_receipt:
            self._received = self._stamps
        self._runs = runs_of(self._stamps, self._received)
        self._lengths = np.bincount(self._runs)[1:]
        if run is not None and run > len(self._lengths):
            raise RecordingError(f"--run {run}: the bag has {len(self._lengths)}")
        self.run = run or int(np.argmax(self._lengths)) + 1

    def misfit(self, stream: Stream) -> str:
        """Why the stamps of a stream cannot be used beside the odometry's; empty if they can."""
        stamps, received = self._times(stream)
        why = too_coarse(stamps)
        if why:
            return f"{why}: {REMEDY}"
        _, leads = self._beside(stamps, received)
        lead = float(np.median(leads))
        if -LATE_NS <= lead <= AHEAD_NS:
            return ""
        return f"its stamps are {span_text(lead)} {'ahead of' if lead > 0 else 'behind'} those of {self.name}: {REMEDY}"

    def runs(self, stream: Stream) -> Ints:
        """(n,) Run of each message of a stream, from 1; 0 for a stray stamp."""
        stamps, received = self._times(stream)
        runs, leads = self._beside(stamps, received)
        return np.where((leads >= -LATE_NS) & (leads <= AHEAD_NS), runs, 0)

    def notes(self) -> list[str]:
        """What a user must know of the runs."""
        if len(self._lengths) < 2:
            return []
        spans = []
        for number in range(1, len(self._lengths) + 1):
            stamps = self._stamps[self._runs == number]
            spans.append(span_text(float(stamps.max() - stamps.min())))
        whole = "" if runs_of(self._received, self._received).max() > 1 else ", or all with --stamps received"
        return [
            f"the clock of {self.name} jumps: {len(spans)} runs, of {', '.join(spans)}; run {self.run} is imported: "
            f"take another with --run N{whole}"
        ]

    def _times(self, stream: Stream) -> tuple[Ints, Ints]:
        stamps, received = stream.times(self.by_receipt)
        return stamps, received if self._has_receipt else stamps

    def _beside(self, stamps: Ints, received: Ints) -> tuple[Ints, Ints]:
        """Run and lead, ns, of each stamp by the odometry that was received next to it."""
        is_kept = self._runs > 0
        places, leads = beside(stamps, received, self._stamps[is_kept], self._received[is_kept])
        return self._runs[is_kept][places], leads

"""What the process that draws is asked for, and how it gives way: known to both sides of the bridge."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from navloom.viewer.facts import Facts

__all__ = ["NICE", "ViewerOrder"]

NICE = 10
"""Niceness of whatever shows a run: what drives on the same host comes first."""


@dataclass(frozen=True)
class ViewerOrder:
    """What the child is to do.

    Attributes:
        facts: Who is in the picture.
        file: .rrd file to write, or None.
        url: Of a viewer, or None.
        recording_id: The same for the same run.
        blocked: Plugins that count as not installed.
        patience: s to wait for a viewer that is slower than the run; 0 for live robots.
    """

    facts: Facts
    file: Path | None
    url: str | None
    recording_id: str
    blocked: frozenset[str] = frozenset()
    patience: float = 0.0

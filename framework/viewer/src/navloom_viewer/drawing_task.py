"""Task and niceness of the drawing process, shared by both sides of the bridge."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from navloom_viewer.picture_setup import Facts

__all__ = ["NICE", "ViewerOrder"]

NICE = 10
"""Niceness of processes that show a run, so that those that drive on the same host have priority."""


@dataclass(frozen=True)
class ViewerOrder:
    """Task of the child process.

    Attributes:
        facts: The robots in the picture.
        file: .rrd file to write, or None.
        url: URL of a viewer, or None.
        recording_id: Identifier, equal for the same run.
        blocked: Plugins that count as not installed.
        patience: Longest wait for a viewer that is slower than the run, s; 0 for live robots.
    """

    facts: Facts
    file: Path | None
    url: str | None
    recording_id: str
    blocked: frozenset[str] = frozenset()
    patience: float = 0.0

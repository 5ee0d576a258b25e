"""What tells the episodes of a study apart."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["EpisodeKey"]


@dataclass(frozen=True, order=True)
class EpisodeKey:
    """Which episode of a study."""

    method: str
    world: str
    seed: int

"""The key of an episode within a study."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["EpisodeKey"]


@dataclass(frozen=True, order=True)
class EpisodeKey:
    """Identifies an episode of a study."""

    method: str
    world: str
    seed: int

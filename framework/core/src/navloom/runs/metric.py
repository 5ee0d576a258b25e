"""What a metric is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from navloom.runs.episode_trail import Trail

__all__ = ["NOT_NEGATIVE", "SHARE", "Metric"]

SHARE = (0.0, 1.0)
NOT_NEGATIVE = (0.0, None)


@dataclass(frozen=True)
class Metric:
    """A number that describes an episode.

    Attributes:
        name: Column of the table: lower case letters, digits and `_`.
        unit: Printed unit: "m", "s", "1/m", "1" for shares and counts.
        better: Which direction is better; None if neither is.
        compute: Returns the number, or None if it is not defined for the episode.
        about: One or two sentences: what it is, and when it is not defined.
        bounds: Smallest and largest possible value, None for no bound; intervals are cut at them.
        is_share: Whether it is 1 or 0 in each episode, so that its mean is a share with an exact interval.
        reads: Streams of roles and nodes whose messages it needs, as `("people", "tracks")`: `trail.streams` has them.
            The role "node" stands for every [[node]] of the config.
        is_detail: Another metric describes the same quantity: files have both, the tables of a report the other only.
        role: Role that it judges; empty for the whole robot. Where methods differ in it, tables show a detail too.
    """

    name: str
    unit: str
    better: Literal["lower", "higher"] | None
    compute: Callable[[Trail], float | None]
    about: str
    bounds: tuple[float | None, float | None] = (None, None)
    is_share: bool = False
    reads: tuple[tuple[str, str], ...] = ()
    is_detail: bool = False
    role: str = ""

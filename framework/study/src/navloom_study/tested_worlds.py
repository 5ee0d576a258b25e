"""Worlds that tested nothing: the role in which the methods differ never acted there, so its methods are equal."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from navloom_study.episode_rows import Row

__all__ = ["without_untested", "untested_worlds"]

ACTED = {"avoider": "avoider_share", "recovery": "recoveries"}
"""By role that acts only at need, the metric that is 0 if it never did."""


def untested_worlds(rows: Sequence[Row], differs: Mapping[str, Any]) -> dict[str, list[str]]:
    """By role, the worlds in which it never acted; empty unless the methods differ in that role alone.

    Args:
        rows: All episodes.
        differs: Places of the config at which the methods differ.
    """
    roles = {place.partition(".")[0] for place in differs}
    if len(roles) != 1 or (role := roles.pop()) not in ACTED:
        return {}
    acted: dict[str, list[float | None]] = {}
    for row in rows:
        # An episode that failed says nothing about the world.
        values = acted.setdefault(row.key.world, [])
        if row.outcome != "error":
            values.append(row.metrics.get(ACTED[role]))
    worlds = [world for world, values in acted.items() if values and all(value == 0.0 for value in values)]
    return {role: worlds} if worlds else {}


def without_untested(rows: Sequence[Row], untested: Mapping[str, Iterable[str]]) -> list[Row]:
    """The rows without the worlds that tested nothing; all rows if no world tested anything."""
    out = {world for worlds in untested.values() for world in worlds}
    return [row for row in rows if row.key.world not in out] or list(rows)

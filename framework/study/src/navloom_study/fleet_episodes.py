"""Members of a fleet in the episodes of a study: the fleet is the row, and each member is a part of it."""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from navloom.runs.fleet_metrics import FLEET_METRICS

from navloom_study.episode_key import EpisodeKey

if TYPE_CHECKING:
    from navloom.plugins import Discovery
    from navloom.runs.metrics import Metric

__all__ = ["MEMBERS", "OF_MEMBERS", "MemberRow", "known_metrics", "member_rows_of", "member_summary", "member_table"]

MEMBERS = "members.csv"
"""The table of the members in the folder of a study."""


OF_MEMBERS = ("time", "path_length", "own_contacts", "others_contacts", "clearance_min", "gate_limits")
"""Metrics of the short rows of members."""


@dataclass(frozen=True)
class MemberRow:
    """A member in one episode.

    Attributes:
        name: Its name.
        outcome, reason: Its outcome.
        metrics: Values by name; None if a metric is not defined for it.
        trace_sha256: Hash of its trace.
    """

    name: str
    outcome: str
    reason: str
    metrics: dict[str, float | None]
    trace_sha256: str


class EpisodeOfFleet(Protocol):
    """A row with members."""

    @property
    def key(self) -> EpisodeKey:
        """Key of the episode."""

    @property
    def members(self) -> tuple[MemberRow, ...]:
        """Its members."""


def known_metrics(discovery: Discovery, is_fleet: bool) -> tuple[tuple[Metric, ...], tuple[str, ...]]:
    """Metrics of a study's rows, see `all_metrics`; those of a fleet are all built in."""
    from navloom.runs.metrics import all_metrics

    return (FLEET_METRICS, ()) if is_fleet else all_metrics(discovery)


def member_table(rows: Iterable[EpisodeOfFleet], metrics: Sequence[str]) -> str:
    """The members of all rows as CSV, see `table_of`."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["method", "world", "seed", "member", "outcome", "reason", *metrics, "trace_sha256"])
    for row in rows:
        for one in row.members:
            values = ["" if (value := one.metrics[name]) is None else f"{value:.12g}" for name in metrics]
            told = (one.name, one.outcome, one.reason, *values, one.trace_sha256)
            writer.writerow([*vars(row.key).values(), *told])
    return text.getvalue()


def member_rows_of(table: str, metrics: Sequence[str]) -> dict[EpisodeKey, list[MemberRow]]:
    """The members of each episode, from the text of `member_table`.

    Raises:
        KeyError: A column is missing; ValueError, TypeError: a value is missing or no number.
    """
    found: dict[EpisodeKey, list[MemberRow]] = {}
    for line in csv.DictReader(io.StringIO(table, newline="")):
        values = {name: float(line[name]) if line[name] != "" else None for name in metrics}
        row = MemberRow(line["member"], line["outcome"], line["reason"], values, line["trace_sha256"])
        found.setdefault(EpisodeKey(line["method"], line["world"], int(line["seed"])), []).append(row)
    return found


def member_summary(rows: Iterable[EpisodeOfFleet], metrics: Sequence[str]) -> dict[str, dict[str, Any]]:
    """By member: its number of episodes and outcomes, and the mean of each metric where it is defined.

    There are no intervals over members: those of one fleet depend on each other.
    """
    by_name: dict[str, list[MemberRow]] = {}
    for row in rows:
        for one in row.members:
            by_name.setdefault(one.name, []).append(one)
    return {
        name: {
            "episodes": len(found),
            "outcomes": dict(sorted(Counter(one.outcome for one in found).items())),
            "means": {metric: _mean([one.metrics[metric] for one in found]) for metric in metrics},
        }
        for name, found in by_name.items()
    }


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None

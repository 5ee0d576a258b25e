"""Metrics of a fleet as a whole, from the trails of its members. See docs/metrics.md."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace

import numpy as np

from navloom.runs import metric_functions
from navloom.runs.contacts import Touch
from navloom.runs.episode_trail import Trail, lost_trail
from navloom.runs.metric import NOT_NEGATIVE, SHARE, Metric

__all__ = ["FLEET_METRICS", "STANDS", "WATCHED", "fleet_trail"]

WATCHED = 10.0
"""Last part of a member's run in which it has to get on, s: longer than a robot waits for another to pass."""
STANDS = 1.0
"""Least way in x or y in that time of a member that gets on, m: more than one that backs up and tries again."""


def fleet_trail(members: Mapping[str, Trail]) -> Trail:
    """The trail of a finished fleet, without ticks of its own: its outcome, and the trails of its members.

    It succeeded if every member did. Otherwise its outcome is `deadlock`, if there is one, or else the most frequent
    outcome of the others.
    """
    ends = Counter(trail.outcome for trail in members.values() if not trail.succeeded)
    told = "; ".join([
        f"{len(members) - ends.total()} of {len(members)} arrived",
        *(f"{count} {outcome}" for outcome, count in ends.most_common()),
    ])  # fmt: skip
    first = next(iter(members.values()))
    outcome = "succeeded" if not ends else "deadlock" if _deadlocked(members.values()) else ends.most_common(1)[0][0]
    trail = lost_trail(
        outcome, told, period=first.period, limit=max(member.limit for member in members.values()),
        max_linear=first.max_linear, max_deceleration=first.max_deceleration, reaction=first.reaction,
    )  # fmt: skip
    return replace(trail, tick_ns=np.concatenate([m.tick_ns for m in members.values()]), members=dict(members))


def _arrived(trail: Trail) -> float | None:
    own = trail.members.values()
    return sum(member.succeeded for member in own) / len(own) if own else 0.0


def _false_success(trail: Trail) -> float | None:
    own = [metric_functions.false_success(member) for member in trail.members.values()]
    return max((one for one in own if one is not None), default=None)


def _makespan(trail: Trail) -> float | None:
    times = [metric_functions.time_to_goal(member) for member in trail.members.values()]
    return max((time for time in times if time is not None), default=trail.limit) if trail.succeeded else trail.limit


def _deadlock(trail: Trail) -> float | None:
    return float(_deadlocked(trail.members.values())) if trail.members else None


def _deadlocked(members: Iterable[Trail]) -> bool:
    return any(not member.touches and not member.succeeded and _stands(member) for member in members)


def _stands(member: Trail) -> bool:
    """Whether it no longer got on in the last `WATCHED` seconds of its run."""
    last = member.time >= member.time[-1] - WATCHED if member.time.size else np.zeros(0, dtype=np.bool_)
    if not last.any() or member.duration < WATCHED:
        return False
    return bool(max(np.ptp(member.x[last]), np.ptp(member.y[last])) < STANDS)


def _between(trail: Trail) -> Iterator[Touch]:
    """The contacts of members with members, each of both."""
    for member in trail.members.values():
        yield from (touch for touch in member.contacts if touch.name in trail.members)


def _contacts(is_own: bool) -> Callable[[Trail], float | None]:
    def count(trail: Trail) -> float | None:
        return float(sum(touch.is_own == is_own for touch in _between(trail))) if trail.members else None

    return count


def _collisions(trail: Trail) -> float | None:
    counts = [metric_functions.collisions(member) or 0.0 for member in trail.members.values()]
    return sum(counts) if counts else None


def _least_clearance(trail: Trail) -> float | None:
    known = [metric_functions.clearance_min(member) for member in trail.members.values()]
    return min((gap for gap in known if gap is not None), default=None)


FLEET_METRICS: tuple[Metric, ...] = (
    Metric(
        "success", "1", "higher", metric_functions.success,
        "1 if every member reached its goal, by the ground truth, else 0.",
        SHARE, is_share=True,
    ),
    Metric(
        "arrived", "1", "higher", _arrived,
        "Share of the members that reached their goals, by the ground truth.",
        SHARE,
    ),
    Metric(
        "false_success", "1", "lower", _false_success,
        "1 if a member reported that it had arrived but, by the ground truth, had not, else 0. Undefined if the run "
        "left no data.",
        SHARE, is_share=True,
    ),
    Metric(
        "makespan", "s", "lower", _makespan,
        "Time until the last member came within its goal's tolerances; a fleet that did not succeed counts with the "
        "longest time it was allowed.",
        NOT_NEGATIVE,
    ),
    Metric(
        "deadlock", "1", "lower", _deadlock,
        f"1 if a member that neither arrived nor touched anything stayed within {STANDS:g} m in the last {WATCHED:g} s "
        "of its run, else 0. Undefined if the run left no data.",
        SHARE, is_share=True,
    ),
    Metric(
        "own_contacts", "1", "lower", _contacts(True),
        "Contacts between members, for each of the two for which it is its own: two that drive into each other count "
        "twice. Undefined if the run left no data.",
        NOT_NEGATIVE,
    ),
    Metric(
        "others_contacts", "1", "lower", _contacts(False),
        "Contacts between members, for each of the two for which it is the other's. Undefined if the run left no data.",
        NOT_NEGATIVE,
    ),
    Metric(
        "collisions", "1", "lower", _collisions,
        "Contacts of all members with anything: one between two members counts for both. Undefined if the run left no "
        "data.",
        NOT_NEGATIVE,
    ),
    Metric(
        "clearance_min", "m", "higher", _least_clearance,
        "Least `clearance_min` of the members. Undefined if nothing is near any of them.",
    ),
)  # fmt: skip
"""Metrics of a fleet, in the order of the table."""

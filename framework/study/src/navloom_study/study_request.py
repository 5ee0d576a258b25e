"""A study as data: the checked request, and the result."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from navloom.plugins.one_file import files_in_use
from navloom.runs.metrics import Metric

from navloom_study.episode_key import EpisodeKey
from navloom_study.episode_rows import EpisodeTask, Row
from navloom_study.fleet_episodes import known_metrics, member_summary
from navloom_study.openloop import METHOD, OpenLoop
from navloom_study.statistics import PRIMARY, Comparison, compare_methods
from navloom_study.study_methods import Method, toml_value
from navloom_study.study_worlds import CachedDiscovery, WorldCase
from navloom_study.tested_worlds import untested_worlds, without_untested

__all__ = ["Study", "StudyResult"]


@dataclass(frozen=True, eq=False)
class Study:
    """A checked request for a study.

    Attributes:
        config: Path or shipped name of the config.
        methods, worlds, seeds: Every combination is one episode.
        metrics: Names, in the order of the table.
        held_equal: By place in the config, the values that are equal for every method.
        differs: By place, the value of each method that has one.
        dropped: By method, the parameters that were dropped together with the replaced plugin.
        versions: Versions that an episode depends on.
        here: Base folder of references that are not from a file.
        baseline: Name of the method that the others are compared with.
        open_loop: Additional drives, one for each world and seed, for their shadows; None for none.
        is_live: The episodes are driven live, one after the other, instead of in lockstep.
        primary: Metrics that the study asks about, see `compare_methods`.
        member_metrics: Of fleets, the names of the metrics of each member; `metrics` are those of a fleet.
    """

    config: str
    methods: tuple[Method, ...]
    worlds: tuple[WorldCase, ...]
    seeds: tuple[int, ...]
    metrics: tuple[str, ...]
    held_equal: dict[str, Any]
    differs: dict[str, dict[str, Any]]
    dropped: dict[str, tuple[str, ...]]
    versions: dict[str, str]
    here: Path
    baseline: str = ""
    open_loop: OpenLoop | None = None
    unusable: tuple[str, ...] = ()
    is_live: bool = False
    primary: tuple[str, ...] = PRIMARY
    member_metrics: tuple[str, ...] = ()

    @property
    def is_fleet(self) -> bool:
        """Whether an episode is the drive of a fleet."""
        return bool(self.methods[0].members)

    @property
    def keys(self) -> list[EpisodeKey]:
        """Every episode in the order of the table: by method, world and seed, each in the order of the request."""
        return [
            EpisodeKey(m.name, w.ref, seed) for m in self.methods for w in self.worlds for seed in self.seeds
        ]  # fmt: skip

    @property
    def open_loop_keys(self) -> list[EpisodeKey]:
        """Every episode that is driven only for its shadows."""
        if self.open_loop is None:
            return []
        return [EpisodeKey(METHOD, w.ref, seed) for w in self.worlds for seed in self.seeds]

    def twice(self) -> list[EpisodeTask]:
        """Tasks that run the first episode of each method twice."""
        world, seed = self.worlds[0].ref, self.seeds[0]
        return [
            replace(task, is_twice=True)
            for task in self.tasks()
            if (task.key.world, task.key.seed) == (world, seed) and not task.is_open_loop
        ]

    def tasks(self) -> list[EpisodeTask]:
        """A task for every episode, grouped by world."""
        given = {method.name: method.loaded.to_json() for method in self.methods}
        members = {method.name: tuple(one.to_json() for one in method.members) for method in self.methods}
        token = hashlib.sha256(json.dumps(self.request(), sort_keys=True).encode()).hexdigest()
        drives = [(method.name, given[method.name], False) for method in self.methods]
        if self.open_loop is not None:
            drives.append((METHOD, self.open_loop.loaded.to_json(), True))
        return [
            EpisodeTask(
                token,
                EpisodeKey(name, w.ref, seed),
                config,
                w.values,
                str(self.here),
                self.metrics,
                is_open,
                members=members.get(name, ()),
                member_metrics=self.member_metrics,
            )
            for w in self.worlds
            for seed in self.seeds
            for name, config, is_open in drives
        ]

    def request(self) -> dict[str, Any]:
        """The request as `study.json` stores it: equal requests give equal rows.

        To drive one episode again, pass the `method` of its method to `navloom run` as `--method`, the `changes` of its
        method and world as `--set`, its seed as `--seed` and the `plugin_files` as `--plugin`.
        """
        return {
            "config": self.config,
            "methods": {method.name: method.request() for method in self.methods},
            "worlds": {
                w.ref: {
                    "sha256": w.sha256,
                    "changes": [f"{place}={toml_value(value)}" for place, value in w.values.items()],
                }
                for w in self.worlds
            },
            "seeds": list(self.seeds),
            "metrics": list(self.metrics),
            "held_equal": self.held_equal,
            "differs": self.differs,
            "versions": self.versions,
            **({"plugin_files": files} if (files := files_in_use()) else {}),
            **({"live": True} if self.is_live else {}),
            **({"primary": list(self.primary)} if self.primary != PRIMARY else {}),
            **({} if self.open_loop is None else {"open_loop": self.open_loop.request()}),
            **({"members": self._members(), "member_metrics": list(self.member_metrics)} if self.is_fleet else {}),
        }  # fmt: skip

    def _members(self) -> list[str]:
        return [one.member for one in self.methods[0].members]


@dataclass(frozen=True, eq=False)
class StudyResult:
    """A finished study.

    Attributes:
        study: The request.
        rows: One row an episode, in the order of the table.
        before: Number of episodes that had ended in an earlier call.
        lost: Number of workers that died or were killed in this call.
        wall: Wall time of this call, s.
        files: Names of the files in the folder.
        open_loop: Rows of the episodes driven for their shadows.
        missing: Why a file was not written, by name.
        repeated: Rows of the episodes that were run twice.
    """

    study: Study
    rows: tuple[Row, ...]
    before: int
    lost: int
    wall: float
    files: tuple[str, ...] = ()
    open_loop: tuple[Row, ...] = ()
    missing: Mapping[str, str] = field(default_factory=dict)
    repeated: tuple[Row, ...] = ()

    @cached_property
    def untested(self) -> dict[str, list[str]]:
        """By role, the worlds in which it never acted, see `untested_worlds`."""
        return untested_worlds(self.rows, self.study.differs)

    @cached_property
    def metrics(self) -> tuple[Metric, ...]:
        """Metrics in the order of the table."""
        known = {metric.name: metric for metric in known_metrics(CachedDiscovery(), self.study.is_fleet)[0]}
        return tuple(known[name] for name in self.study.metrics)

    @cached_property
    def comparison(self) -> Comparison:
        """Statistical comparison of the methods, in the worlds that tested them: the same as in the report."""
        rows = without_untested(self.rows, self.untested)
        told = [{**vars(row.key), "outcome": row.outcome, **row.metrics} for row in rows]
        baseline = self.study.baseline or self.study.methods[0].name
        return compare_methods(told, baseline, self.metrics, np.random.default_rng(0), primary=self.study.primary)

    @property
    def verdicts(self) -> list[str]:
        """Which method is better at what, by how much, and how sure that is, in sentences."""
        from navloom_study.verdict import verdicts

        return verdicts(self.comparison, self.metrics, self.untested)

    def summary(self) -> dict[str, Any]:
        """By method, in the worlds that tested it: number of episodes and outcomes, the mean of each metric over the
        episodes for which it is defined, and the exact 95 % interval of each share, see `compare_methods`."""
        found, tested = {}, without_untested(self.rows, self.untested)
        for method in self.study.methods:
            rows = [row for row in tested if row.key.method == method.name]
            means = {}
            for name in self.study.metrics:
                values = [value for row in rows if (value := row.metrics[name]) is not None]
                means[name] = float(np.mean(values)) if values else None
            intervals = {}
            for metric in self.metrics:
                share = self.comparison.summary(method.name, metric.name)
                if metric.is_share and share.low is not None and share.high is not None:
                    intervals[metric.name] = (share.low, share.high)
            outcomes = dict(sorted(Counter(row.outcome for row in rows).items()))
            found[method.name] = {"episodes": len(rows), "outcomes": outcomes, "means": means, "intervals": intervals}
        return found

    def members(self) -> dict[str, dict[str, Any]]:
        """By method and member of a fleet: outcomes and means over the same episodes as in the summary."""
        tested, names = without_untested(self.rows, self.untested), self.study.member_metrics
        return {
            method.name: member_summary((row for row in tested if row.key.method == method.name), names)
            for method in self.study.methods
        }

    @property
    def warnings(self) -> list[dict[str, Any]]:
        """Warnings of its runs, each once for a method, with the number of affected episodes and the first of them."""
        found: dict[tuple[str, ...], dict[str, Any]] = {}
        for is_counted, rows in ((True, self.rows), (False, self.repeated)):
            for row in rows:
                for warning in row.warnings:
                    key = (row.key.method, warning.kind, warning.role, warning.instance, warning.about)
                    told = found.setdefault(key, {**warning.to_json(), **vars(row.key), "episodes": 1 - is_counted})
                    told["episodes"] += is_counted
        return list(found.values())

    @property
    def is_repeatable(self) -> bool:
        """Whether no episode that was run twice differed."""
        return not any(warning.kind == "repeat" for row in self.repeated for warning in row.warnings)

    @property
    def notes(self) -> list[str]:
        """Failures outside the episodes: broken metrics and failed open-loop runs, each with the number of episodes."""
        counts = Counter(note for row in self.rows for note in row.notes)
        counts.update(f"open loop failed: {row.reason}" for row in self.open_loop if row.outcome == "error")
        return [f"{note} ({count} episodes)" for note, count in sorted(counts.items())]

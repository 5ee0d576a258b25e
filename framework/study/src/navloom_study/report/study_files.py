"""Reads and checks the folder of a study, written by `navloom compare`, for a report."""

from __future__ import annotations

import csv
import shlex
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from sys import intern
from typing import Any

import numpy as np
from navloom.config import ConfigError, load_config
from navloom.engine.platform_world import own_world
from navloom.geometry.world import World
from navloom.inputs.bounds import IMAGE_MB, TEXT_MB, read_file
from navloom.inputs.texts import json_of
from navloom.plugins import Discovery, PluginError
from navloom.plugins.registry import nearest
from navloom.runs.metrics import Metric

from navloom_study.episode_key import EpisodeKey
from navloom_study.episode_rows import Row
from navloom_study.fleet_episodes import MEMBERS, known_metrics, member_rows_of
from navloom_study.statistics import PRIMARY, Comparison, compare_methods
from navloom_study.study_folder import OpenLoopLine, open_loop_lines, rows_of
from navloom_study.study_worlds import OWN_WORLD, world_digest
from navloom_study.tested_worlds import untested_worlds, without_untested
from navloom_study.tracks import StoredWay, read_track

__all__ = ["StudyFiles", "read_study"]

SEED = 0
"""Seed of the resamples, so that a study always gives the same intervals."""


@dataclass(frozen=True, eq=False)
class StudyFiles:
    """A finished study.

    Attributes:
        folder: Folder of the study.
        request: Contents of `study.json`.
        rows: Rows of `episodes.csv`.
        open_loop: Lines of `open_loop.csv`, empty if there is none.
        timing: Contents of `timing.json`, empty if there is none.
        metrics: Metrics in the order of the table.
        baseline: The method that the others are compared with.
        discovery: Plugins, used to find worlds.
    """

    folder: Path
    request: dict[str, Any]
    rows: list[Row]
    open_loop: list[OpenLoopLine]
    timing: dict[str, Any]
    metrics: tuple[Metric, ...]
    baseline: str
    discovery: Discovery = field(default_factory=Discovery)

    @property
    def methods(self) -> list[str]:
        """Methods in the order of the request."""
        return list(self.request["methods"])

    @property
    def worlds(self) -> list[str]:
        """Worlds in the order of the request."""
        return list(self.request["worlds"])

    @property
    def seeds(self) -> list[int]:
        """Seeds in the order of the request."""
        return [int(seed) for seed in self.request["seeds"]]

    @cached_property
    def untested(self) -> dict[str, list[str]]:
        """By role, the worlds in which it never acted, see `untested_worlds`."""
        return untested_worlds(self.rows, self.request["differs"])

    @cached_property
    def tested(self) -> list[Row]:
        """The rows of the worlds that tested the methods: all means and comparisons are of these."""
        return without_untested(self.rows, self.untested)

    @cached_property
    def comparison(self) -> Comparison:
        """Statistical comparison of the methods."""
        rows = [{**vars(row.key), "outcome": row.outcome, **row.metrics} for row in self.tested]
        primary = self.request.get("primary", PRIMARY)
        return compare_methods(rows, self.baseline, self.metrics, np.random.default_rng(SEED), primary=primary)

    @cached_property
    def outcomes(self) -> dict[tuple[str, str], list[str]]:
        """Outcomes of the episodes, by method and world."""
        found: dict[tuple[str, str], list[str]] = {}
        for row in self.rows:
            found.setdefault((row.key.method, row.key.world), []).append(row.outcome)
        return found

    def values(self, metric: str, method: str) -> np.ndarray[Any, np.dtype[np.float64]]:
        """(n,) values of a metric in a method's episodes, where it is defined."""
        told = (row.metrics[metric] for row in self.tested if row.key.method == method)
        return np.array([value for value in told if value is not None])

    def by_world(self, metric: str) -> dict[tuple[str, str], float]:
        """By method and world, the mean of a metric over the episodes in which it is defined."""
        found: dict[tuple[str, str], list[float]] = {}
        for row in self.rows:
            if (value := row.metrics[metric]) is not None:
                found.setdefault((row.key.method, row.key.world), []).append(value)
        return {key: float(np.mean(values)) for key, values in found.items()}

    @property
    def table_metrics(self) -> tuple[Metric, ...]:
        """The metrics of the report's tables: one of each quantity, the primary one, and all of roles that differ."""
        primary = {one.metric for one in self.comparison.differences if one.is_primary}
        roles = {place.partition(".")[0] for place in self.request["differs"]}
        return tuple(m for m in self.metrics if not m.is_detail or m.name in primary or m.role in roles)

    def metric(self, name: str) -> Metric | None:
        """A metric by name, or None."""
        return next((metric for metric in self.metrics if metric.name == name), None)

    def value(self, place: str) -> Any:
        """The common value of all methods at a place of the config; None if it differs or is not known."""
        return self.request["held_equal"].get(place)

    def command(self, method: str, world: str, seed: int) -> str:
        """Shell command that drives one episode again."""
        changes = [*self.request["methods"][method]["changes"], *self.request["worlds"][world]["changes"]]
        words = ["navloom", "run", self.request["config"]]
        for file in self.request.get("plugin_files", ()):
            words += ["--plugin", file]
        if table := self.request["methods"][method].get("method"):
            words += ["--method", table]
        for change in changes:
            words += ["--set", change]
        return shlex.join([*words, "--seed", str(seed)])

    def track(self, method: str, world: str, seed: int) -> StoredWay | None:
        """The track of an episode; None if it was not stored."""
        return read_track(self.folder, EpisodeKey(method, world, seed))

    def world(self, ref: str) -> World | None:
        """The world of the study; None if it cannot be found here or has changed."""
        told = self.request["worlds"][ref]
        try:
            if ref == OWN_WORLD:
                method = self.request["methods"][self.methods[0]]
                name, member = self.request["config"], self.request.get("members", [""])[0]
                loaded = load_config(name, method["changes"], method=method.get("method", ""), member=member)
                world = own_world(loaded, self.discovery)
            else:
                world = self.discovery.world(ref, self._base() if not told["changes"] else Path.cwd())
        except (PluginError, ValueError, OSError):
            return None
        return world if world is not None and world_digest(world) == told["sha256"] else None

    def why_no_world(self, ref: str) -> str:
        """Why `world` returns None, in one sentence."""
        if not self.request["worlds"][ref]["sha256"]:
            return "The platform does not tell what stands in its world."
        return "The world itself cannot be read here, or has changed."

    def _base(self) -> Path:
        """Base folder of the config's own references."""
        config = Path(self.request["config"])
        return config.parent if config.suffix == ".toml" else Path.cwd()


def read_study(folder: Path, baseline: str = "") -> StudyFiles:
    """Read the folder of a finished study.

    Args:
        folder: Folder given to `navloom compare` as `--out`.
        baseline: Name of a method; default that of the open loop, else the first.

    Raises:
        ConfigError: Not a study, an unfinished or damaged one, or no such method.
    """
    if not (folder / "study.json").is_file():
        inner = ", ".join(sorted(path.parent.name for path in folder.glob("*/study.json")))
        remedy = f"a folder in it that has one: {inner}" if inner else "the --out of `navloom compare`"
        raise ConfigError(f"{folder}: holds no study: study.json is missing; name {remedy}")
    if not (folder / "episodes.csv").is_file():
        raise ConfigError(f"{folder}: the study is not finished: the same `navloom compare` continues it")
    request = _read(folder / "study.json", _json)
    table = _read(folder / "episodes.csv", _table)
    try:
        # intern raises TypeError for anything but a string
        names, told = ([intern(name) for name in request[part]] for part in ("methods", "metrics"))
        baseline = baseline or intern(request.get("open_loop", {}).get("baseline", "")) or names[0]
        count = len(names) * len(request["worlds"]) * len(request["seeds"])
    except (KeyError, TypeError, IndexError, AttributeError):
        raise _damaged(folder / "study.json") from None
    try:
        rows = rows_of(table, told)
    except KeyError:
        rows = []
    except (TypeError, ValueError, csv.Error):
        raise _damaged(folder / "episodes.csv") from None
    if len(rows) != count:
        raise ConfigError(
            f"{folder / 'episodes.csv'}: is not the table of study.json; the same compare writes it again"
        )
    if baseline not in names:
        raise ConfigError(f"--baseline {baseline}: no such method in {folder}{nearest(baseline, names)}")
    timing = _optional(folder / "timing.json", _json, {})
    open_loop = (
        _optional(folder / "open_loop.csv", lambda path: open_loop_lines(_table(path)), [])
        if "open_loop" in request
        else []
    )
    discovery = Discovery()
    is_fleet = "members" in request
    known = {metric.name: metric for metric in known_metrics(discovery, is_fleet)[0]}
    metrics = tuple(known.get(name) or _unknown(name) for name in told)
    if is_fleet:
        found = _read(folder / MEMBERS, lambda path: member_rows_of(_table(path), request["member_metrics"]))
        rows = [replace(row, members=tuple(found.get(row.key, ()))) for row in rows]
    return StudyFiles(folder, request, rows, open_loop, timing, metrics, baseline, discovery)


def _unknown(name: str) -> Metric:
    """Stand-in for a metric that is not installed here: its values are known, its unit and better side are not."""
    return Metric(name, "?", None, lambda trail: None, "Of a plugin that is not installed here.")


def _table(path: Path) -> str:
    return read_file(path, IMAGE_MB, ConfigError).decode("utf-8")


def _json(path: Path) -> Any:
    return json_of(read_file(path, TEXT_MB, ConfigError), str(path), ValueError)


def _read(path: Path, reader: Callable[[Path], Any]) -> Any:
    try:
        return reader(path)
    except ConfigError:
        raise
    except (ValueError, csv.Error):
        raise _damaged(path) from None


def _damaged(path: Path) -> ConfigError:
    return ConfigError(f"{path}: damaged; make the study again in another folder")


def _optional(path: Path, reader: Callable[[Path], Any], default: Any) -> Any:
    return _read(path, reader) if path.is_file() else default

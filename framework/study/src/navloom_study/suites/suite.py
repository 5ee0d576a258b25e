"""The file of a suite: worlds, conditions, seeds, the primary metric, and the methods that its authors ship."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from navloom.config import ConfigError
from navloom.config.config_errors import problems_of
from navloom.config.config_methods import problems_of_method, settings_of
from navloom.config.loader import text_of
from navloom.config.schema import Config
from navloom.config.table_parts import Table
from navloom.config.toml_lines import line_of
from navloom.inputs.bounds import TEXT_MB, read_file
from navloom.inputs.texts import toml_of
from navloom.plugins import Discovery, PluginError
from navloom.plugins.registry import nearest
from pydantic import Field, ValidationError

from navloom_study.study_methods import toml_value
from navloom_study.study_worlds import seeds_of

__all__ = ["Part", "Suite", "SuiteTable", "read_suite", "read_suite_table", "suite_named", "suite_names"]

NAME = r"^[a-z][a-z0-9_-]*-[0-9]+$"


class PartTable(Table):
    """Worlds of one condition."""

    name: str = Field(min_length=1, max_length=40, description="of the condition, unique in the suite")
    worlds: list[str] = Field(min_length=1, description="references and ranges, as in --worlds")
    set: dict[str, Any] = Field(default_factory=dict, description="of the config, beside the suite's own `set`")


class SuiteTable(Table):
    """The file of a suite."""

    name: str = Field(pattern=NAME, max_length=40, description="ends with the version, as doors-1")
    about: str = Field(min_length=1, description="one sentence for the page of results")
    primary: str = Field(description="the metric that decides")
    config: str = Field(
        description="shipped name, or a path relative to this file: robot, sensors, plugins of the rest"
    )
    seeds: str = Field(description="as in --seeds")
    methods: list[str] = Field(default_factory=list, description="of its authors, as in --vary; one family each")
    baseline: str = Field(description="method that is driven beside a file of methods where no results are stored")
    data: dict[str, str] = Field(default_factory=dict, description="SHA-256 of files in the folder NAVLOOM_DATA")
    set: dict[str, Any] = Field(default_factory=dict, description="conditions of every part")
    part: list[PartTable] = Field(min_length=1)


@dataclass(frozen=True)
class Part:
    """Worlds of one condition: `changes` of the config, each `PATH=VALUE`."""

    name: str
    worlds: tuple[str, ...]
    changes: tuple[str, ...]


@dataclass(frozen=True)
class Suite:
    """A suite.

    Attributes:
        name, about, primary, seeds, methods, baseline: See `SuiteTable`.
        config: Path or shipped name of the config.
        parts: The conditions with their worlds.
        base: Folder that references of worlds are relative to.
        sha256: Hash of everything that an episode depends on, the config included, and of the metric.
    """

    name: str
    about: str
    primary: str
    config: str
    seeds: tuple[int, ...]
    methods: tuple[str, ...]
    baseline: str
    parts: tuple[Part, ...]
    base: Path
    sha256: str


def suite_names(discovery: Discovery) -> list[str]:
    """Names of the installed suites, without reading any."""
    return discovery.names("suite")


def suite_named(reference: str, discovery: Discovery) -> Suite:
    """A suite by name, as `doors-1`, or from a file that ends in `.toml`.

    Raises:
        ConfigError: No such suite, or its file or data do not fit.
        PluginError: The distribution that ships it is broken.
    """
    if reference.endswith(".toml"):
        return read_suite(Path(reference))
    names = suite_names(discovery)
    if reference not in names:
        raise ConfigError(f"--suite {reference}: no such suite{nearest(reference, names)}; or name a .toml file")
    found = read_suite(discovery.suite(reference))
    if found.name != reference:
        raise PluginError(f"suite.{reference}: its file names itself {found.name!r}, expected {reference!r}")
    return found


def read_suite_table(path: Path) -> tuple[SuiteTable, str]:
    """The file of a suite and its text, without its data. Raises ConfigError with one line for each problem."""
    try:
        text = read_file(path, TEXT_MB, ConfigError).decode()
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"suite {path}: cannot be read: {error}") from None
    tree = toml_of(text, str(path), ConfigError)
    try:
        table = SuiteTable.model_validate(tree)
    except ValidationError as error:
        raise _located(path, text, problems_of(error, SuiteTable, given=tree)) from None
    if problems := [*_problems(table)]:
        raise _located(path, text, problems)
    return table, text


def read_suite(path: Path) -> Suite:
    """The suite of a file, with its data. Raises ConfigError."""
    table, _ = read_suite_table(path)
    config = str(path.parent / table.config) if table.config.endswith(".toml") else table.config
    common = _changes(table.set)
    parts = tuple(Part(p.name, tuple(p.worlds), (*common, *_changes(p.set))) for p in table.part)
    seeds = tuple(seeds_of(table.seeds))
    held = {
        "name": table.name, "primary": table.primary, "seeds": seeds, "data": table.data, "config": text_of(config),
        "parts": [vars(part) for part in parts],
    }  # fmt: skip
    digest = hashlib.sha256(json.dumps(held, sort_keys=True).encode()).hexdigest()
    base = _data_folder(path, table.data) if table.data else path.parent.absolute()
    return Suite(
        table.name, table.about, table.primary, config, seeds, tuple(table.methods), table.baseline, parts, base, digest
    )  # fmt: skip


def _problems(table: SuiteTable) -> list[str]:
    """A condition must not set what a method sets, or the method would lose it; and names must be unique."""
    found = []
    names = [part.name for part in table.part]
    for number, part in enumerate(table.part):
        if names.count(part.name) > 1:
            found.append(f"part.{number}.name: {part.name} is there twice; give each part its own name")
    tables = [("set", table.set), *((f"part.{number}.set", part.set) for number, part in enumerate(table.part))]
    for place, given in tables:
        for key, value in settings_of(given):
            if not [*problems_of_method(place, _nested(key, value), Config.model_fields)]:
                found.append(f"{place}.{key}: a method sets it; write it into the suite's config, as its default")
    return found


def _nested(place: str, value: Any) -> Mapping[str, Any]:
    for key in reversed(place.split(".")):
        value = {key: value}
    return value  # type: ignore[no-any-return]


def _changes(given: Mapping[str, Any]) -> tuple[str, ...]:
    return tuple(f"{place}={toml_value(value)}" for place, value in settings_of(given))


def _located(path: Path, text: str, problems: list[str]) -> ConfigError:
    lines = [(line_of(text, problem.partition(": ")[0]) or 0, problem) for problem in problems]
    return ConfigError(*(f"{path}:{line}: {problem}" if line else f"{path}: {problem}" for line, problem in lines))


def _data_folder(path: Path, data: Mapping[str, str]) -> Path:
    """The folder NAVLOOM_DATA, with the files of the suite in it."""
    given = os.environ.get("NAVLOOM_DATA", "")
    for name, digest in data.items():
        file = Path(given) / name
        if not given or not file.is_file():
            where = f"NAVLOOM_DATA names {given}, which has no {name}" if given else "NAVLOOM_DATA is not set"
            raise ConfigError(f"suite {path.stem}: {where}; set it to the folder that holds {name}")
        if (found := hashlib.sha256(file.read_bytes()).hexdigest()) != digest:
            raise ConfigError(f"suite {path.stem}: {file} has the SHA-256 {found[:12]}…, expected {digest[:12]}…")
    return Path(given).absolute()

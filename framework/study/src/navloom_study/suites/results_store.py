"""The folder of stored results: `SUITE/METHOD.json`, with the cost of computing and pictures beside."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from navloom.config import ConfigError
from navloom.files import make_writable, write_each
from navloom.inputs.bounds import TEXT_MB, read_file
from navloom.inputs.texts import json_of

from navloom_study.study_folder import StudyError
from navloom_study.study_methods import toml_value
from navloom_study.suites.result_file import SuiteResult, read_result

__all__ = ["SHIPPED", "cost_beside", "known_results", "store", "stem_of", "stored_cost", "stored_results"]

SHIPPED = Path(__file__).with_name("rows")
"""The rows that come with navloom: in a copy of the project a link to `docs/results`."""


def stored_results(folder: Path) -> list[SuiteResult]:
    """Every stored result, each of one method, sorted by suite and method; none if there is no such folder."""
    return [read_result(path) for path in sorted(folder.glob("*/*.json")) if not path.name.endswith(".cost.json")]


def known_results(folder: Path) -> list[SuiteResult]:
    """The results in a folder, and those that come with navloom of methods that the folder has none of."""
    found = [*stored_results(folder), *stored_results(SHIPPED)]
    first = {(one.suite, *one.methods): one for one in reversed(found)}
    return [first[key] for key in sorted(first)]


def stem_of(method: str) -> str:
    """Name of a method's files, without the ending."""
    return method.replace("@", "-at-")


def store(folder: Path, result: SuiteResult, cost: Any, pictures: Mapping[str, bytes]) -> list[Path]:
    """Store the result of each method, what it costs to compute, and pictures, by `METHOD-WHAT.png`.

    A method that is not the suite's own is stored as a file of methods too, for the command that runs it again.

    Raises:
        ConfigError: The folder cannot be written. StudyError: The disk is full.
    """
    for method, table in result.methods.items():
        known = folder / result.suite / f"{stem_of(method)}.json"
        if known.is_file() and read_result(known).methods[method].get("set") != table["set"]:
            raise ConfigError(f"{known}: holds another method of that name; rename yours")
    there = folder / result.suite
    make_writable(there)
    files: dict[str, str | bytes] = dict(pictures)
    for method in result.methods:
        files[f"{stem_of(method)}.json"] = result.of(method).text()
        if (given := result.methods[method]["set"]) is not None:
            files[f"{stem_of(method)}.toml"] = f'[[method]]\nname = "{method}"\nset = {toml_value(given)}\n'
        if method in cost:
            told = {**cost[method], "processor": result.processor}
            files[f"{stem_of(method)}.cost.json"] = json.dumps(told, indent=1) + "\n"
    for name, why in write_each(there, files).items():
        raise StudyError(f"{there / name}: {why}")
    return [there / name for name in files]


def cost_beside(result: Path) -> Any:
    """Contents of `cost.json` beside the file of a result; empty without one."""
    return _json(result.with_name("cost.json"))


def stored_cost(folder: Path, suite: str, method: str) -> Any:
    """What a stored method costs to compute; empty if that is not known."""
    there = folder if (folder / suite / f"{stem_of(method)}.json").is_file() else SHIPPED
    return _json(there / suite / f"{stem_of(method)}.cost.json")


def _json(path: Path) -> Any:
    return json_of(read_file(path, TEXT_MB, ConfigError), str(path), ConfigError) if path.is_file() else {}

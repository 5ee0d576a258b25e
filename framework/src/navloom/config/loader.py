"""From a TOML file and `--set` overrides to a checked config that knows where each value came from."""

from __future__ import annotations

import hashlib
import json
import tomllib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ValidationError

from navloom.config.schema import ROLE_TABLES, Config
from navloom.plugins.registry import nearest

__all__ = ["ConfigError", "Loaded", "check_params", "load_config", "shipped_configs"]

Source = Literal["default", "file", "--set"]
RESERVED = frozenset({"plugin", "name", "sensors", "rate_hz", "latency", "role", "shadow"})


class ConfigError(ValueError):
    """The config cannot be used; the text names the place, the value, the expectation and the nearest fix."""


@dataclass(frozen=True)
class Loaded:
    """A checked config.

    Attributes:
        config: What holds.
        name: Path or shipped name it came from.
        base: Folder relative paths in it start from.
        sources: By dotted place, where the value came from; what is not listed is a default.
        dropped: Places of the file's parameters that a `--set` of another plugin made void.
    """

    config: Config
    name: str
    base: Path
    sources: dict[str, Source]
    dropped: tuple[str, ...]

    def base_of(self, place: str) -> Path:
        """Folder that relative paths of a value start from: the file's, or the current one for `--set`."""
        return Path.cwd() if self.sources.get(place) == "--set" else self.base

    def sha256(self) -> str:
        """Hash of everything that holds, defaults included; where it is written does not matter."""
        text = json.dumps(self.config.model_dump(mode="json"), sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()

    def to_json(self) -> dict[str, Any]:
        """For another process of the same run: it must not read a file that may have changed since."""
        return {
            "config": self.config.model_dump(mode="json", exclude_unset=True),
            "name": self.name,
            "base": str(self.base.absolute()),
            "sources": self.sources,
        }

    @classmethod
    def from_json(cls, given: dict[str, Any]) -> Loaded:
        """The config another process was started with."""
        return cls(Config.model_validate(given["config"]), given["name"], Path(given["base"]), given["sources"], ())


def shipped_configs() -> dict[str, str]:
    """Text of each config that comes with navloom, by name."""
    folder = files("navloom.config") / "shipped"
    found = [entry for entry in folder.iterdir() if entry.name.endswith(".toml")]
    return {entry.name.removesuffix(".toml"): entry.read_text("utf-8") for entry in sorted(found, key=lambda e: e.name)}


def load_config(reference: str, overrides: Iterable[str] = (), seed: int | None = None) -> Loaded:
    """Read a config by path or shipped name, apply `a.b=value` overrides, check it.

    Raises:
        ConfigError: No such file, not TOML, or a value that does not fit.
    """
    text, base = _read(reference)
    try:
        tree = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{reference}: not TOML: {error}") from None
    sources: dict[str, Source] = {place: "file" for place, _ in leaves(tree)}
    dropped: list[str] = []
    changes = list(overrides) + ([f"run.seed={seed}"] if seed is not None else [])
    # A change of plugin voids parameters of the old one, so it goes before the new one's parameters.
    for change in sorted(changes, key=lambda text: not text.partition("=")[0].endswith(".plugin")):
        _override(tree, change, sources, dropped)
    try:
        config = Config.model_validate(tree)
    except ValidationError as error:
        raise ConfigError(f"{reference}: {explain(error, Config)}") from None
    return Loaded(config, reference, base, sources, tuple(dropped))


def _read(reference: str) -> tuple[str, Path]:
    shipped = shipped_configs()
    if reference in shipped:
        return shipped[reference], Path.cwd()
    path = Path(reference)
    try:
        return path.read_text("utf-8"), path.parent
    except (FileNotFoundError, NotADirectoryError):
        raise ConfigError(
            f"config {reference!r}: no such file, and no shipped config of that name{nearest(reference, list(shipped))}"
        ) from None
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"config {reference!r} cannot be read: {error}") from None


def leaves(tree: Any, place: str = "") -> Iterator[tuple[str, Any]]:
    """Every value of a tree with its dotted place; tables in arrays are counted from 0."""
    if isinstance(tree, dict):
        for key, value in tree.items():
            yield from leaves(value, f"{place}.{key}" if place else key)
    elif isinstance(tree, list) and tree and all(isinstance(entry, dict) for entry in tree):
        for number, entry in enumerate(tree):
            yield from leaves(entry, f"{place}.{number}")
    else:
        yield place, tree


def _override(tree: dict[str, Any], change: str, sources: dict[str, Source], dropped: list[str]) -> None:
    place, value = parse_override(change)
    table, keys = tree, place.split(".")
    for depth, key in enumerate(keys[:-1]):
        table = _enter(table, key, ".".join(keys[: depth + 1]), change)
    if not isinstance(table, dict):
        raise ConfigError(f"--set {change}: {'.'.join(keys[:-1])} is a list; name one of its tables")
    where = ".".join(_numbered(tree, keys))
    names_plugin = keys[-1] == "plugin" and ((len(keys) == 2 and keys[0] in ROLE_TABLES) or keys[0] == "alternative")
    if names_plugin and table.get("plugin") != value:
        for old in [key for key in table if key not in RESERVED]:
            dropped.append(f"{where.removesuffix('.plugin')}.{old}")
            del table[old]
            sources.pop(dropped[-1], None)
    table[keys[-1]] = value
    for old in [place for place in sources if place.startswith(where + ".")]:
        del sources[old]
    for leaf, _ in leaves(value, where):
        sources[leaf] = "--set"


def _enter(table: Any, key: str, place: str, change: str) -> Any:
    """The table below a key; of an array of tables the one with that number or `name`."""
    if isinstance(table, list):
        for number, entry in enumerate(table):
            if key in (str(number), entry.get("name"), entry.get("plugin")):
                return entry
        known = [str(entry.get("name", number)) for number, entry in enumerate(table)]
        raise ConfigError(f"--set {change}: there is no {place}{nearest(key, known)}")
    inner = table.setdefault(key, {})
    if not isinstance(inner, (dict, list)):
        raise ConfigError(f"--set {change}: {place} is the value {inner!r}, not a table")
    return inner


def _numbered(tree: Any, keys: list[str]) -> list[str]:
    """The keys with names of tables in arrays replaced by their numbers."""
    out: list[str] = []
    for key in keys:
        if isinstance(tree, list):
            number = next(i for i, entry in enumerate(tree) if key in (str(i), entry.get("name"), entry.get("plugin")))
            out.append(str(number))
            tree = tree[number]
        else:
            out.append(key)
            tree = tree.get(key) if isinstance(tree, dict) else None
    return out


def parse_override(change: str) -> tuple[str, Any]:
    """Key and value of `key=value`. Raises ConfigError where there is no `=`."""
    key, equals, text = change.partition("=")
    if not equals or not key.strip():
        raise ConfigError(f"--set {change}: expected PATH=VALUE, as in --set controller.k3=1.0")
    return key.strip(), _value(text)


def _value(text: str) -> Any:
    """A TOML value, or the text itself where it is none."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text.strip()


def explain(error: ValidationError, model: type[BaseModel], prefix: str = "") -> str:
    """A validation error as one message: place, value, expectation, nearest fix, and how many more there are."""
    problems = error.errors(include_url=False)
    first = problems[0]
    place = ".".join([prefix, *map(str, first["loc"])] if prefix else map(str, first["loc"]))
    more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
    if first["type"] == "extra_forbidden":
        known = list(_model_at(model, first["loc"][:-1]).model_fields)
        return f"{place}: unknown key{nearest(str(first['loc'][-1]), known)}{more}"
    if first["type"] == "missing":
        return f"{place}: is missing{more}"
    message = first["msg"].removeprefix("Value error, ")
    message = message[0].lower() + message[1:]
    value = "" if isinstance(first["input"], (dict, BaseModel)) else f"got {first['input']!r}, "
    return f"{place or 'config'}: {value}{message}{more}"


def _model_at(model: type[BaseModel], path: Iterable[str | int]) -> type[BaseModel]:
    for key in path:
        field = model.model_fields.get(str(key))
        if field is not None:
            model = next((m for m in _models_in(field.annotation)), model)
    return model


def _models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for inner in getattr(annotation, "__args__", ()):
        yield from _models_in(inner)


def check_params(params: type[BaseModel], table: dict[str, Any], place: str) -> Any:
    """A plugin's parameters from its table.

    Raises:
        ConfigError: A key it does not know, or a value that does not fit.
    """
    try:
        return params.model_validate(table)
    except ValidationError as error:
        raise ConfigError(explain(error, params, place)) from None

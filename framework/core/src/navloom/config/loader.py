"""Loads a TOML file with `--set` overrides into a checked config that knows the source of each value."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from importlib.resources import files
from itertools import islice
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from navloom.config.config_errors import ConfigError, check_params, problems_of
from navloom.config.config_methods import ALTERNATIVE_INSTEAD, named_method, settings_of
from navloom.config.config_presets import instance_of, params_of, split_preset
from navloom.config.schema import Config
from navloom.config.tables import DEFAULT_PLUGINS, REQUIRED_ROLES, ROLE_TABLES
from navloom.config.toml_lines import line_of
from navloom.inputs.assignments import brief, read_assignment
from navloom.inputs.bounds import TEXT_MB, read_file
from navloom.inputs.texts import shortened, toml_of
from navloom.plugins import Discovery, PluginError
from navloom.plugins.registry import close_to, nearest
from navloom.roles import FIXED
from navloom.roles.base import RESERVED_KEYS
from navloom.roles.presets import named_plugin

__all__ = ["ConfigError", "Loaded", "check_params", "load_config", "shipped_configs"]

ARRAYS = ("sensor", "node", "alternative", "event", "method")
"""Places of arrays of tables."""
SHOWN = 50
"""Most problems that one error lists."""

Source = str
"""Where a value came from: default, file, method NAME, --set, --shadow or kept pose."""


@dataclass(frozen=True)
class Loaded:
    """A checked config.

    Attributes:
        config: The checked config.
        name: Its path or shipped name.
        base: Folder for relative paths in it.
        sources: Source of each value, by dotted place; places that are not listed have their default.
        dropped: Places of the file's parameters that were dropped because a method or `--set` names another plugin.
        text: Text of the file; empty for none.
    """

    config: Config
    name: str
    base: Path
    sources: dict[str, Source]
    dropped: tuple[str, ...]
    text: str = field(default="", repr=False, compare=False)

    def error(self, *problems: str) -> ConfigError:
        """An error with one line per problem, each with its line in the file, or its `--set`."""
        return _located(problems, self.name, self.text, self.sources)

    def notices(self) -> list[str]:
        """Notices for the user before the robot drives: dropped parameters, and a default footprint."""
        said = [f"{place} belongs to the replaced plugin: dropped" for place in self.dropped]
        if not self.gives("robot.footprint"):
            shape = self.config.robot.footprint
            size = f"{{ length = {shape.length:g}, width = {shape.width:g} }}"
            said.append(f"{self.name}: robot.footprint: is missing; default {size}, in m: give your robot's size")
        return said

    def gives(self, place: str) -> bool:
        """Whether the file, its method or a `--set` gives this value, or a value in this table."""
        return any(known == place or known.startswith(f"{place}.") for known in self.sources)

    def base_of(self, place: str) -> Path:
        """Folder for relative paths in a value: the file's, or the current one for `--set`."""
        return Path.cwd() if self.sources.get(place) == "--set" else self.base

    def sha256(self) -> str:
        """Hash of all values, defaults included; independent of their sources."""
        text = json.dumps(self.config.model_dump(mode="json"), sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()

    def to_json(self) -> dict[str, Any]:
        """The config as JSON for another process of the same run, since the file may have changed meanwhile."""
        return {
            "config": self.config.model_dump(mode="json", exclude_unset=True),
            "name": self.name,
            "base": str(self.base.absolute()),
            "sources": self.sources,
        }

    @classmethod
    def from_json(cls, given: dict[str, Any]) -> Loaded:
        """The config from `to_json`."""
        return cls(Config.model_validate(given["config"]), given["name"], Path(given["base"]), given["sources"], ())


def shipped_configs() -> dict[str, str]:
    """Text of each config that comes with navloom, by name."""
    folder = files("navloom.config") / "shipped"
    found = [entry for entry in folder.iterdir() if entry.name.endswith(".toml")]
    return {entry.name.removesuffix(".toml"): entry.read_text("utf-8") for entry in sorted(found, key=lambda e: e.name)}


def load_config(
    reference: str,
    overrides: Iterable[str] = (),
    seed: int | None = None,
    shadows: Iterable[str] = (),
    method: str = "",
) -> Loaded:
    """Read a config by path or shipped name, apply its method, then `a.b=value` overrides, add shadows, and check it.

    Args:
        reference: Path, or name of a shipped config.
        overrides: Values of `--set`.
        seed: Value of `--seed`.
        shadows: Values of `--shadow`, as `avoider=vff,vfh@printed`.
        method: Name of the `[[method]]` that applies; empty for none.

    Raises:
        ConfigError: The file is missing or not TOML, or a value does not fit.
    """
    if seed is not None and not 0 <= seed < 2**63:
        raise ConfigError(f"--seed {seed}: expected a whole number of 0 to {2**63 - 1}")
    text, base = _read(reference)
    tree = toml_of(text, reference, ConfigError)
    _split_presets(tree)
    sources: dict[str, Source] = {place: "file" for place, _ in leaves({**tree, "method": {}})}
    dropped: list[str] = []
    if method:
        _apply_method(tree, method, reference, sources, dropped)
    changes = list(overrides) + ([f"run.seed={seed}"] if seed is not None else [])
    # A change of plugin drops the old one's parameters, so it must come before the new one's parameters.
    for change in sorted(changes, key=lambda text: not text.partition("=")[0].endswith(".plugin")):
        _override(tree, change, sources, dropped)
    _split_presets(tree)
    for text in shadows:
        _add_shadows(tree, text, sources)
    try:
        config = Config.model_validate(tree)
    except ValidationError as error:
        problems = [*problems_of(error, Config, given=tree), *_problems_of_params(tree)]
        raise _located(problems, reference, text, sources) from None
    return Loaded(config, reference, base, sources, tuple(dropped), text)


def _located(problems: Iterable[str], name: str, text: str, sources: dict[str, Source]) -> ConfigError:
    """An error of problems that begin with their places, each prefixed with its file and line, or its `--set`."""
    lines: list[tuple[float, str]] = []
    first = list(islice(problems, SHOWN + 1))
    for problem in first[:SHOWN]:
        place = problem.partition(": ")[0]
        given_by = {source for known, source in sources.items()
                    if source != "file" and (known == place or known.startswith(f"{place}."))}  # fmt: skip
        option = min((source for source in given_by if source.startswith("--")), default="")
        method = next((source for source in given_by if source.startswith("method ")), "")
        if option:
            lines.append((math.inf, f"{option} {problem}"))
            continue
        if method:
            place, problem = _place_of_method(text, method, place), f"{method}: {problem}"
        line = line_of(text, place) if text and " " not in place else None
        lines.append((line or 0, f"{name}:{line}: {problem}" if line else f"{name}: {problem}"))
    more = [f"{name}: more problems; fix the first {SHOWN}"] if len(first) > SHOWN else []
    return ConfigError(*(text for _, text in sorted(lines, key=lambda entry: entry[0])), *more)


def _place_of_method(text: str, method: str, place: str) -> str:
    """Where a method of the file, as in `method mppi`, gives the value of a place."""
    tables = _tables(toml_of(text, "", ConfigError), "method") if text else []
    number = next((n for n, table in enumerate(tables) if f"method {table.get('name')}" == method), 0)
    return f"method.{number}.set.{place}"


def _problems_of_params(tree: dict[str, Any]) -> list[str]:
    """Problems of the plugins' parameters in a file that has other problems too, so that all are reported at once."""
    found = []
    tables: list[tuple[str, Any, Any]] = [
        (role, role, tree.get(role, {})) for role in ROLE_TABLES if role in REQUIRED_ROLES or role in tree
    ]
    nodes = [table for table in _tables(tree, "node") if isinstance(table.get("name"), str)]
    tables += [(f"node.{number}", table["name"], table) for number, table in enumerate(nodes)]
    tables += [
        (f"alternative.{number}", table.get("role"), table) for number, table in enumerate(_tables(tree, "alternative"))
    ]
    roles = {*ROLE_TABLES, *(table["name"] for table in nodes)}
    discovery = Discovery()
    for place, role, table in tables:
        plugin = table.get("plugin", DEFAULT_PLUGINS.get(place)) if isinstance(table, dict) else None
        if not isinstance(plugin, str) or role not in roles:
            continue
        try:
            params = {key: value for key, value in table.items() if key not in RESERVED_KEYS}
            params_of(discovery.plugin(role, plugin), table.get("preset"), params, place)
        except PluginError as error:
            found.append(f"{place}.plugin: {error}")
        except ConfigError as error:
            found.extend(error.problems)
    return found


def _tables(tree: dict[str, Any], name: str) -> list[dict[str, Any]]:
    """The tables of an array; empty if it is none."""
    tables = tree.get(name)
    return tables if isinstance(tables, list) and all(isinstance(table, dict) for table in tables) else []


def text_of(reference: str) -> str:
    """Text of a config, by path or shipped name, unchecked. Raises ConfigError if it cannot be read."""
    return _read(reference)[0]


def _read(reference: str) -> tuple[str, Path]:
    shipped = shipped_configs()
    if reference in shipped:
        return shipped[reference], Path.cwd()
    path = Path(reference)
    if path.suffix in (".yaml", ".yml"):
        raise ConfigError(
            f"config {reference!r}: expected a .toml file; a map of ROS is a world, as in --set world.ref={reference}"
        )
    try:
        return read_file(path, TEXT_MB, ConfigError).decode("utf-8"), path.parent
    except (FileNotFoundError, NotADirectoryError):
        files = [str(path.with_name(file.name)) for file in path.parent.glob("*.toml")]
        near = close_to(reference, files) or nearest(reference, list(shipped))
        raise ConfigError(f"config {reference!r}: no such file, and no shipped config of that name{near}") from None
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"config {reference!r} cannot be read: {error}") from None


def leaves(tree: Any, place: str = "") -> Iterator[tuple[str, Any]]:
    """Every value of a tree with its dotted place; tables in arrays are numbered from 0."""
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
    if place.partition(".")[0] == "method":
        raise ConfigError(
            f"--set {brief(change)}: --set applies after a method; choose one with --method NAME, or set the value "
            "itself, as in --set navigation.handover=always"
        )
    _assign(tree, place.split("."), value, ("--set", f"--set {brief(change)}"), sources, dropped)


def _apply_method(
    tree: dict[str, Any], name: str, reference: str, sources: dict[str, Source], dropped: list[str]
) -> None:
    """Apply the overrides of a `[[method]]`; the check of the whole config refuses those that no method may set."""
    given = named_method(_tables(tree, "method"), name, reference)
    # As with `--set`: a change of plugin drops the old one's parameters, so it comes first.
    for place, value in sorted(settings_of(given), key=lambda entry: not entry[0].endswith(".plugin")):
        said = f"{reference}: method {name}: {brief(place)}"
        _assign(tree, place.split("."), value, (f"method {name}", said), sources, dropped)
    _split_presets(tree)


def _assign(
    tree: dict[str, Any],
    keys: list[str],
    value: Any,
    given_by: tuple[Source, str],
    sources: dict[str, Source],
    dropped: list[str],
) -> None:
    """Set a value of the tree.

    Args:
        tree: The config.
        keys: Place of the value; tables in arrays by number, name or plugin.
        value: The value.
        given_by: Its source, and the beginning of a message about it.
        sources: Source of each value, to be updated.
        dropped: Receives the places of parameters that a change of plugin drops.
    """
    table, (source, said) = tree, given_by
    for depth, key in enumerate(keys[:-1]):
        table = _enter(table, key, ".".join(keys[: depth + 1]), said)
    if not isinstance(table, dict):
        raise ConfigError(f"{said}: {'.'.join(keys[:-1])} is a list; name one of its tables")
    where = ".".join(_numbered(tree, keys))
    of_instance = (len(keys) == 2 and keys[0] in ROLE_TABLES) or keys[0] in ("alternative", "node")
    if keys[-1] == "plugin" and of_instance and isinstance(value, str):
        value, preset = named_plugin(value)
        if (table.get("plugin"), table.get("preset")) != (value, preset):
            for old in [key for key in table if key not in RESERVED_KEYS or key == "preset"]:
                dropped.append(f"{where.removesuffix('.plugin')}.{old}")
                del table[old]
                sources.pop(dropped[-1], None)
        if preset is not None:
            table["preset"] = preset
            sources[f"{where.removesuffix('plugin')}preset"] = source
    for old in [place for place in sources if place == where or place.startswith(where + ".")]:
        del sources[old]
    if value == "default":  # as if the file did not give it, so that it may follow from the robot
        table.pop(keys[-1], None)
        return
    table[keys[-1]] = value
    for leaf, _ in leaves(value, where):
        sources[leaf] = source


def _split_presets(tree: dict[str, Any]) -> None:
    """Give the preset in `plugin = "vfh@printed"` a key of its own; a table that names two is left for the check."""
    places = [tree.get(role) for role in ROLE_TABLES] + _tables(tree, "node") + _tables(tree, "alternative")
    for table in places:
        if isinstance(table, dict):
            with suppress(ValueError):
                table.update(split_preset(table))


def _add_shadows(tree: dict[str, Any], text: str, sources: dict[str, Source]) -> None:
    """Add an alternative in shadow for each name of `avoider=vff,vfh@printed`; one that the config has runs too."""
    role, wanted = parse_shadows(text)
    nodes = [str(table.get("name")) for table in _tables(tree, "node")]
    known = [known for known in (*ROLE_TABLES, *nodes) if known not in FIXED]
    if role == "method" and role not in known:
        raise ConfigError(f"--shadow {brief(text)}: {ALTERNATIVE_INSTEAD}")
    if role not in known:
        raise ConfigError(f"--shadow {brief(text)}: no role {role!r} that can be shadowed{nearest(role, known)}")
    tables = tree.setdefault("alternative", [])
    if not isinstance(tables, list) or tables != _tables(tree, "alternative"):
        return  # the check of the whole config refuses it
    active = next((table for table in _tables(tree, "node") if table.get("name") == role), None) or tree.get(role, {})
    if isinstance(active, dict) and (name := instance_of({"plugin": DEFAULT_PLUGINS.get(role), **active})) in wanted:
        raise ConfigError(f"--shadow {brief(text)}: {name} is the active {role}; name others, or another preset of it")
    for name in wanted:
        own = (n for n, table in enumerate(tables) if table.get("role") == role and instance_of(table) == name)
        number = next(own, None)
        if number is None:
            number = len(tables)
            is_method = name in [table.get("name") for table in _tables(tree, "method")]
            if is_method and name not in Discovery().names(role):
                raise ConfigError(f"--shadow {brief(text)}: {name} is a [[method]]: {ALTERNATIVE_INSTEAD}")
            plugin, preset = named_plugin(name)
            tables.append({"role": role, "plugin": plugin, **({} if preset is None else {"preset": preset})})
        tables[number]["shadow"] = True
        for leaf, _ in leaves(tables[number], f"alternative.{number}"):
            sources.setdefault(leaf, "--shadow")
        sources[f"alternative.{number}.shadow"] = "--shadow"


def _enter(table: Any, key: str, place: str, said: str) -> Any:
    """The table below a key; in an array of tables, the one with that number, `name` or `plugin`."""
    if isinstance(table, list):
        for number, entry in enumerate(table):
            if key in (str(number), entry.get("name"), entry.get("plugin")):
                return entry
        known = [str(entry.get("name", number)) for number, entry in enumerate(table)]
        hint = nearest(key, known) if known else f"; the config has no [[{place.partition('.')[0]}]]"
        raise ConfigError(f"{said}: there is no {brief(place)}{hint}")
    inner = table.setdefault(key, [] if place in ARRAYS else {})
    if not isinstance(inner, (dict, list)):
        raise ConfigError(f"{said}: {brief(place)} is the value {shortened(inner)}, not a table")
    return inner


def _numbered(tree: Any, keys: list[str]) -> list[str]:
    """The keys, with names of tables in arrays replaced by their numbers."""
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


def parse_shadows(text: str) -> tuple[str, list[str]]:
    """Role and names of `avoider=vff,vfh@printed`, a value of `--shadow`. Raises ConfigError if it is malformed."""
    role, _, names = (part.strip() for part in text.partition("="))
    wanted = [name.strip() for name in names.split(",")]
    if not role or not all(wanted):
        raise ConfigError(f"--shadow {brief(text)}: expected ROLE=NAME,NAME, as in --shadow avoider=vff,vfh@printed")
    return role, wanted


def parse_override(change: str) -> tuple[str, Any]:
    """Key and value of `key=value`. Raises ConfigError if it is malformed."""
    return read_assignment(change, "--set", ConfigError)

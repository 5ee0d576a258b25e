"""Loads a TOML file with `--set` overrides into a checked config that knows the source of each value."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from importlib.resources import files
from itertools import islice
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from navloom.config.config_errors import ConfigError, check_params, problems_of
from navloom.config.config_members import (
    change_of_member,
    each_member,
    named_member,
    seed_of_member,
    settings_of_member,
)
from navloom.config.config_methods import ALTERNATIVE_INSTEAD, named_method, settings_of
from navloom.config.config_presets import instance_of, params_of
from navloom.config.config_tree import Source, assign, leaves, split_presets, tables_of
from navloom.config.schema import Config
from navloom.config.tables import DEFAULT_PLUGINS, REQUIRED_ROLES, ROLE_TABLES
from navloom.config.toml_lines import line_of
from navloom.inputs.assignments import brief, read_assignment
from navloom.inputs.bounds import TEXT_MB, read_file
from navloom.inputs.texts import toml_of
from navloom.plugins import Discovery, PluginError
from navloom.plugins.registry import close_to, nearest
from navloom.roles import FIXED
from navloom.roles.base import RESERVED_KEYS
from navloom.roles.presets import named_plugin

__all__ = ["ConfigError", "Loaded", "check_params", "load_config", "shipped_configs"]

SHOWN = 50
"""Most problems that one error lists."""


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
        member: Name of the `[[member]]` that it is for; empty for a robot alone.
        number: Number of that member in its fleet, from 0: it has this task of the world.
        fleet_base: Folder for relative paths in the fleet's file; None for a robot alone.
        fleet_seed: Seed of the fleet, from which that of the member follows; None for a robot alone.
    """

    config: Config
    name: str
    base: Path
    sources: dict[str, Source]
    dropped: tuple[str, ...]
    text: str = field(default="", repr=False, compare=False)
    member: str = ""
    number: int = 0
    fleet_base: Path | None = None
    fleet_seed: int | None = None

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
        """Folder for relative paths in a value: that of the file that gives it, or the current one for `--set`."""
        source = self.sources.get(place, "")
        if self.fleet_base is not None and source.startswith(("fleet", "member ")):
            return self.fleet_base
        return Path.cwd() if source == "--set" else self.base

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
            **(
                {"member": self.member, "number": self.number, "fleet_base": str(self.fleet_base.absolute())}
                if self.fleet_base is not None
                else {}
            ),
        }

    @classmethod
    def from_json(cls, given: dict[str, Any]) -> Loaded:
        """The config from `to_json`."""
        config, base, fleet_base = Config.model_validate(given["config"]), Path(given["base"]), given.get("fleet_base")
        return cls(
            config, given["name"], base, given["sources"], (), member=given.get("member", ""),
            number=given.get("number", 0), fleet_base=None if fleet_base is None else Path(fleet_base),
        )  # fmt: skip


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
    member: str = "",
) -> Loaded:
    """Read a config by path or shipped name, apply its method, then `a.b=value` overrides, add shadows, and check it.

    Args:
        reference: Path, or name of a shipped config.
        overrides: Values of `--set`.
        seed: Value of `--seed`.
        shadows: Values of `--shadow`, as `avoider=vff,vfh@printed`.
        method: Name of the `[[method]]` that applies; empty for none.
        member: Name of the `[[member]]` whose config is wanted; empty for that of the file itself.

    Raises:
        ConfigError: The file is missing or not TOML, or a value does not fit.
    """
    if seed is not None and not 0 <= seed < 2**63:
        raise ConfigError(f"--seed {seed}: expected a whole number of 0 to {2**63 - 1}")
    text, base = _read(reference)
    tree = toml_of(text, reference, ConfigError)
    split_presets(tree)
    sources, dropped, fleet_base, name, number = _sources_of(tree), list[str](), None, reference, 0
    members = tables_of(tree, "member")
    if not member and members:
        raise ConfigError(
            f"{reference}: member: several robots, which only `navloom run` and `compare` drive: name the config of one"
        )
    if member:
        number, table = named_member(members, member, reference)
        name, text, fleet_base = f"{reference}: member {member}", "", base
        tree, base, sources = _tree_of_member(tree, base, member, table, reference, dropped)
    if method:
        _lay(tree, settings_of(named_method(tables_of(tree, "method"), method, reference)), f"method {method}",
             reference, sources, dropped)  # fmt: skip
    own = [change_of_member(change, member, members) for change in overrides] if member else overrides
    changes = [change for change in own if change is not None] + ([f"run.seed={seed}"] if seed is not None else [])
    # A change of plugin drops the old one's parameters, so it must come before the new one's parameters.
    for change in sorted(changes, key=lambda text: not text.partition("=")[0].endswith(".plugin")):
        _override(tree, change, sources, dropped)
    split_presets(tree)
    for added in shadows:
        _add_shadows(tree, added, sources)
    run, fleet_seed = tree.setdefault("run", {}) if member else None, None
    if isinstance(run, dict) and isinstance(run.get("seed", 0), int):
        fleet_seed = run.get("seed", 0)
        if sources.get("run.seed") != f"member {member}":
            run["seed"] = seed_of_member(fleet_seed, member)
    try:
        config = Config.model_validate(tree)
    except ValidationError as error:
        problems = [*problems_of(error, Config, given=tree), *_problems_of_params(tree)]
        raise _located(problems, name, text, sources) from None
    return Loaded(config, name, base, sources, tuple(dropped), text, member, number, fleet_base, fleet_seed)


def _sources_of(tree: dict[str, Any]) -> dict[str, Source]:
    return {place: "file" for place, _ in leaves({**tree, "method": {}, "member": {}})}


def _tree_of_member(
    fleet: dict[str, Any], base: Path, name: str, table: Mapping[str, Any], reference: str, dropped: list[str]
) -> tuple[dict[str, Any], Path, dict[str, Source]]:
    """The tree of a member's config before `--set`, the folder of its file, and the sources of its values."""
    tree = {key: value for key, value in fleet.items() if key != "member"}
    sources = _sources_of(tree)
    if isinstance(config := table.get("config"), str):
        common, inner = tree, config if config in shipped_configs() else str(base / config)
        text, base = _read(inner)
        tree = toml_of(text, inner, ConfigError)
        if "member" in tree:
            raise ConfigError(f"{reference}: member {name}: config: {inner} is a fleet itself; name that of one robot")
        split_presets(tree)
        sources = _sources_of(tree)
        _lay(tree, settings_of(common), "fleet", reference, sources, dropped)
    _lay(tree, settings_of_member(table), f"member {name}", reference, sources, dropped)
    # The check of the whole config looks at these tables too.
    tree["member"] = fleet["member"]
    return tree, base, sources


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
    tables = tables_of(toml_of(text, "", ConfigError), "method") if text else []
    number = next((n for n, table in enumerate(tables) if f"method {table.get('name')}" == method), 0)
    return f"method.{number}.set.{place}"


def _problems_of_params(tree: dict[str, Any]) -> list[str]:
    """Problems of the plugins' parameters in a file that has other problems too, so that all are reported at once."""
    found = []
    tables: list[tuple[str, Any, Any]] = [
        (role, role, tree.get(role, {})) for role in ROLE_TABLES if role in REQUIRED_ROLES or role in tree
    ]
    nodes = [table for table in tables_of(tree, "node") if isinstance(table.get("name"), str)]
    tables += [(f"node.{number}", table["name"], table) for number, table in enumerate(nodes)]
    tables += [
        (f"alternative.{number}", table.get("role"), table)
        for number, table in enumerate(tables_of(tree, "alternative"))
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


def text_of(reference: str) -> str:
    """Text of a config, by path or shipped name, unchecked. Raises ConfigError if it cannot be read."""
    return _read(reference)[0]


def members_of(reference: str) -> list[str]:
    """Names of the members of a config, by path or shipped name; none if it is of one robot. Raises ConfigError."""
    tables = tables_of(toml_of(text_of(reference), reference, ConfigError), "member")
    for number, table in enumerate(tables):
        if not isinstance(table.get("name"), str):
            raise ConfigError(f'{reference}: member.{number}.name: is missing or no text; give one, as in name = "a"')
    return [table["name"] for table in each_member(tables)]


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


def _override(tree: dict[str, Any], change: str, sources: dict[str, Source], dropped: list[str]) -> None:
    place, value = parse_override(change)
    if place.partition(".")[0] == "member":
        raise ConfigError(f"--set {brief(change)}: member is of a fleet, and this is the config of one robot")
    if place.partition(".")[0] == "method":
        raise ConfigError(
            f"--set {brief(change)}: --set applies after a method; choose one with --method NAME, or set the value "
            "itself, as in --set navigation.handover=always"
        )
    assign(tree, place.split("."), value, ("--set", f"--set {brief(change)}"), sources, dropped)


def _lay(
    tree: dict[str, Any],
    settings: Iterable[tuple[str, Any]],
    source: Source,
    reference: str,
    sources: dict[str, Source],
    dropped: list[str],
) -> None:
    """Lay the values of a method, a fleet or a member over a config; its check refuses those that it may not have."""
    # As with `--set`: a change of plugin drops the old one's parameters, so it comes first.
    for place, value in sorted(settings, key=lambda entry: not entry[0].endswith(".plugin")):
        assign(tree, place.split("."), value, (source, f"{reference}: {source}: {brief(place)}"), sources, dropped)
    split_presets(tree)


def _add_shadows(tree: dict[str, Any], text: str, sources: dict[str, Source]) -> None:
    """Add an alternative in shadow for each name of `avoider=vff,vfh@printed`; one that the config has runs too."""
    role, wanted = parse_shadows(text)
    nodes = [str(table.get("name")) for table in tables_of(tree, "node")]
    known = [known for known in (*ROLE_TABLES, *nodes) if known not in FIXED]
    if role == "method" and role not in known:
        raise ConfigError(f"--shadow {brief(text)}: {ALTERNATIVE_INSTEAD}")
    if role not in known:
        raise ConfigError(f"--shadow {brief(text)}: no role {role!r} that can be shadowed{nearest(role, known)}")
    tables = tree.setdefault("alternative", [])
    if not isinstance(tables, list) or tables != tables_of(tree, "alternative"):
        return  # the check of the whole config refuses it
    active = next((table for table in tables_of(tree, "node") if table.get("name") == role), None) or tree.get(role, {})
    if isinstance(active, dict) and (name := instance_of({"plugin": DEFAULT_PLUGINS.get(role), **active})) in wanted:
        raise ConfigError(f"--shadow {brief(text)}: {name} is the active {role}; name others, or another preset of it")
    for name in wanted:
        own = (n for n, table in enumerate(tables) if table.get("role") == role and instance_of(table) == name)
        number = next(own, None)
        if number is None:
            number = len(tables)
            is_method = name in [table.get("name") for table in tables_of(tree, "method")]
            if is_method and name not in Discovery().names(role):
                raise ConfigError(f"--shadow {brief(text)}: {name} is a [[method]]: {ALTERNATIVE_INSTEAD}")
            plugin, preset = named_plugin(name)
            tables.append({"role": role, "plugin": plugin, **({} if preset is None else {"preset": preset})})
        tables[number]["shadow"] = True
        for leaf, _ in leaves(tables[number], f"alternative.{number}"):
            sources.setdefault(leaf, "--shadow")
        sources[f"alternative.{number}.shadow"] = "--shadow"


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

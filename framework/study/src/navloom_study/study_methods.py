"""The methods of a study: variations of one config."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

from navloom.config import ConfigError, Loaded, load_config
from navloom.config.config_methods import ALONE, settings_of
from navloom.config.config_tree import leaves
from navloom.config.loader import members_of
from navloom.config.tables import ROLE_TABLES, AlternativeTable
from navloom.engine.system import System
from navloom.plugins import Discovery
from navloom.plugins.registry import NODE, nearest
from navloom.roles.presets import named_plugin
from navloom.runs.fleet import load_fleet

AS_CONFIGURED = "as_configured"
METHOD = "method"
"""Place in `--vary` that stands for the tables `[[method]]`."""

__all__ = ["Method", "Variation", "compared", "methods_of", "toml_value", "variation_of"]

OF_THE_EPISODE = ("world.", "run.seed", "navigation.start", "navigation.goal", "navigation.via", "alternative")
"""Config places that each episode sets equally for all methods, or that no method uses; they are not compared."""


@dataclass(frozen=True, eq=False)
class Method:
    """One compared method.

    Attributes:
        name: Short name, unique in the study.
        changes: The `--set` changes that produce it from the config file, after its `[[method]]`.
        loaded: The resulting config.
        table: Name of the config's `[[method]]` that it applies; empty for none.
        members: Of a fleet, the config of each member; `loaded` is the first one's.
    """

    name: str
    changes: tuple[str, ...]
    loaded: Loaded
    table: str = ""
    members: tuple[Loaded, ...] = ()

    def request(self) -> dict[str, Any]:
        """The entry of `study.json`."""
        return {
            "config_sha256": self.sha256(),
            "changes": list(self.changes),
            **({"method": self.table, "set": self._settings()} if self.table else {}),
        }

    def sha256(self) -> str:
        """Hash of all values; of a fleet over those of all members."""
        if not self.members:
            return self.loaded.sha256()
        return hashlib.sha256("\n".join(one.sha256() for one in self.members).encode()).hexdigest()

    def _settings(self) -> dict[str, Any]:
        """The overrides of its `[[method]]`, by place."""
        given = next(table.set for table in self.loaded.config.method if table.name == self.table)
        return dict(sorted(settings_of(given)))


@dataclass(frozen=True)
class Variation:
    """One `--vary`: a place in the config, a role or node, or `method`, and its values as text."""

    place: str
    values: tuple[str, ...]


def variation_of(text: str) -> Variation:
    """Read `PATH=a,b,c`; commas within brackets, braces and quotes do not separate.

    Raises:
        ConfigError: The path or the value is missing, or a value is empty or repeated.
    """
    place, equals, values = text.partition("=")
    place = place.strip()
    found = [value.strip() for value in _split(values)]
    if not equals or not place or not all(found):
        raise ConfigError(
            f"--vary {text}: expected PATH=VALUE,VALUE, as in --vary avoider=vff,vfh or --vary controller.k3=0.3,0.6"
        )
    for value in found:
        if found.count(value) > 1:
            raise ConfigError(f"--vary {text}: {value} is there twice, expected different values")
    return Variation(place, tuple(found))


def _split(text: str) -> list[str]:
    """The parts between commas that are not inside brackets, braces or quotes."""
    parts, depth, quote = [""], 0, ""
    for letter in text:
        if quote:
            quote = "" if letter == quote else quote
        elif letter in "\"'":
            quote = letter
        depth += (letter in "[{") - (letter in "]}") if not quote else 0
        if letter == "," and not depth and not quote:
            parts.append("")
        else:
            parts[-1] += letter
    return parts


def methods_of(reference: str, vary: Sequence[str], changes: Sequence[str], discovery: Discovery) -> list[Method]:
    """Every combination of the variations' values, in the given order; the last variation changes fastest.

    The values of a role are plugins, with a preset as in `vfh@printed` or without, or names of `[[alternative]]` tables
    of that role, which replace the role's table.
    The same holds for a `[[node]]`, under its name. The values of `method` are names of `[[method]]` tables.
    Alternatives that no event names are left out: in a study nothing runs beside the method.

    Args:
        reference: Path of a config, or a shipped name.
        vary: Values of `--vary`.
        changes: Values of `--set`, for all methods.
        discovery: Plugins.

    Raises:
        ConfigError: A place or value is not valid; the text suggests the nearest valid one.
    """
    members = members_of(reference) or [""]
    variations = [variation_of(text) for text in vary]
    _check_places(variations, members)
    methods = []
    for values in product(*(variation.values for variation in variations)):
        chosen = {v.place: value for v, value in zip(variations, values, strict=True)}
        found, exchanged = {}, set[str]()
        for member in members:
            found[member], roles = _changes(reference, _of_member(chosen, member), changes, discovery, member)
            exchanged |= roles
        # What is active in one member is not in another: then each has its own changes.
        shared = [change for change in found[members[0]] if all(change in own for own in found.values())]
        own = [f"member.{member}.{change}" for member in found for change in found[member] if change not in shared]
        name = "+".join(value if place in exchanged else _label(place, value) for place, value in chosen.items())
        methods.append(_method(reference, name, (*shared, *own), chosen.get(METHOD, ""), members))
    names = [method.name for method in methods]
    for name in names:
        if names.count(name) > 1:
            raise ConfigError(f"--vary: two methods would be named {name!r}; choose values that differ in name")
    return methods


def _changes(
    reference: str, chosen: Mapping[str, str], changes: Sequence[str], discovery: Discovery, member: str
) -> tuple[list[str], set[str]]:
    """The changes that give a robot the chosen values, and the places whose values are plugins or methods.

    Args:
        reference: The config.
        chosen: Value of each varied place.
        changes: Changes for all methods.
        discovery: Plugins.
        member: Name of the member; empty for a robot alone.
    """
    base = load_config(reference, changes, member=member)
    spare, common = _alternatives(base, changes)
    table = chosen.get(METHOD, "")
    own = _with_method(reference, base, table, changes) if table else base
    exchanged = {METHOD, *ROLE_TABLES, *(node.name for node in own.config.node)}
    roles = [
        change
        for place, value in chosen.items()
        if place in exchanged and place != METHOD
        for change in _exchange(own, base, place, value, discovery)
    ]
    active = {role: own.config.role_table(role).instance for role in own.config.roles}
    taken = (active | dict(chosen)).items()
    # An alternative that is the method itself cannot run beside itself.
    kept = [spare_table for spare_table in spare if (spare_table.role, spare_table.instance) not in taken]
    shelf = [f"alternative={toml_value([_dump(entry) for entry in kept])}"] if base.config.alternative else []
    settings = [f"{place}={value}" for place, value in chosen.items() if place not in exchanged]
    return [*shelf, *roles, *common, *settings], exchanged


def _of_member(chosen: Mapping[str, str], member: str) -> dict[str, str]:
    """What is chosen for a member: `member.NAME.PLACE` for that one alone, and before what is for all."""
    prefix = f"member.{member}."
    shared = {place: value for place, value in chosen.items() if not place.startswith("member.")}
    own = {place.removeprefix(prefix): value for place, value in chosen.items() if place.startswith(prefix)}
    return shared | own


def _method(reference: str, name: str, changes: tuple[str, ...], table: str, members: Sequence[str]) -> Method:
    """A method, whose config is that of each member.

    Raises:
        ConfigError: It does not fit; the text names the method.
    """
    try:
        if members == [""]:
            return Method(name or AS_CONFIGURED, changes, load_config(reference, changes, method=table), table)
        fleet = load_fleet(reference, changes, method=table)
    except ConfigError as error:
        raise ConfigError(f"method {name}: {error}" if name else str(error)) from None
    return Method(name or AS_CONFIGURED, changes, fleet[0], table, tuple(fleet))


def _with_method(reference: str, base: Loaded, name: str, changes: Sequence[str]) -> Loaded:
    """The config with a `[[method]]`, alone.

    Raises:
        ConfigError: There is no such method, or its values do not fit.
    """
    others = [table.role for table in base.config.alternative if table.instance == name]
    if others and name not in [table.name for table in base.config.method]:
        raise ConfigError(f"--vary method={name}: {name} is an [[alternative]]: --vary {others[0]}={name}")
    return load_config(reference, (*changes, *ALONE), method=name, member=base.member)


def _check_places(variations: Sequence[Variation], members: Sequence[str]) -> None:
    places = [variation.place for variation in variations]
    for place in places:
        _, _, own = place.removeprefix("member.").partition(".")
        if place.startswith("member.") and (name := place.split(".")[1]) not in members:
            raise ConfigError(f"--vary {place}: no member {name}{nearest(name, [one for one in members if one])}")
        if place.startswith("member.") and own in ("", METHOD):
            raise ConfigError(f"--vary {place}: expected member.NAME.PLACE, as in member.{name}.avoider=a,b")
        if places.count(place) > 1:
            raise ConfigError(f"--vary {place}: is given twice; name all its values once, as in --vary {place}=a,b")
        if place in ("run.seed", "world.ref", "run", "world"):
            option = "--seeds 0:10" if place.startswith("run") else "--worlds REF REF"
            raise ConfigError(f"--vary {place}: is no method; give {option} instead")
        if place.partition(".")[0] == "alternative":
            raise ConfigError(f"--vary {place}: alternatives run beside a method; vary the role, as in avoider=NAME")


def _alternatives(base: Loaded, changes: Sequence[str]) -> tuple[list[AlternativeTable], list[str]]:
    """Alternatives that events need, and the changes that these tables do not contain yet."""
    named = {(event.role, event.name) for event in base.config.event if event.name}
    spare = [table for table in base.config.alternative if (table.role, table.instance) in named]
    if not base.config.alternative:
        return spare, list(changes)
    return spare, [change for change in changes if change.partition("=")[0].partition(".")[0].strip() != "alternative"]


def _exchange(own: Loaded, base: Loaded, role: str, value: str, discovery: Discovery) -> list[str]:
    """The changes that make a plugin or alternative the active one of a role or node; none if it is already.

    Args:
        own: The config, with the method that applies.
        base: The config without a method, for its alternatives.
        role, value: Role or node, and its plugin or alternative.
        discovery: Plugins.
    """
    active = [own.config.role_table(role).instance] if role in own.config.roles else []
    if value in active:
        return []
    is_node = role not in ROLE_TABLES
    spare = {table.instance: table for table in base.config.alternative if table.role == role}
    if value in spare:
        left_out = ("role", "shadow", "name") if is_node else ("role", "shadow")
        table = {key: entry for key, entry in _dump(spare[value]).items() if key not in left_out}
        if not is_node:
            return [f"{role}={toml_value(table)}"]
        return [f"node.{role}.{key}={toml_value(entry)}" for key, entry in table.items()]
    kind = NODE if is_node else role
    if named_plugin(value)[0] not in discovery.names(kind):
        if value in [table.name for table in base.config.method]:
            raise ConfigError(f"--vary {role}={value}: {value} is a [[method]]: --vary method={value}")
        raise ConfigError(
            f"--vary {role}={value}: neither a plugin nor an [[alternative]] of that name is installed"
            f"{discovery.instead_of(kind, value, [*spare, *active])}"
        )
    return [f"node.{role}.plugin={toml_value(value)}" if is_node else f"{role}.plugin={toml_value(value)}"]


def _dump(table: AlternativeTable) -> dict[str, Any]:
    return table.model_dump(mode="json", exclude_unset=True)


def _label(place: str, value: str) -> str:
    """Part of a method's name: the value for a plugin, `key=value` for a setting, `NAME.place=value` for a member."""
    if place.startswith("member."):
        return f"{place.removeprefix('member.')}={value}"
    return value if place.endswith(".plugin") else f"{place.rpartition('.')[2]}={value}"


def toml_value(value: Any) -> str:
    """A value as TOML on one line.

    Args:
        value: Text, number, boolean, or lists and tables of these.
    """
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{json.dumps(key)} = {toml_value(entry)}" for key, entry in value.items()) + " }"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(toml_value, value)) + "]"
    if isinstance(value, (bool, str)):
        return json.dumps(value)
    return repr(value)


def compared(systems: Mapping[str, Sequence[System]]) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
    """Values that are equal for all methods and values that differ, from their full configs with every default.

    Args:
        systems: System of each method, by name; of a fleet that of each member.

    Returns:
        Equal values by dotted place; and the differing values by place and method. A method that lacks a place, as a
        parameter of another plugin, has no entry there.
    """
    full = {name: _of_fleet([_full(system) for system in found], found) for name, found in systems.items()}
    places = sorted({place for values in full.values() for place in values})
    equal, different = {}, {}
    for place in places:
        found = {name: values[place] for name, values in full.items() if place in values}
        entries = list(found.values())
        if len(found) == len(full) and all(entry == entries[0] for entry in entries):
            equal[place] = entries[0]
        else:
            different[place] = found
    return equal, different


def _of_fleet(members: Sequence[dict[str, Any]], systems: Sequence[System]) -> dict[str, Any]:
    """The values of a fleet: what all members have alike as of one robot, and the rest as `member.NAME.PLACE`."""
    if len(members) == 1:
        return members[0]
    shared = {k: v for k, v in members[0].items() if all(k in own and own[k] == v for own in members[1:])}
    return shared | {
        f"member.{system.loaded.member}.{place}": value
        for system, own in zip(systems, members, strict=True)
        for place, value in own.items()
        if place not in shared and place != "robot.name"
    }


def _full(system: System) -> dict[str, Any]:
    """Every value in effect by dotted place, including the active plugins' parameters with their defaults."""
    tree = system.config.model_dump(mode="json")
    tree["node"] = {table["name"]: table for table in tree["node"]}
    for _, role, table in system.config.role_tables():
        part = system.parts[(role, table.instance)]
        if table is system.config.role_table(role):
            is_role = role in ROLE_TABLES
            given, name = (tree, table.instance) if is_role else (tree["node"], role)
            given[role] = {**given[role], **part.params.model_dump(mode="json"), "name": name}
    # Where processes run makes no method.
    del tree["live"]
    return dict(_of_methods(leaves(tree)))


def _of_methods(found: Iterable[tuple[str, Any]]) -> Iterable[tuple[str, Any]]:
    return ((place, value) for place, value in found if not place.startswith(OF_THE_EPISODE))

"""Edits the tree of a config before its check: sets values by their places, with the source of each."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from typing import Any

from navloom.config.config_errors import ConfigError
from navloom.config.config_presets import split_preset
from navloom.config.tables import ROLE_TABLES
from navloom.inputs.assignments import brief
from navloom.inputs.texts import shortened
from navloom.plugins.registry import nearest
from navloom.roles.base import RESERVED_KEYS
from navloom.roles.presets import named_plugin

__all__ = ["Source", "assign", "leaves", "split_presets", "tables_of"]

ARRAYS = ("sensor", "node", "alternative", "event", "method", "member")
"""Places of arrays of tables."""

Source = str
"""Where a value came from: default, file, method NAME, --set, --shadow or kept pose."""


def tables_of(tree: dict[str, Any], name: str) -> list[dict[str, Any]]:
    """The tables of an array; empty if it is none."""
    tables = tree.get(name)
    return tables if isinstance(tables, list) and all(isinstance(table, dict) for table in tables) else []


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


def assign(
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


def split_presets(tree: dict[str, Any]) -> None:
    """Give the preset in `plugin = "vfh@printed"` a key of its own; a table that names two is left for the check."""
    places = [tree.get(role) for role in ROLE_TABLES] + tables_of(tree, "node") + tables_of(tree, "alternative")
    for table in places:
        if isinstance(table, dict):
            with suppress(ValueError):
                table.update(split_preset(table))


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

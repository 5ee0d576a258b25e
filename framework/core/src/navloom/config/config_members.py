"""Members of a fleet, `[[member]]`: robots in one world, each with its own config, start and overrides."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterator, Mapping
from typing import Any

from pydantic import Field

from navloom.config.config_errors import ConfigError
from navloom.config.config_methods import settings_of
from navloom.config.table_parts import Start, Table
from navloom.config.tables import LONGEST_NAME
from navloom.plugins.registry import nearest

__all__ = ["MOST", "MemberTable", "change_of_member", "each_member", "named_member", "seed_of_member",
           "settings_of_member"]  # fmt: skip

MOST = 1000
"""Most robots of one table."""


class MemberTable(Table):
    """A robot of a fleet. Its config, then the other tables of this file, then `set` and `start`: the later wins."""

    name: str = Field(max_length=LONGEST_NAME, pattern=r"^[A-Za-z0-9_-]+$", description="its robot.name")
    config: str | None = Field(default=None, description="its config, a path or a shipped name; default: this file")
    count: int | None = Field(
        default=None,
        ge=1,
        le=MOST,
        description="that many equal robots, NAME1, NAME2, …, each with a task of the world",
    )
    start: Start | None = Field(default=None, description="its navigation.start")
    set: dict[str, Any] = Field(default_factory=dict, description="tables and keys as in the config itself")


def each_member(tables: Collection[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """A table for each robot: that with a `count` is there as often, with numbered names. Values may be unchecked."""
    found: list[Mapping[str, Any]] = []
    for table in tables:
        count = table.get("count")
        if isinstance(count, int) and 1 <= count <= MOST:
            found += [{**table, "name": f"{table.get('name')}{number}"} for number in range(1, count + 1)]
        else:
            found.append(table)
    return found


def named_member(tables: Collection[Mapping[str, Any]], name: str, config: str) -> tuple[int, Mapping[str, Any]]:
    """The number of a member, from 0, and its table.

    Args:
        tables: The tables `[[member]]`.
        name: Name of the member.
        config: Name of the config, for messages.

    Raises:
        ConfigError: There is no such member.
    """
    members = each_member(tables)
    for number, table in enumerate(members):
        if table.get("name") == name:
            return number, table
    raise ConfigError(
        f"member {name}: {config} has no [[member]] of that name{nearest(name, [str(t.get('name')) for t in members])}"
    )


def change_of_member(change: str, name: str, tables: Collection[Mapping[str, Any]]) -> str | None:
    """What a `--set` means for a member: `member.NAME.a.b=value` is `a.b=value` for that one, and None for the others.

    Raises:
        ConfigError: It names no member, or nothing of one.
    """
    place, equals, value = change.partition("=")
    if place.partition(".")[0].strip() != "member":
        return change
    _, whose, rest = ([*place.split(".", 2), "", ""])[:3]
    if not (whose and rest):
        raise ConfigError(f"--set {change}: expected member.NAME.PLACE=VALUE; without member.NAME it holds for all")
    named_member(tables, whose, "--set")
    return f"{rest}{equals}{value}" if whose == name else None


def settings_of_member(table: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Place and value of each override of a member."""
    yield from settings_of(given) if isinstance(given := table.get("set", {}), Mapping) else ()
    if "start" in table:
        yield "navigation.start", table["start"]
    yield "robot.name", table["name"]


def seed_of_member(seed: int, name: str) -> int:
    """Seed of a member's random streams: equal robots differ, and a further one changes no other."""
    return int.from_bytes(hashlib.sha256(f"{seed}\0{name}".encode()).digest()[:4], "little")

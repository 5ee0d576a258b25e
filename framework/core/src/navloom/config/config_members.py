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

__all__ = ["MemberTable", "named_member", "seed_of_member", "settings_of_member"]


class MemberTable(Table):
    """A robot of a fleet. Its config, then the other tables of this file, then `set` and `start`: the later wins."""

    name: str = Field(max_length=LONGEST_NAME, pattern=r"^[A-Za-z0-9_-]+$", description="its robot.name")
    config: str | None = Field(default=None, description="its config, a path or a shipped name; default: this file")
    start: Start | None = Field(default=None, description="its navigation.start")
    set: dict[str, Any] = Field(default_factory=dict, description="tables and keys as in the config itself")


def named_member(tables: Collection[Mapping[str, Any]], name: str, config: str) -> Mapping[str, Any]:
    """The table of a member.

    Args:
        tables: The tables `[[member]]`.
        name: Name of the member.
        config: Name of the config, for messages.

    Raises:
        ConfigError: There is no such member.
    """
    for table in tables:
        if table.get("name") == name:
            return table
    raise ConfigError(
        f"member {name}: {config} has no [[member]] of that name{nearest(name, [str(t.get('name')) for t in tables])}"
    )


def settings_of_member(table: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Place and value of each override of a member."""
    yield from settings_of(given) if isinstance(given := table.get("set", {}), Mapping) else ()
    if "start" in table:
        yield "navigation.start", table["start"]
    yield "robot.name", table["name"]


def seed_of_member(seed: int, name: str) -> int:
    """Seed of a member's random streams: equal robots differ, and a further one changes no other."""
    return int.from_bytes(hashlib.sha256(f"{seed}\0{name}".encode()).digest()[:4], "little")

"""Methods of a config, `[[method]]`: named sets of overrides, so that a study has a row for each."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from typing import Any

from pydantic import Field, model_validator

from navloom.config.config_errors import ConfigError
from navloom.config.table_parts import Table
from navloom.config.tables import LONGEST_NAME, NavigationTable
from navloom.plugins.registry import nearest
from navloom.roles import FIXED, ROLES

__all__ = ["ALONE", "ALTERNATIVE_INSTEAD", "MethodTable", "named_method", "problems_of_method", "settings_of"]

SET_ROLES = tuple(role for role in ROLES if role not in FIXED)
"""Roles that a method may set."""
SET_NAVIGATION = (
    "speed", "lateral_acceleration", "path_shape", "look_ahead", "corridor_margin", "handover", "handover_own_way",
    "handover_release", "replan_when_blocked", "replan_period", "replan_gain",
)  # fmt: skip
"""Keys of `[navigation]` that a method may set; the others are the task and its limits."""
ALONE = ("alternative=[]", "event=[]")
"""Changes that leave a method alone: an alternative may have the name of a plugin of the method."""
ALTERNATIVE_INSTEAD = "a method is neither shadowed nor swapped; [[alternative]] is for that"


class MethodTable(Table):
    """A method of a study: overrides that apply together, over the file and under `--set`."""

    name: str = Field(max_length=LONGEST_NAME, pattern=r"^[A-Za-z0-9_-]+$", description="as in `--vary method=NAME`")
    set: dict[str, Any] = Field(default_factory=dict, description="tables and keys as in the config itself")

    @model_validator(mode="before")
    @classmethod
    def _is_no_alternative(cls, given: Any) -> Any:
        wrong = [key for key in ("role", "plugin", "shadow") if isinstance(given, dict) and key in given]
        if wrong:
            raise ValueError(f"has {' and '.join(wrong)}, expected name and set: {ALTERNATIVE_INSTEAD}")
        return given


def settings_of(given: Mapping[str, Any], place: str = "") -> Iterator[tuple[str, Any]]:
    """Place and value of each override of a method; tables merge with those of the file, lists replace them."""
    for key, value in given.items():
        inner = f"{place}.{key}" if place else key
        # An empty table overrides nothing, except a value such as `inputs`.
        if isinstance(value, Mapping) and (value or "." not in inner):
            yield from settings_of(value, inner)
        else:
            yield inner, value


def named_method(tables: Collection[Mapping[str, Any]], name: str, config: str) -> Mapping[str, Any]:
    """Overrides of a method.

    Args:
        tables: The tables `[[method]]`, not checked yet.
        name: Name of the method.
        config: Name of the config, for messages.

    Raises:
        ConfigError: There is no such method.
    """
    for table in tables:
        if table.get("name") == name:
            given = table.get("set", {})
            return given if isinstance(given, Mapping) else {}  # the check of the whole config refuses it
    known = [str(table.get("name")) for table in tables]
    hint = nearest(name, known) if known else '; it has none: write [[method]] with name = "…" and set = { … }'
    raise ConfigError(f"method {name}: {config} has no [[method]] of that name{hint}")


def problems_of_method(place: str, given: Mapping[str, Any], tables: Collection[str]) -> Iterator[str]:
    """Problems of the overrides of a method, each beginning with its place.

    Args:
        place: Place of the overrides.
        given: The overrides.
        tables: Names of the config's tables.
    """
    compared = []
    for own, value in settings_of(given):
        head, key, *further = [*own.split("."), ""]
        if head == "navigation":
            if key in NavigationTable.model_fields or not key:
                compared += [] if key in SET_NAVIGATION else [f"{head}.{key}" if key else head]
            else:
                yield f"{place}.{head}.{key}: unknown key{nearest(key, [*SET_NAVIGATION])}"
        elif head in SET_ROLES:
            compared += [own] if key == "latency" else []
        elif head == "node":
            entries = value if isinstance(value, list) and not key else []
            delays = any(isinstance(entry, Mapping) and "latency" in entry for entry in entries)
            compared += ["node.latency"] if delays else [own] if further[:1] == ["latency"] else []
        elif head == "alternative":
            yield f"{place}.{head}: {ALTERNATIVE_INSTEAD}"
        elif head in (*tables, *ROLES):
            compared.append(head)
        else:
            yield f"{place}.{head}: unknown table{nearest(head, [*SET_ROLES, 'node', 'navigation'])}"
    if compared:
        yield (
            f"{place}: sets {', '.join(dict.fromkeys(compared))}, which the comparison keeps equal for all methods; a "
            f"method sets {', '.join(SET_ROLES)} and node, all without latency, and of navigation "
            f"{', '.join(SET_NAVIGATION)}"
        )

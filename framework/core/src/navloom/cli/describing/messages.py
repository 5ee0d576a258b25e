"""`navloom messages`: messages of the framework and of every distribution, and the fields of one."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any

import typer

from navloom.cli.describing.docstrings import meanings
from navloom.cli.options import PluginFiles
from navloom.cli.output import LOG

if TYPE_CHECKING:
    from navloom.messages import Message

__all__ = ["messages"]

_UNIT = r"(?:^|, )(ns|µs|ms|s|m|m²|m/s|m/s²|rad|rad²|rad/s|rad/s²|deg|Hz|1/s|1/m|kg|N|V|A|W|%)(?=[,;. ]|$)"
"""A unit in the text of a field: at its start, or after a comma."""

_IN_NAME = {"ns": "ns", "hz": "Hz", "deg": "deg"}
"""Units by the last word of a field's name."""


def messages(
    name: Annotated[str | None, typer.Argument(metavar="NAME", help="Show the fields of this one.")] = None,
    plugin: PluginFiles = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """List every message, or show the fields of one.

    The list has versions and distributions. If several messages have the name, all are shown.
    """
    from navloom.cli.output import print_json, print_table
    from navloom.plugins import PluginError
    from navloom.plugins.registry import nearest

    known = list(_known())
    if name is None:
        rows = [_head(cls, owner) for cls, owner in known]
        if as_json:
            print_json(rows)
        else:
            columns = ("message", "version", "distribution", "what")
            print_table(columns, [(row["schema"], row["version"], row["distribution"], row["what"]) for row in rows])
        return
    found = [(cls, owner) for cls, owner in known if name in (cls.schema_name, cls.__name__)]
    if not found:
        names = [each for cls, _ in known for each in (cls.__name__, cls.schema_name)]
        raise PluginError(f"message {name!r} is not known here{nearest(name, names)}")
    if as_json:
        print_json([{**_head(cls, owner), "fields": list(_fields(cls))} for cls, owner in found])
        return
    for cls, owner in found:
        head = _head(cls, owner)
        typer.echo(f"{head['schema']}/{head['version']} of {head['distribution']}: {head['what']}")
        columns = ("field", "type", "unit", "meaning")
        print_table(columns, [tuple(row[column] for column in ("name", *columns[1:])) for row in _fields(cls)])


def _known() -> Iterator[tuple[type[Message], str]]:
    """Every message and its distribution, the framework's first. Broken distributions are logged."""
    from navloom.installed import framework_version
    from navloom.messages import SCHEMAS
    from navloom.plugins import Discovery, PluginError

    ours = [cls for schema, cls in SCHEMAS.items() if schema.startswith("navloom.")]
    for cls in sorted(ours, key=lambda cls: cls.__name__):
        yield cls, f"navloom {framework_version()}"
    discovery = Discovery()
    for schema in dict.fromkeys(discovery.names("message")):
        try:
            yield discovery.message(schema), discovery.owner_of(schema.partition(".")[0])
        except PluginError as error:
            LOG.warning(str(error))


def _head(cls: type[Message], owner: str) -> dict[str, Any]:
    lines = (inspect.getdoc(cls) or "").splitlines()
    return {
        "schema": cls.schema_name,
        "version": cls.schema_version,
        "distribution": owner,
        "what": lines[0] if lines else "",
    }


def _fields(cls: type[Message]) -> Iterator[dict[str, str]]:
    from navloom.messages.kinds import typed

    told = meanings(inspect.getdoc(cls) or "")
    for name, kind in cls.kinds.items():
        meaning = told.get(name, "")
        unit = re.search(_UNIT, meaning)
        in_name = _IN_NAME.get(name.rpartition("_")[2], "") if "_" in name else ""
        yield {"name": name, "type": typed(kind), "unit": unit[1] if unit else in_name, "meaning": meaning}

"""`navloom plugins`: what is installed, and the parameters of one."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated, Any

import typer

from navloom.cli.options import PluginFiles
from navloom.cli.output import LOG

__all__ = ["plugins"]


def plugins(
    context: typer.Context,
    name: Annotated[str | None, typer.Argument(metavar="ROLE.NAME", help="Show this one's parameters.")] = None,
    plugin: PluginFiles = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """List the installed plugins without importing them, or show the parameters of one."""
    from navloom.cli.output import print_json, print_table
    from navloom.plugins.discovery import Discovery
    from navloom.plugins.registry import NODE

    discovery = Discovery()
    if name is None:
        infos = discovery.infos()
        root: Any = context.find_root().command
        for problem in (*discovery.problems(), *discovery.taken("command", root.commands)):
            LOG.warning(problem)
        if as_json:
            print_json([asdict(info) for info in infos])
        else:
            print_table(
                ("role", "name", "distribution", "version"),
                [(i.role, i.name, i.distribution, i.version) for i in infos],
            )
        return
    from navloom.engine.parts import streams_of  # which imports numba: the list does without

    role, _, own = name.partition(".")
    cls = discovery.node(own) if role == NODE else discovery.role(role, own)
    schema = cls.Params.model_json_schema()
    kinds = kinds_of(cls)
    if as_json:
        print_json({"role": role, "name": own, "api": cls.api, "params": schema, **streams_of(cls), **kinds})
        return
    summary = (cls.__doc__ or "").strip().splitlines()
    typer.echo(f"{role}.{own}: {summary[0] if summary else ''}")
    for what, streams in streams_of(cls).items():
        typer.echo(f"{what} {', '.join(f'{name} ({carries})' for name, carries in streams.items()) or 'nothing'}")
    print_table(("parameter", "default", "allowed", "meaning"), rows_of(schema))
    for kind, one in kinds.get("sensor_kinds", {}).items():
        typer.echo(f"sensor of kind {kind} gives {one['message']}")
        if one["settings"] is not None:
            print_table(("setting", "default", "allowed", "meaning"), rows_of(one["settings"]))


def kinds_of(cls: Any) -> dict[str, Any]:
    """The kinds of sensor that a platform provides: the message class of each, and what its table may hold."""
    from navloom.roles import Platform

    if not issubclass(cls, Platform):
        return {}
    settings = {kind: model.model_json_schema() for kind, model in cls.sensor_settings.items()}
    return {
        "sensor_kinds": {
            kind: {"message": carries.__name__, "settings": settings.get(kind)}
            for kind, carries in cls.sensor_kinds.items()
        }
    }


def rows_of(schema: dict[str, Any]) -> list[tuple[str, str, str, str]]:
    return [_row(key, field, schema) for key, field in schema.get("properties", {}).items()]


def _row(key: str, field: dict[str, Any], schema: dict[str, Any]) -> tuple[str, str, str, str]:
    if "$ref" in field:
        field = {**schema["$defs"][field["$ref"].rsplit("/", 1)[-1]], **field}
    options = [option for option in field.get("anyOf", [field]) if option.get("type") != "null"]
    allowed = " or ".join(filter(None, map(_allowed, options)))
    default = "(required)" if key in schema.get("required", ()) else str(field.get("default"))
    return key, default, allowed, field.get("description", "")


def _allowed(field: dict[str, Any]) -> str:
    if "enum" in field:
        return ", ".join(map(str, field["enum"]))
    if "const" in field:
        return str(field["const"])
    signs = (("minimum", ">="), ("exclusiveMinimum", ">"), ("maximum", "<="), ("exclusiveMaximum", "<"))
    bounds = [f"{sign} {field[key]:g}" for key, sign in signs if key in field]
    return ", ".join(bounds) or str(field.get("type", ""))

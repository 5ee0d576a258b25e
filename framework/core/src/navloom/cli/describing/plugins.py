"""`navloom plugins`: what is installed, the parameters of one, and a new one."""

from __future__ import annotations

import inspect
from collections.abc import Sequence
from dataclasses import asdict, fields
from pathlib import Path
from types import NoneType
from typing import TYPE_CHECKING, Annotated, Any

import typer

from navloom.cli.describing.docstrings import meanings
from navloom.cli.options import PluginFiles
from navloom.cli.output import LOG

if TYPE_CHECKING:
    from navloom.plugins.discovery import Discovery

__all__ = ["plugins"]


def plugins(
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="ROLE|ROLE.NAME", help="Show what a role is given, or a plugin's parameters; or the word `new`."
        ),
    ] = None,
    kind_and_name: Annotated[
        list[str] | None, typer.Argument(metavar="KIND_NAME", help="After `new`: the kind and name of the new plugin.")
    ] = None,
    plugin: PluginFiles = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="With `new`: parent folder of the new one; default: this one.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """List plugins, show one or its role, or generate a new one.

    The list imports no plugin. `navloom plugins avoider` shows what an avoider is given and answers.

    `navloom plugins new KIND NAME` writes a distribution with one plugin that works: its package, tests, README and
    CI. KIND is a role, node, metric, panel, world, scheme or message.
    """
    from navloom.plugins.discovery import Discovery

    discovery = Discovery()
    if name == "new":
        _new(kind_and_name or (), out or Path(), discovery, as_json)
        return
    if kind_and_name or out is not None:
        given = f"--out {out}" if out is not None else " ".join(kind_and_name or ())
        raise typer.BadParameter(f"{given}: this is for `navloom plugins new KIND NAME`")
    if name is None:
        _list(discovery, as_json)
    elif "." not in name:
        _show_role(name, discovery, as_json)
    else:
        _show(name, discovery, as_json)


def _list(discovery: Discovery, as_json: bool) -> None:
    """Everything that is installed, without the framework's own commands: the help lists these."""
    from navloom.cli.output import print_json, print_table
    from navloom.parts import OF_FRAMEWORK

    infos = [
        info
        for info in discovery.infos()
        if info.distribution not in OF_FRAMEWORK or info.role not in ("command", "observer")
    ]
    for problem in discovery.problems():
        LOG.warning(problem)
    if as_json:
        print_json([asdict(info) for info in infos])
    else:
        print_table(
            ("role", "name", "distribution", "version"),
            [(i.role, i.name, i.distribution, i.version) for i in infos],
        )


def _show_role(role: str, discovery: Discovery, as_json: bool) -> None:
    """What the plugins of a role are given and answer."""
    from navloom.cli.describing.plugins import _described, _print_role
    from navloom.cli.output import print_json
    from navloom.plugins.registry import PluginError, nearest
    from navloom.roles import ROLES

    if role not in ROLES:
        raise PluginError(f"{role}: expected a role or ROLE.NAME{discovery.meant(role) or nearest(role, list(ROLES))}")
    told = _described(role)
    if as_json:
        print_json({**told, "plugins": discovery.names(role)})
    else:
        _print_role(told, discovery.names(role))


def _show_suite(file: Path, as_json: bool) -> None:
    """The file of a suite: its config, conditions, worlds, seeds, metric and methods."""
    from navloom.cli.output import print_json
    from navloom.inputs.bounds import TEXT_MB, read_file
    from navloom.inputs.texts import toml_of
    from navloom.plugins.registry import PluginError

    text = read_file(file, TEXT_MB, PluginError).decode()
    if as_json:
        print_json(toml_of(text, str(file), PluginError))
    else:
        typer.echo(f"# {file}\n{text}", nl=False)


def _show(name: str, discovery: Discovery, as_json: bool) -> None:
    """The parameters of one plugin, or the file of a suite."""
    from navloom.cli.output import print_json, print_table
    from navloom.engine.plugin_instances import streams_of  # which imports numba: the list does without
    from navloom.entry_kinds import OTHERS
    from navloom.plugins.registry import NODE, PluginError

    role, _, own = name.partition(".")
    if role == "suite":
        _show_suite(discovery.suite(own), as_json)
        return
    if role in OTHERS and role != NODE:
        hint = f"messages {own}` lists its fields" if role == "message" else f"check {name}` checks it"
        raise PluginError(f"{name}: a {role} has no parameters; `navloom {hint}")
    cls = discovery.node(own) if role == NODE else discovery.role(role, own)
    schema = cls.Params.model_json_schema()
    kinds = kinds_of(cls)
    if as_json:
        presets = {
            preset: {"about": given.about, "settings": {key: {"value": v, "why": why} for key, (v, why) in
                                                        given.settings.items()}}
            for preset, given in cls.presets.items()
        }  # fmt: skip
        print_json({"role": role, "name": own, "api": cls.api, "params": schema, "presets": presets,
                    **streams_of(cls), **kinds})  # fmt: skip
        return
    summary = (cls.__doc__ or "").strip().splitlines()
    typer.echo(f"{role}.{own}: {summary[0] if summary else ''}")
    for what, streams in streams_of(cls).items():
        typer.echo(f"{what} {', '.join(f'{name} ({carries})' for name, carries in streams.items()) or 'nothing'}")
    _print_params(cls, own, schema)
    for kind, one in kinds.get("sensor_kinds", {}).items():
        typer.echo(f"sensor of kind {kind} gives {one['message']}")
        if one["settings"] is not None:
            print_table(("setting", "default", "allowed", "meaning"), rows_of(one["settings"]))


def _print_params(cls: Any, name: str, schema: dict[str, Any]) -> None:
    """The parameters, with the value of each preset beside the default."""
    from navloom.cli.output import print_table
    from navloom.roles.presets import own_preset

    own = own_preset(cls.presets)
    others = {preset: given.settings for preset, given in cls.presets.items() if preset != own}
    rows = [
        (key, default, *(_shown(settings.get(key)) for settings in others.values()), allowed, meaning)
        for key, default, allowed, meaning in rows_of(schema)
    ]
    print_table(("parameter", own or "default", *others, "allowed", "meaning"), rows)
    for preset, given in cls.presets.items():
        typer.echo(f"preset {preset}{' (the default)' if preset == own else ''}: {given.about}")
    if others:
        typer.echo(f'in a config, plugin = "{name}@{next(iter(others))}"')


def _shown(setting: tuple[Any, str] | None) -> str:
    """The value of a preset; empty where it is the default's."""
    return "" if setting is None else str(setting[0])


def _new(kind_and_name: Sequence[str], where: Path, discovery: Discovery, as_json: bool) -> None:
    """Write a distribution, and print the next commands."""
    from navloom.cli.output import print_json
    from navloom.parts import part

    scaffold = part("navloom_check.scaffold", "`navloom plugins new`")

    if len(kind_and_name) != 2:
        raise typer.BadParameter(
            f"`navloom plugins new` takes KIND and NAME, as in `navloom plugins new avoider mine`; got "
            f"{' '.join(kind_and_name) or 'neither'}; kinds are {', '.join(scaffold.KINDS)}"
        )
    kind, name = kind_and_name
    made = scaffold.new_distribution(kind, name, where, discovery)
    if as_json:
        print_json({**asdict(made), "folder": str(made.folder)})
        return
    typer.echo(f"{made.plugin}: {len(made.files)} files in {made.folder}")
    typer.echo("next:")
    for command in made.commands:
        typer.echo(f"  {command}")


def kinds_of(cls: Any) -> dict[str, Any]:
    """The kinds of sensor that a platform provides, each with its message class and the schema of its settings."""
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


def _described(role: str) -> dict[str, Any]:
    """A role's verb with the type of its answer, and the fields of all that its plugins see."""
    from navloom.messages import Message
    from navloom.roles import ROLES, Context, RobotSpec, answers_of, given_of, verb_of

    cls = ROLES[role]
    verb = getattr(cls, verb_of(role))
    answer = str(inspect.signature(verb).return_annotation)
    seen = {"given": given_of(role)}
    for kind in answers_of(role):
        if not issubclass(kind, (Message, NoneType)):
            seen["answer"] = kind
    seen |= {"self.context": Context, "self.context.robot": RobotSpec}
    return {
        "role": role,
        "about": inspect.getdoc(cls),
        "verb": f"{verb.__name__}(self, given: {given_of(role).__name__}) -> {answer}",
        "verb_about": inspect.getdoc(verb),
        "fields": {what: _fields(one) for what, one in seen.items()},
    }


def _print_role(told: dict[str, Any], names: list[str]) -> None:
    """The same for people, and which plugins of the role are installed."""
    import typer

    from navloom.cli.output import print_table

    typer.echo(f"{told['role']}: {(told['about'] or '').splitlines()[0]}")
    typer.echo(f"{told['verb']}\n    {told['verb_about']}\n")
    for what, rows in told["fields"].items():
        print_table((what, "type", "meaning"), [(row["name"], row["type"], row["meaning"]) for row in rows])
        typer.echo()
    typer.echo("the fields of a message: `navloom messages RangeScan`")
    typer.echo(f"installed: {', '.join(names) or 'none'}; the parameters of one: `navloom plugins {told['role']}.NAME`")


def _fields(cls: Any) -> list[dict[str, str]]:
    told = meanings(inspect.getdoc(cls) or "")
    return [{"name": field.name, "type": str(field.type), "meaning": told.get(field.name, "")} for field in fields(cls)]

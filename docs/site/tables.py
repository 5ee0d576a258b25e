"""Tables of the reference, read off the code."""

from __future__ import annotations

import inspect
import typing
from collections.abc import Iterable, Iterator
from typing import Any

import typer.main
from navloom.cli.describing.plugins import kinds_of, rows_of
from navloom.cli.main import app
from navloom.config.schema import Config
from navloom.engine.catalogue import FRAMEWORK
from navloom.engine.streams import STEP
from navloom.plugins import Discovery
from navloom.roles import ROLES
from navloom.worlds import SCHEMES, WORLDS
from navloom_live.transport.keyspace import ALIVE, FAULT, KeySpace
from navloom_live.transport.quality_of_service import PARAMETERS
from navloom_study import METRICS

PARAMETER_HEAD = ("parameter", "default", "allowed", "meaning")


def table(head: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    """A table of Markdown; what is in a cell cannot end it."""
    lines = [tuple(head)]
    lines += [("---",) * len(lines[0]), *(tuple(str(cell).replace("|", "\\|") for cell in row) for row in rows)]
    return "\n".join(f"| {' | '.join(' '.join(cell.split()) for cell in line)} |" for line in lines)


def code(text: object) -> str:
    """A word of code; nothing for nothing."""
    return f"`{text}`" if str(text) else ""


def first_line(thing: Any) -> str:
    """The first line of a docstring."""
    return (inspect.getdoc(thing) or "").partition("\n")[0]


def shipped(role: str) -> Iterator[tuple[str, str, type[Any]]]:
    """Name, distribution and class of each installed plugin of a role that is navloom's."""
    discovery = Discovery()
    for info in discovery.infos():
        if info.role == role and info.distribution.startswith("navloom"):
            yield info.name, info.distribution, discovery.role(role, info.name)


def plugin_table(role: str) -> str:
    """The shipped plugins of a role."""
    rows = [
        (f"[`{name}`](parameters.md#{role}{name})", distribution, first_line(cls))
        for name, distribution, cls in shipped(role)
    ]
    return table(("name", "distribution", "what it does"), rows)


def parameters(schema: dict[str, Any]) -> str:
    """The fields of a model."""
    rows = [(code(key), code(default), allowed, meaning) for key, default, allowed, meaning in rows_of(schema)]
    return table(PARAMETER_HEAD, rows) if rows else "It has no parameters."


def parameter_sections() -> str:
    """Every shipped plugin with its parameters."""
    parts = ["`navloom plugins ROLE.NAME` prints the same for any installed plugin."]
    for role in ROLES:
        for name, _, cls in shipped(role):
            parts += [f"## {role}.{name}", first_line(cls), parameters(cls.Params.model_json_schema())]
    return "\n\n".join(parts)


def sensor_sections() -> str:
    """The sensors of every shipped platform."""
    parts = [
        "A `[[sensor]]` of a config has a `name`, a `kind`, and the settings of its kind. The platform defines the "
        "kinds; `navloom plugins platform.NAME` prints them."
    ]
    for name, _, cls in shipped("platform"):
        for kind, one in kinds_of(cls).get("sensor_kinds", {}).items():
            message = one["message"]
            parts += [f"## {name}: {kind}", f"Publishes [{message}](../messages.md#{message.lower()})."]
            parts += [parameters(one["settings"])] if one["settings"] is not None else []
    return "\n\n".join(parts)


def stream_table() -> str:
    """Every declared port."""
    rows = [
        (code(port.role), code(port.name), f"[{port.carries.__name__}](../messages.md#{port.carries.__name__.lower()})",
         port.quality.priority, f"{port.quality.congestion}, {port.quality.off_host}",
         "yes" if port.retained else "", "yes" if port.required else "")
        for port in FRAMEWORK.ports()
    ]  # fmt: skip
    head = ("role or node", "port", "message", "priority", "congestion: host, beyond", "retained", "required")
    return table(head, rows)


def key_table() -> str:
    """What is below a robot's prefix."""
    keys = KeySpace("<realm>", "<robot>")
    rows = [
        (code(keys.port("<role>", "<instance>", "<port>")), "a stream, or a service of an instance"),
        (code(keys.port("<role>", "<instance>", PARAMETERS)), "parameters that were changed, retained"),
        (code(keys.port("<role>", "<instance>", STEP)), "step reports: what each step consumed"),
        (code(keys.port("<role>", "<instance>", FAULT)), "step reports with a fault"),
        (code(keys.alive("<role>", "<instance>", "<life>")), f"liveliness token (`{ALIVE}`) of an instance"),
        (code(keys.process("<process>", "<service>")), "a service of a process"),
    ]
    return table(("key", "what it is"), rows)


def world_tables() -> str:
    """The shipped worlds and schemes."""
    worlds = table(("world", "what it is"), [(code(name), first_line(make)) for name, make in WORLDS.items()])
    schemes = [(code(f"{name}:…"), " ".join((inspect.getdoc(load) or "").split("\n\n")[0].split()))
               for name, load in SCHEMES.items()]  # fmt: skip
    return f"## Worlds\n\n{worlds}\n\n## Schemes\n\n{table(('reference', 'what it reads'), schemes)}"


def metric_table() -> str:
    """The built-in metrics."""
    return table(
        ("metric", "unit", "what it is"), [(code(metric.name), metric.unit, metric.about) for metric in METRICS]
    )


def config_sections() -> str:
    """Each table of a config with its keys."""
    parts = [
        "A config is one TOML file. Tables of roles, nodes and sensors hold their plugin's own parameters beside the "
        "keys listed here. `navloom config schema` prints the schema as JSON Schema; `navloom config show CONFIG` "
        "prints each value and where it comes from."
    ]
    listed: set[type[Any]] = set()
    for key, field in Config.model_fields.items():
        model, repeats = model_of(field.annotation)
        if key in ROLES:
            key, repeats = ", ".join(f"[{role}]" for role in ROLES), False
        if model in listed:
            continue
        listed.add(model)
        head = key if key.startswith("[") else f"[[{key}]]" if repeats else f"[{key}]"
        parts += [f"## {head}", first_line(model), parameters(model.model_json_schema())]
        parts += nested(model)
    return "\n\n".join(parts)


def nested(model: type[Any]) -> list[str]:
    """The inline tables of a table."""
    inner = [(key, model_of(field.annotation)[0]) for key, field in model.model_fields.items()]
    return [
        part
        for key, one in inner
        if one is not None
        for part in (f"### {key}", first_line(one), parameters(one.model_json_schema()))
    ]


def model_of(annotation: Any) -> tuple[Any, bool]:
    """The table that a field holds, or None, and whether it holds several."""
    inner = [argument for argument in typing.get_args(annotation) if argument is not type(None)] or [annotation]
    return (inner[0] if hasattr(inner[0], "model_fields") else None), typing.get_origin(annotation) is list


def command_sections() -> str:
    """Every command with its arguments and options."""
    (_, root), *others = commands(typer.main.get_command(app), "navloom")
    parts = [
        root.help or "",
        table(("option", "", "meaning"), words(root)),
        "Exit codes: 0: done; 1: the run ended in another way, or something failed on the way; 2: the request was "
        "wrong, nothing ran, and nothing was written.",
    ]
    for name, command in others:
        parts += [f"## {name}", f"```text\n{name} {usage(command)}\n```", plain(command.help or "")]
        if rows := list(words(command)):
            parts.append(table(("argument or option", "", "meaning"), rows))
    return "\n\n".join(parts)


def commands(command: Any, name: str) -> Iterator[tuple[str, Any]]:
    """Name and command of each below and with `command`, a group before its commands."""
    yield name, command
    inner = command.whole() if hasattr(command, "whole") else getattr(command, "commands", {})
    for word, child in inner.items():
        yield from commands(child, f"{name} {word}")


def usage(command: Any) -> str:
    """The synopsis after the name."""
    parts = ["[OPTIONS]", *(["COMMAND …"] if hasattr(command, "commands") else [])]
    for param in command.params:
        if param.param_type_name == "argument" and not param.hidden:
            name = placeholder(param) + "…" * (param.nargs == -1)
            parts.append(name if param.required else f"[{name}]")
    return " ".join(parts)


def placeholder(param: Any) -> str:
    """What stands for a value."""
    name = str(param.metavar or param.name).rstrip("…")
    return name.strip("[]") if name.startswith("[") else name


def words(command: Any) -> Iterator[tuple[str, str, str]]:
    """Rows of a command's table, arguments first."""
    shown = [param for param in command.params if not param.hidden and param.name != "help"]
    for param in sorted(shown, key=lambda param: param.param_type_name == "option"):
        is_option = param.param_type_name == "option"
        names = ", ".join(code(name) for name in param.opts) if is_option else code(placeholder(param))
        value = "" if not is_option or param.is_flag else code(placeholder(param))
        yield names, value, plain(param.help or "")


def plain(text: str) -> str:
    """Help text as Markdown: placeholders in angle brackets and underscores stay."""
    return text.replace("<", "&lt;").replace("*", "\\*").replace("_", "\\_")

"""The registry that plugins add to."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Protocol

from navloom.errors import NavloomError
from navloom.geometry.world import World
from navloom.messages import Message
from navloom.misspelt import close_to, nearest
from navloom.roles import ROLE_API, ROLES, Params, Role
from navloom.roles.base import RESERVED_KEYS

__all__ = ["Named", "PluginError", "Registry", "close_to", "nearest"]

NODE, NODE_API = "node", 1
"""Stands for the role of nodes without one; and the version of such nodes that this framework supports."""


class Named(Protocol):
    """Something registered under its own name: a metric or a panel."""

    @property
    def name(self) -> str:
        """Its name in configs and commands."""


class PluginError(NavloomError, ValueError):
    """A plugin is unknown, broken, built for another version of its role, or its name is not unique."""


class Registry:
    """What one entry point registers: classes by role and name, everything else by name."""

    def __init__(self) -> None:
        self.roles: dict[tuple[str, str], type[Role]] = {}
        self.worlds: dict[str, Callable[[], World]] = {}
        self.schemes: dict[str, Callable[[str, Path], World]] = {}
        self.metrics: dict[str, Named] = {}
        self.panels: dict[str, Named] = {}
        self.nodes: dict[str, type[Role]] = {}
        self.messages: dict[str, type[Message]] = {}
        self.commands: dict[str, Callable[..., Any] | str] = {}
        self.suites: dict[str, Path] = {}

    def add(self, plugin: type[Role]) -> None:
        """Add an implementation of a role.

        Raises:
            PluginError: Not a subclass of a role, no name, the role's verb is missing, duplicate name, or built for
                another version of the role.
        """
        if not (isinstance(plugin, type) and issubclass(plugin, tuple(ROLES.values())) and plugin.__dict__.get("name")):
            raise PluginError(f"{plugin!r}: expected a subclass of a role ({', '.join(ROLES)}) with a `name`")
        key = (plugin.role, plugin.name)
        if plugin.role not in ROLES or plugin.api != ROLE_API[plugin.role]:
            raise PluginError(
                f"{plugin.role}.{plugin.name} is built for version {plugin.api} of the role {plugin.role}, "
                f"this framework speaks version {ROLE_API.get(plugin.role)}; install a matching release of it"
            )
        if plugin.__abstractmethods__:
            missing = ", ".join(sorted(plugin.__abstractmethods__))
            raise PluginError(f"{plugin.role}.{plugin.name} does not implement {missing}")
        if wrong := _wrong_part(plugin):
            raise PluginError(f"{plugin.role}.{plugin.name}: {wrong}")
        # The same class twice is no harm: a module may serve several entry points.
        if key in self.roles and self.roles[key] is not plugin:
            raise PluginError(f"{plugin.role}.{plugin.name} is registered twice: rename one of them")
        self.roles[key] = plugin

    def world(self, name: str, make: Callable[[], World]) -> None:
        """Add a named world, made by a function without arguments."""
        if name in self.worlds:
            raise PluginError(f"world {name!r} is registered twice: rename one of them")
        self.worlds[name] = make

    def world_scheme(self, scheme: str, load: Callable[[str, Path], World]) -> None:
        """Add a scheme: `load` gets the text after `scheme:` and the folder that relative paths start from."""
        if scheme in self.schemes:
            raise PluginError(f"world scheme {scheme!r} is registered twice: rename one of them")
        self.schemes[scheme] = load

    def metric(self, metric: Named) -> None:
        """Add a metric of episodes, a `navloom.Metric`."""
        _keep_named(self.metrics, metric, "metric", "a navloom.Metric")

    def panel(self, panel: Named) -> None:
        """Add a viewer panel, a `navloom.Panel`."""
        _keep_named(self.panels, panel, "panel", "a navloom.Panel")

    def node(self, plugin: type[Role]) -> None:
        """Add a node, a subclass of `navloom.NodePlugin`.

        Raises:
            PluginError: Not such a class, no name or step, duplicate name, or built for another version.
        """
        is_node = isinstance(plugin, type) and issubclass(plugin, Role) and plugin.role == NODE
        if not (is_node and plugin.__dict__.get("name")):
            raise PluginError(f"{plugin!r}: expected a subclass of navloom.NodePlugin with a `name`")
        if plugin.api != NODE_API:
            raise PluginError(
                f"node.{plugin.name} is built for version {plugin.api} of nodes, this "
                f"framework speaks version {NODE_API}; install a matching release of it"
            )
        if plugin.__abstractmethods__:
            raise PluginError(f"node.{plugin.name} does not implement {', '.join(sorted(plugin.__abstractmethods__))}")
        if wrong := _wrong_part(plugin):
            raise PluginError(f"node.{plugin.name}: {wrong}")
        if self.nodes.setdefault(plugin.name, plugin) is not plugin:
            raise PluginError(f"node {plugin.name!r} is registered twice: rename one of them")

    def message(self, cls: type[Message]) -> None:
        """Add a message class, under its own name.

        Raises:
            PluginError: Not declared with `@message`, or duplicate name.
        """
        if not (isinstance(cls, type) and issubclass(cls, Message) and cls.schema_name):
            raise PluginError(f"{cls!r}: expected a subclass of navloom.Message, declared with @message")
        if self.messages.setdefault(cls.__name__, cls) is not cls:
            raise PluginError(f"message {cls.__name__!r} is registered twice: rename one of them")

    def command(self, name: str, command: Callable[..., Any] | str) -> None:
        """Add `navloom NAME`: a function, which Typer turns into a command, or a `typer.Typer` with several commands.

        Args:
            name: Name of the command.
            command: The function or Typer, or MODULE:NAME of one, which is imported when the command is used.

        Raises:
            PluginError: Neither of them, or duplicate name.
        """
        if not (callable(command) or _is_reference(command)) or not re.fullmatch(r"[a-z][a-z0-9-]*", name):
            raise PluginError(
                f"command {name!r} is {command!r}: expected a function, a typer.Typer or MODULE:NAME, and a name "
                "of lower case letters, digits and -"
            )
        if name in self.commands:
            raise PluginError(f"command {name!r} is registered twice: rename one of them")
        self.commands[name] = command

    def suite(self, file: Path) -> None:
        """Add a suite of `navloom compare --suite`: a TOML file whose stem is the suite's name, as `doors-1.toml`."""
        if self.suites.setdefault(file.stem, file) != file:
            raise PluginError(f"suite {file.stem!r} is registered twice: rename one of them")


def _is_reference(given: object) -> bool:
    return isinstance(given, str) and re.fullmatch(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*", given) is not None


def _wrong_part(plugin: type[Role]) -> str:
    """The first part of a class that the framework cannot use, and what it expects; empty if there is none."""
    if not (isinstance(plugin.Params, type) and issubclass(plugin.Params, Params)):
        return f"its Params is {plugin.Params!r}, expected a subclass of navloom.Params"
    if taken := [name for name in RESERVED_KEYS if name in _keys_of(plugin.Params)]:
        return (
            f"its Params has a field {' and '.join(taken)}, which is a key of the framework in a role's table: "
            f"no config could set it; rename it, as publish_rate_hz; taken are {', '.join(RESERVED_KEYS)}"
        )
    for name, preset in plugin.presets.items():
        if not re.fullmatch(r"[a-z][a-z0-9_]*", name):
            return f"its preset {name!r}: expected a name of lower case letters, digits and _"
        try:
            # Now, and not when a config first uses it.
            plugin.Params.model_validate(preset.values())
        except ValueError as error:
            return f"its preset {name!r} does not fit its Params: {' '.join(str(error).split())}"
    settings: Mapping[str, type[Params]] = getattr(plugin, "sensor_settings", {})
    for kind, model in settings.items():
        if taken := [name for name in ("name", "kind") if name in _keys_of(model)]:
            return f"its settings of {kind} have a field {' and '.join(taken)}, which every [[sensor]] has: rename it"
    if not (isinstance(plugin.accepts, tuple)
            and all(isinstance(kind, type) and issubclass(kind, Message) for kind in plugin.accepts)):  # fmt: skip
        return f"its accepts is {plugin.accepts!r}, expected a tuple of message classes, as (RangeScan,)"
    if not isinstance(inspect.getattr_static(plugin, "warm_up"), classmethod):
        return "its warm_up is called on the class: put @classmethod before it"
    try:
        # A class with another constructor would fail in the middle of a start.
        inspect.signature(plugin).bind("params", "context")
    except TypeError as error:
        return f"its __init__ is given params and context ({error}): `def __init__(self, params, context)`"
    return ""


def _keys_of(params: type[Params]) -> set[str]:
    """Keys that a config may use for a model's fields."""
    fields = params.model_fields.items()
    return {
        key for name, field in fields for key in (name, field.alias, field.validation_alias) if isinstance(key, str)
    }


def _keep_named(kept: dict[str, Any], given: Any, kind: str, expected: str) -> None:
    name = getattr(given, "name", None)
    if not isinstance(name, str) or not re.fullmatch(r"[a-z][a-z0-9_]*", name):
        raise PluginError(f"{given!r}: expected {expected} with a name of lower case letters, digits and _")
    if name in kept:
        raise PluginError(f"{kind} {name!r} is registered twice: rename one of them")
    kept[name] = given

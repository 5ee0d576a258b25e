"""The plugin that is checked: how it is found, and where its code is."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import wraps
from pathlib import Path, PurePath
from typing import Any, Literal, NamedTuple, get_args, get_origin

from navloom.config import ConfigError
from navloom.config.config_presets import params_of
from navloom.entry_kinds import OTHERS
from navloom.inputs.texts import toml_of
from navloom.plugins import Discovery, PluginError
from navloom.plugins.registry import NODE, nearest
from navloom.roles import ROLES, Role, verb_of
from navloom.roles.presets import named_plugin
from pydantic.fields import FieldInfo

__all__ = ["CHECKED", "CheckRequest", "Subject", "discovery_of", "find", "schema_of"]

CHECKED = (*ROLES, NODE, "metric", "panel", "world", "scheme", "message")
"""Kinds of plugin that have checks."""


class CheckRequest(NamedTuple):
    """The plugin to check, as plain values, since each process loads it again.

    Attributes:
        name: As `avoider.vff`, or `avoider.vff@printed` with a preset.
        params: TOML assignments of its parameters, as `gain=2.0`.
        seed: Of everything random in the checks.
    """

    name: str
    params: tuple[str, ...] = ()
    seed: int = 0


@dataclass(frozen=True)
class Subject:
    """A plugin that was loaded.

    Attributes:
        kind: Its role, or one of the other kinds.
        name: Name of its entry point, without the kind.
        thing: The class; for metrics and panels the object, for worlds and schemes the function.
        owner: Distribution and version.
        params: Its checked parameters; None if it has none.
    """

    kind: str
    name: str
    thing: Any
    owner: str
    params: Any = field(default=None)

    @property
    def full_name(self) -> str:
        """As `avoider.vff`."""
        return f"{self.kind}.{self.name}"

    @property
    def home(self) -> str:
        """Top-level package of its code; for a plugin of the framework, its module."""
        module = str(getattr(self.source, "__module__", "") or "")
        return module if module.partition(".")[0] == "navloom" else module.partition(".")[0]

    @property
    def source(self) -> Any:
        """The class or function that holds its code."""
        if self.kind == "metric":
            return self.thing.compute
        return self.thing.to_rerun if self.kind == "panel" else self.thing

    @property
    def verb(self) -> str:
        """The method that the checks call; empty where the thing itself is called."""
        if self.kind in ROLES:
            return verb_of(self.kind)
        return "step" if self.kind == NODE else ""

    @property
    def place(self) -> str:
        """File and line of its verb, as `adapter.py:31`."""
        found = getattr(self.source, self.verb, None) if self.verb else self.source
        return place_of(found if found is not None else self.source)

    @property
    def folder(self) -> str:
        """Folder of its package, or file of its code, to recognise its lines in a crash; empty if there is none."""
        try:
            file = Path(inspect.getsourcefile(inspect.unwrap(self.source)) or "")
        except TypeError:
            return ""
        return str(file.parent if "." in str(getattr(self.source, "__module__", "")) else file)

    def is_own(self, module: str) -> bool:
        """Whether a module is part of the plugin's code."""
        return module == self.home or module.startswith(f"{self.home}.")


def place_of(thing: Any) -> str:
    """File and line of a function or class, as `adapter.py:31`; empty where it has no Python source."""
    try:
        thing = inspect.unwrap(thing)
        code = getattr(thing, "__code__", None)
        if code is not None:
            return f"{PurePath(code.co_filename).name}:{code.co_firstlineno}"
        return f"{PurePath(inspect.getsourcefile(thing) or '').name}:{inspect.getsourcelines(thing)[1]}"
    except (TypeError, OSError):
        return ""


def discovery_of(request: CheckRequest) -> Discovery:
    """Where plugins are found. Sources besides the installed entry points are added here."""
    return Discovery()


def find(request: CheckRequest) -> Subject:
    """Load a plugin.

    Raises:
        PluginError: It is unknown, broken, or refused by the registry.
        ConfigError: Its parameters do not fit.
    """
    kind, _, name = request.name.partition(".")
    if kind not in CHECKED or not name:
        known = ", ".join(OTHERS if kind in OTHERS else CHECKED)
        raise PluginError(
            f"{request.name}: expected KIND.NAME, as avoider.vff"
            + (f"; there are no checks for a {kind}" if kind in OTHERS else nearest(kind, list(CHECKED)) or known)
        )
    discovery = discovery_of(request)
    name, preset = named_plugin(name) if kind in ROLES or kind == NODE else (name, None)
    thing = _loaded(discovery, kind, name)
    point = ("scheme", name.partition(":")[0]) if kind == "world" and ":" in name else (kind, name)
    info = next((one for one in discovery.infos() if (one.role, one.name) == point), None)
    owner = f"{info.distribution} {info.version}".strip() if info is not None else ""
    return Subject(kind, name, thing, owner, _params(thing, preset, request) if isinstance(thing, type) else None)


def _loaded(discovery: Discovery, kind: str, name: str) -> Any:
    if kind in ROLES or kind == NODE:
        return discovery.plugin(kind, name)
    if kind == "message":
        return discovery.message(schema_of(discovery, name))
    if kind == "world" and ":" in name:
        scheme, _, argument = name.partition(":")
        load = _loaded(discovery, "scheme", scheme)
        return wraps(load)(lambda: load(argument, Path.cwd()))
    registry = discovery.load(kind, name)
    of_kind: Mapping[str, Mapping[str, Any]] = {
        "metric": registry.metrics, "panel": registry.panels, "world": registry.worlds, "scheme": registry.schemes,
    }  # fmt: skip
    registered = of_kind[kind]
    if name not in registered:
        given = ", ".join(registered) or "nothing"
        raise PluginError(f"the entry point {kind}.{name} registers {given}, expected {kind}.{name}")
    return registered[name]


def schema_of(discovery: Discovery, name: str) -> str:
    """Schema name of a message, given as `Tracks` or `navloom_people.Tracks`. Raises PluginError if several fit."""
    known = discovery.names("message")
    fitting = [one for one in known if one.rpartition(".")[2] == name]
    if len(fitting) > 1:
        names = " and ".join(f"message.{one}" for one in fitting)
        raise PluginError(f"message.{name}: there are {names}; name one of them in full")
    return name if name in known or not fitting else fitting[0]


def _params(cls: type, preset: str | None, request: CheckRequest) -> Any:
    """A plugin's parameters: those of the preset or its defaults, with the changes of the request."""
    if not issubclass(cls, Role):
        if request.params:
            raise ConfigError(f"--set {request.params[0]}: {request.name} has no parameters")
        return None
    given = toml_of("\n".join(request.params), "--set", ConfigError)
    required = {name: field for name, field in cls.Params.model_fields.items() if field.is_required()}
    set_by_preset = cls.presets[preset].settings if preset is not None and preset in cls.presets else {}
    made = {name: _some(field) for name, field in required.items() if name not in {*given, *set_by_preset}}
    return params_of(cls, preset, {**made, **given}, request.name)


def _some(field: FieldInfo) -> Any:
    """An ordinary value of a parameter that has no default."""
    kind: Any = field.annotation
    if get_origin(kind) is Literal:
        return get_args(kind)[0]
    if kind not in (int, float):
        return {bool: False, str: "name"}.get(kind)
    bounds: dict[str, Any] = {}
    for mark in field.metadata:
        for name in ("ge", "gt", "le", "lt"):
            if hasattr(mark, name):
                bounds[name[0]] = getattr(mark, name)
    low, high = bounds.get("g"), bounds.get("l")
    if low is None or high is None:
        value = high - 1.0 if low is None and high is not None else 1.0 if low is None else low + 1.0
    else:
        value = 0.5 * (low + high)
    return kind(value)

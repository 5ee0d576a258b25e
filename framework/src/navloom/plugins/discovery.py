"""Finding plugins by entry point: listed without importing, loaded by name, and blamed by name."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

import pluggy

from navloom.geometry.world import World
from navloom.plugins.hooks import HookSpecs
from navloom.plugins.registry import PluginError, Registry, nearest
from navloom.roles import ROLES, Role

__all__ = ["GROUP", "Discovery", "PluginInfo"]

GROUP = "navloom"


@dataclass(frozen=True)
class PluginInfo:
    """What is known of a plugin without importing it.

    Attributes:
        role, name: From the entry point `<role>.<name>`; the role may also be "world" or "scheme".
        distribution, version: Who provides it.
        target: Module that implements the hook.
    """

    role: str
    name: str
    distribution: str
    version: str
    target: str


class Discovery:
    """The plugins installed, less the blocked ones; each is imported when its name is first asked for.

    Args:
        blocked: `role.name` of plugins to treat as not installed.
        found: Entry points to use instead of the installed ones (tests).
    """

    def __init__(self, blocked: Iterable[str] = (), found: Iterable[EntryPoint] | None = None) -> None:
        self.blocked = frozenset(blocked)
        points = entry_points(group=GROUP) if found is None else found
        self._points = sorted((p for p in points if p.name not in self.blocked), key=lambda p: p.name)
        self._hooks = pluggy.PluginManager(GROUP)
        self._hooks.add_hookspecs(HookSpecs)
        self._loaded: dict[str, Registry] = {}

    def infos(self) -> list[PluginInfo]:
        """Every plugin by role and name, without importing any."""
        listed = []
        for point in self._points:
            role, _, name = point.name.partition(".")
            dist: Any = point.dist
            listed.append(
                PluginInfo(role, name, dist.name if dist else "", dist.version if dist else "", point.value)
            )
        return listed

    def names(self, role: str) -> list[str]:
        """Names of one role's plugins."""
        return [info.name for info in self.infos() if info.role == role]

    def role(self, role: str, name: str) -> type[Role]:
        """The class of one plugin.

        Raises:
            PluginError: Unknown role or name, named twice, broken, or built for another version of the role.
        """
        if role not in ROLES:
            raise PluginError(f"role {role!r} does not exist{nearest(role, list(ROLES))}")
        registry = self._load(role, name)
        try:
            return registry.roles[(role, name)]
        except KeyError:
            given = ", ".join(f"{r}.{n}" for r, n in registry.roles) or "nothing"
            raise PluginError(f"the entry point {role}.{name} registers {given}, expected {role}.{name}") from None

    def world(self, reference: str, base: Path) -> World:
        """The world of a reference: a name, `scheme:argument`, or a `.toml` file, relative to a base folder.

        Raises:
            PluginError: No world or scheme of that name.
            ValueError: From the scheme, for a file it cannot use.
        """
        scheme, colon, argument = reference.partition(":")
        if colon:
            schemes = self.names("scheme")
            if scheme not in schemes:
                raise PluginError(f"world {reference!r}: unknown scheme {scheme!r}{nearest(scheme, schemes)}")
            return self._load("scheme", scheme).schemes[scheme](argument, base)
        if reference.endswith(".toml"):
            return self._load("scheme", "toml").schemes["toml"](reference, base)
        worlds = self.names("world")
        if reference not in worlds:
            raise PluginError(f"world {reference!r} does not exist{nearest(reference, worlds)}")
        return self._load("world", reference).worlds[reference]()

    def _load(self, role: str, name: str) -> Registry:
        key = f"{role}.{name}"
        if key not in self._loaded:
            self._loaded[key] = self._register(key, role, name)
        return self._loaded[key]

    def _register(self, key: str, role: str, name: str) -> Registry:
        matches = [p for p in self._points if p.name == key]
        if not matches:
            hint = f"; {key} is blocked" if key in self.blocked else nearest(name, self.names(role))
            raise PluginError(f"no plugin {key!r} is installed{hint}")
        if len(matches) > 1:
            owners = " and ".join(p.dist.name if p.dist else p.value for p in matches)
            raise PluginError(f"two plugins are named {key!r}, from {owners}: uninstall or rename one of them")
        point = matches[0]
        try:
            module = point.load()
            registry = Registry()
            if not self._hooks.is_registered(module):
                self._hooks.register(module, name=point.value)
            others = [p for p in self._hooks.get_plugins() if p is not module]
            self._hooks.subset_hook_caller("navloom_register", others)(registry=registry)
        except PluginError as error:
            raise PluginError(f"plugin {key!r} from {point.value}: {error}") from error
        except Exception as error:
            cause = f"{type(error).__name__}: {error}"
            raise PluginError(
                f"plugin {key!r} from {point.value} fails on import: {cause}; repair it, or block it if it is not needed"
            ) from error
        return registry

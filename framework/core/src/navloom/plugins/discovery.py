"""Finds plugins by entry point: lists them without importing, loads them by name, and names them in errors."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import EntryPoint
from pathlib import Path, PurePath
from typing import Any, TypeVar

from navloom.entry_kinds import OTHERS
from navloom.geometry.world import World
from navloom.inputs.texts import shortened
from navloom.messages import Message
from navloom.parts import OF_FRAMEWORK
from navloom.plugins.error_origin import raised_in
from navloom.plugins.loading import Loader, module_of, owner_of
from navloom.plugins.one_file import available_points
from navloom.plugins.registry import Named, PluginError, Registry, close_to, nearest
from navloom.plugins.shipped_plugins import distribution_of, shipped_names
from navloom.roles import ROLES, Role

__all__ = ["Discovery", "PluginInfo", "scheme_of"]

T = TypeVar("T")
SCHEME_OF_ENDING = {".toml": "toml", ".yaml": "rosmap", ".yml": "rosmap"}
"""World scheme of a file that is named without one."""


@dataclass(frozen=True)
class PluginInfo:
    """What is known of a plugin without importing it.

    Attributes:
        role, name: From the entry point `<role>.<name>`; the role may also be one of OTHERS.
        distribution, version: The distribution that provides it.
        target: Module that implements the hook.
    """

    role: str
    name: str
    distribution: str
    version: str
    target: str


class Discovery:
    """The installed plugins without the blocked ones; each is imported on first use of its name.

    Args:
        blocked: `role.name` of plugins to treat as not installed.
        found: Entry points that replace those of installed distributions and files (for tests).
    """

    def __init__(self, blocked: Iterable[str] = (), found: Iterable[EntryPoint] | None = None) -> None:
        self.blocked = frozenset(blocked)
        self._loader = Loader(self.blocked)
        points = available_points() if found is None else found
        self._points = sorted(
            (p for p in points if not (self._loader.is_blocked(p.name) or self._loader.is_blocked(_key(p)))), key=_key
        )
        self._loaded: dict[str, Registry] = {}

    def infos(self) -> list[PluginInfo]:
        """Every plugin, sorted by role and name, without importing any."""
        listed = []
        for point in self._points:
            role, _, name = point.name.partition(".")
            dist: Any = point.dist
            listed.append(PluginInfo(role, name, dist.name if dist else "", dist.version if dist else "", point.value))
        return listed

    def problems(self) -> list[str]:
        """A message for each entry point that cannot be used by name, without importing any."""
        found = []
        kinds = [*ROLES, *OTHERS]
        for point in self._points:
            role, _, name = point.name.partition(".")
            if role not in kinds or not name:
                found.append(
                    f"entry point {point.name!r} of {owner_of(point)}: expected ROLE.NAME{nearest(role, kinds)}"
                )
        for name in dict.fromkeys(map(_key, self._points)):
            twins = [point for point in self._points if _key(point) == name]
            # A stranger cannot replace a command of navloom's own: only the stranger is told.
            strangers = [point for point in twins if owner_of(point) not in OF_FRAMEWORK]
            if name.startswith("command.") and len(strangers) < len(twins):
                found += [
                    f"entry point {name!r} of {owner_of(point)}: navloom has a command of that name; rename it"
                    for point in strangers
                ]
            elif len(twins) > 1:
                found.append(_of_one_name(name, twins))
        return found

    def names(self, role: str) -> list[str]:
        """Names of one role's plugins; names of messages include the package, as `navloom_people.Tracks`."""
        parts = (_key(point).partition(".") for point in self._points)
        return [name for owner, _, name in parts if owner == role]

    def meant(self, name: str) -> str:
        """`; did you mean 'avoider.vff'?` for a plugin that is named without its kind, to append; else empty."""
        found = [_key(point) for point in self._points if name and _key(point).partition(".")[2] == name]
        return f"; did you mean {' or '.join(map(repr, found))}?" if found else ""

    def role(self, role: str, name: str) -> type[Role]:
        """The class of one plugin.

        Raises:
            PluginError: Unknown role or name, duplicate name, broken plugin, or built for another role version.
        """
        if role not in ROLES:
            raise PluginError(f"role {role!r} does not exist{nearest(role, list(ROLES))}")
        return self._given(role, name, {n: cls for (r, n), cls in self.load(role, name).roles.items() if r == role})

    def world(self, reference: str, base: Path) -> World:
        """The world of a reference: a name, `scheme:argument`, or a `.toml` or `.yaml` file relative to a base folder.

        Raises:
            PluginError: No world or scheme of that name, or its plugin is broken.
            ValueError: Raised by the scheme for a file that it cannot use.
        """
        scheme, argument = scheme_of(reference)
        if scheme:
            schemes = self.names("scheme")
            if scheme not in schemes and f"scheme.{scheme}" not in self.blocked:
                if distribution_of(f"scheme.{scheme}"):
                    remedy = self.instead_of("scheme", scheme)
                    raise PluginError(f"world {reference!r}: scheme {scheme!r} is not installed{remedy}")
                raise PluginError(f"world {reference!r}: unknown scheme {scheme!r}{nearest(scheme, schemes)}")
            load = self._given("scheme", scheme, self.load("scheme", scheme).schemes)
            return _world_of(f"world scheme {scheme!r}", reference, load, argument, base)
        worlds = self.names("world")
        if reference not in worlds and f"world.{reference}" not in self.blocked:
            raise PluginError(f"world {reference!r} does not exist{nearest(reference, worlds)}")
        make = self._given("world", reference, self.load("world", reference).worlds)
        return _world_of(f"world {reference!r}", reference, make)

    def metric(self, name: str) -> Named:
        """A metric of episodes.

        Raises:
            PluginError: No metric of that name, named twice, or broken.
        """
        return self._given("metric", name, self.load("metric", name).metrics)

    def suite(self, name: str) -> Path:
        """The file of a suite.

        Raises:
            PluginError: No suite of that name, named twice, or broken.
        """
        return self._given("suite", name, self.load("suite", name).suites)

    def panel(self, name: str) -> Named:
        """A viewer panel.

        Raises:
            PluginError: No panel of that name, named twice, or broken.
        """
        return self._given("panel", name, self.load("panel", name).panels)

    def plugin(self, role: str, name: str) -> type[Role]:
        """The class of one plugin of a role, or of a node if `role` names no role.

        Raises:
            PluginError: See `role` and `node`.
        """
        return self.role(role, name) if role in ROLES else self.node(name)

    def node(self, name: str) -> type[Role]:
        """The class of a node without a role.

        Raises:
            PluginError: No node of that name, named twice, or broken.
        """
        return self._given("node", name, self.load("node", name).nodes)

    def message(self, schema: str) -> type[Message]:
        """A message class by its schema name, as `navloom_people.Tracks`.

        Raises:
            PluginError: No message of that name, named twice, or broken.
        """
        declared = self.load("message", schema).messages.values()
        return self._given("message", schema, {cls.schema_name: cls for cls in declared})

    def owner_of(self, package: str) -> str:
        """Name and version of the distribution whose plugins are in a package; empty if there is none."""
        found = (point.dist for point in self._points if module_of(point).partition(".")[0] == package)
        return next((f"{dist.name} {dist.version}" for dist in found if dist is not None), "")

    def command(self, name: str) -> Callable[..., Any]:
        """A command of the command line.

        Raises:
            PluginError: No command of that name, named twice, or broken.
        """
        given = self._given("command", name, self.load("command", name).commands)
        # A reference is imported only when its command is used.
        if not isinstance(given, str):
            return given
        module, _, attribute = given.partition(":")
        found: Callable[..., Any] = getattr(import_module(module), attribute)
        return found

    def instead_of(self, role: str, name: str, beside: Iterable[str] = ()) -> str:
        """The remedy for a plugin that is not installed, to append to a message: install it, or use another.

        Args:
            role, name: The plugin.
            beside: Further names that would have been accepted.
        """
        if f"{role}.{name}" in self.blocked:
            return f"; {role}.{name} is blocked"
        if distribution := distribution_of(f"{role}.{name}"):
            return f": pip install {distribution}, or pip install 'navloom[all]' for every plugin of the project"
        known, shipped = [*self.names(role), *beside], shipped_names(role)
        if not known and not shipped:
            return f", nor is any other {role}: install the distribution that it comes with"
        if known:
            return close_to(name, [*known, *shipped]) or nearest(name, known)
        every = f"pip install 'navloom[all]' adds {', '.join(shipped)}"
        return close_to(name, shipped) or f"; no {role} is installed: {every}"

    def _given(self, role: str, name: str, registered: Mapping[str, T]) -> T:
        """The object that an entry point registered under its own name."""
        if name not in registered:
            given = ", ".join(f"{role}.{other}" for other in sorted(registered)) or f"no {role}"
            hint = "" if registered else ": its module's `navloom_register(registry)`, marked @hookimpl, must add it"
            raise PluginError(f"the entry point {role}.{name} registers {given}, expected {role}.{name}{hint}")
        return registered[name]

    def load(self, role: str, name: str) -> Registry:
        """The registry that one entry point filled; the first call imports it.

        Raises:
            PluginError: Unknown, duplicate, or broken.
        """
        key = f"{role}.{name}"
        if key not in self._loaded:
            self._loaded[key] = self._loader.register(key, self._point(key, role, name))
        return self._loaded[key]

    def call(self, role: str, name: str, hook: str, **given: Any) -> Sequence[Any]:
        """Call a hook of one loaded entry point; its exceptions propagate."""
        return self._loader.call(f"{role}.{name}", hook, **given)

    def blamed(self, role: str, name: str, error: BaseException) -> str:
        """Message for an entry point's exception: its distribution, the error, and the innermost line of its code."""
        point = self._point(f"{role}.{name}", role, name)
        return f"{point.name} of {owner_of(point)} failed: {raised_in(error, module_of(point))}"

    def _point(self, key: str, role: str, name: str) -> EntryPoint:
        matches = [p for p in self._points if _key(p) == key]
        if not matches:
            raise PluginError(f"no plugin {shortened(key, 200)} is installed{self.instead_of(role, name)}")
        if len(matches) > 1:
            raise PluginError(_of_one_name(key, matches))
        return matches[0]


def _key(point: EntryPoint) -> str:
    """Key of an entry point: its name. A message's key includes the package, since two packages may share a name."""
    kind, _, name = point.name.partition(".")
    return f"{kind}.{module_of(point).partition('.')[0]}.{name}" if kind == "message" else point.name


def scheme_of(reference: str) -> tuple[str, str]:
    """Scheme and argument of a world's reference; two empty texts for a world's name."""
    scheme, colon, argument = reference.partition(":")
    if colon:
        return scheme, argument
    scheme = SCHEME_OF_ENDING.get(PurePath(reference.partition("?")[0]).suffix, "")
    return scheme, reference if scheme else ""


def _world_of(plugin: str, reference: str, make: Callable[..., World], *given: Any) -> World:
    """The world that a plugin makes. A ValueError refuses the reference; any other exception is the plugin's fault."""
    try:
        world = make(*given)
    # The scheme's words about a file: the user can mend that, not the plugin.
    except ValueError:
        raise
    except (Exception, SystemExit) as error:
        raise PluginError(f"{plugin} fails at {reference!r}: {raised_in(error, make)}") from error
    if not isinstance(world, World):
        raise PluginError(f"{plugin} gives {type(world).__name__} for {reference!r}, expected World")
    return world


def _of_one_name(name: str, points: Iterable[EntryPoint]) -> str:
    owners = " and ".join(sorted(map(owner_of, points)))
    return f"two plugins are named {name!r}, from {owners}: uninstall or rename one of them"

"""The parts of the framework that are distributions of their own, and public names that are imported late.

The core imports no part: it asks for it by name.

Every start of the command line imports this module: keep it light.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

from navloom.errors import NavloomError

__all__ = ["ALIASES", "OF_FRAMEWORK", "PARTS", "MissingPartError", "has_part", "install_aliases", "lazy_names", "part"]

PARTS = {
    "navloom_avoidance": "navloom-avoidance",
    "navloom_calibration": "navloom-calibration",
    "navloom_carmen": "navloom-carmen",
    "navloom_check": "navloom-check",
    "navloom_dashboard": "navloom-dashboard",
    "navloom_live": "navloom-live",
    "navloom_maps": "navloom-maps",
    "navloom_optimal": "navloom-optimal",
    "navloom_orca": "navloom-orca",
    "navloom_recording": "navloom-recording",
    "navloom_study": "navloom-study",
    "navloom_viewer": "navloom-viewer",
}
"""Distribution of each package that may be missing."""
OF_FRAMEWORK = {"navloom", *PARTS.values()}
"""Every distribution of the framework."""
ALIASES = {"navloom.avoidance": "navloom_avoidance", "navloom.testing": "navloom_check"}
"""Public packages that live in a part, by the name that plugins import."""


class MissingPartError(NavloomError, ImportError):
    """A part of the framework is needed and not installed; the text says which."""


def part(module: str, user: str = "this", install: str = "") -> Any:
    """A module of a part, as `navloom_live.operating.robot_lookup`.

    Args:
        module: Its dotted name.
        user: What needs it, for the message: an option or a name that a user wrote.
        install: What to install if it is missing; the part's distribution unless given.

    Raises:
        MissingPartError: The part is not installed.
    """
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        package = module.partition(".")[0]
        # The part is there, and something that it imports is missing.
        if error.name != package:
            raise
        raise MissingPartError(
            f"{user} needs {PARTS[package]}, which is not installed: pip install {install or PARTS[package]}"
        ) from None


def has_part(package: str) -> bool:
    """Whether a part is installed, as `navloom_study`."""
    from importlib.util import find_spec

    return find_spec(package) is not None


def lazy_names(package: str, names: Mapping[str, str]) -> tuple[list[str], Callable[[str], Any]]:
    """The `__all__` and `__getattr__` of a package that imports a public name from its module on first use.

    So each name loads only what it needs, and a package may list names of modules that import the package.

    Args:
        package: Its name, for messages.
        names: Public names, separated by spaces, by their module. No name may be that of a module of the package: once
            imported, the module takes the name.
    """
    module_of = {name: module for module, listed in names.items() for name in listed.split()}

    def public_name(name: str) -> Any:
        if name in module_of:
            return getattr(part(module_of[name], f"{package}.{name}"), name)
        near = ""
        # Tools look for dunder names by the dozen; a suggestion would only delay them.
        if not name.startswith("_"):
            # `difflib` is imported only for a wrong name.
            from navloom.misspelt import close_to

            near = close_to(name, list(module_of))
        raise AttributeError(f"module {package!r} has no attribute {name!r}{near}")

    return list(module_of), public_name


class _Alias:
    """Gives the part's module itself, so that both names are one object."""

    def __init__(self, module: ModuleType) -> None:
        self._module, self._spec = module, module.__spec__

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        return self._module

    def exec_module(self, module: ModuleType) -> None:
        module.__spec__ = self._spec  # importlib has set that of the alias


class _Aliases:
    """Finds `navloom.testing` and the like in their parts."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        public = ".".join(fullname.split(".")[:2])
        if public not in ALIASES:
            return None
        module = part(ALIASES[public] + fullname.removeprefix(public), public)
        return ModuleSpec(fullname, _Alias(module), is_package=hasattr(module, "__path__"))  # type: ignore[arg-type]


def install_aliases() -> None:
    """Let the public packages be imported by their names."""
    if not any(isinstance(finder, _Aliases) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Aliases())  # before the finder that would load a part's module a second time

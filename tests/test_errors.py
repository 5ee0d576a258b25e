"""Every public exception derives from `NavloomError`: one `except` takes them all, and the command line prints them."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from navloom import NavloomError

TOP = Path(__file__).resolve().parents[1]
PACKAGES = sorted(
    path.parent.name
    for source in (*TOP.glob("framework/*/src"), TOP / "benchmarks" / "src", *TOP.glob("plugins/*/src"))
    for path in source.glob("*/__init__.py")
)
WAIVERS = {
    "navloom.plugins.one_file.ImportTimeout": "a BaseException: `except` of an imported file must not catch it",
    "navloom_recording.excerpt.DebuggerLeft": "a BaseException: a node must not take it for a fault of its plugin",
    "zenoh.ZError": "of Zenoh itself, whose one module hands it to the rest of `transport`, which raises BusError",
}
"""What is no `NavloomError`, each with why; our own code catches all of them."""


def exceptions(package: str) -> Iterator[type[BaseException]]:
    """The exceptions that modules of a package define or list in `__all__`, without private ones."""
    top = importlib.import_module(package)
    names = [module.name for module in pkgutil.walk_packages(top.__path__, f"{package}.")]
    modules = [importlib.import_module(name) for name in names if not name.endswith("__main__")]
    for module in (top, *modules):
        listed = set(getattr(module, "__all__", ()))
        for name, thing in vars(module).items():
            if not isinstance(thing, type) or not issubclass(thing, BaseException):
                continue
            if name in listed or (thing.__module__ == module.__name__ and not name.startswith("_")):
                yield thing


@pytest.mark.parametrize("package", PACKAGES)
def test_every_public_exception_is_a_navloom_error(package: str) -> None:
    others = [exception for exception in exceptions(package) if not issubclass(exception, NavloomError)]
    assert {f"{exception.__module__}.{exception.__qualname__}" for exception in others} <= set(WAIVERS)

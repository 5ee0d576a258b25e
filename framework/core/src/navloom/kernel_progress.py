"""Counts the kernels that a start needs and those that are ready: the numbers of "kernel 12 of 140"."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from types import ModuleType
from typing import Any, NamedTuple

__all__ = ["Kernels", "expect_kernels", "kernels_so_far"]


class Kernels(NamedTuple):
    """Kernels of a process.

    Attributes:
        compiled: Compiled by the process itself; 0 while all are loaded from the cache.
        ready: Compiled or loaded.
        total: Expected in all. A kernel that the parameters leave unused counts too, and one outside the packages of
            the plugins does not.
    """

    compiled: int = 0
    ready: int = 0
    total: int = 0

    def __str__(self) -> str:
        return f"kernel {self.ready} of {self.total}"


_expected: list[Any] = []


def expect_kernels(places: Iterable[str | type]) -> None:
    """Count the kernels that are reached from modules, by name, and from the packages of plugins, by class."""
    names: set[str] = set()
    for place in places:
        if isinstance(place, str):
            names |= _reached(place, "navloom.navigation")
        else:
            for cls in place.__mro__:
                if (package := cls.__module__.partition(".")[0]) not in ("navloom", "builtins", "abc", "typing"):
                    names |= _reached(cls.__module__, package)
    _expected[:] = [kernel for name in sorted(names) for kernel in _kernels_in(sys.modules[name])]


def kernels_so_far(compiled: int) -> Kernels:
    """The kernels of this process, of which it has compiled some itself."""
    ready, left = set[int](), [kernel for kernel in _expected if kernel.signatures]
    while left:
        kernel = left.pop()
        if id(kernel) not in ready:
            ready.add(id(kernel))
            # A kernel that is loaded from the cache contains those it calls, which are not loaded themselves.
            function = kernel.py_func
            named = [function.__globals__.get(name) for name in function.__code__.co_names]
            left += [value for value in named if _is_kernel(value)]
    return Kernels(compiled, sum(id(kernel) in ready for kernel in _expected), len(_expected))


def _reached(start: str, package: str) -> set[str]:
    """Modules that a module refers to, directly or not, within its package or another one of navloom's plugins."""
    found, left = set[str](), [start]
    while left:
        name = left.pop()
        if name in found or name not in sys.modules or not (name + ".").startswith((f"{package}.", "navloom_")):
            continue
        found.add(name)
        for value in vars(sys.modules[name]).values():
            left.append(value.__name__ if isinstance(value, ModuleType) else getattr(value, "__module__", None) or "")
    return found


def _kernels_in(module: ModuleType) -> list[Any]:
    """The module's own kernels that are compiled by themselves, not within their callers."""
    return [
        value
        for value in vars(module).values()
        if _is_kernel(value) and value.py_func.__module__ == module.__name__
        and value.targetoptions.get("inline") != "always"
    ]  # fmt: skip


def _is_kernel(value: Any) -> bool:
    # Without an import of numba, which takes a second: what compiles no kernel reads this module too.
    return hasattr(value, "signatures") and hasattr(value, "py_func")

"""Counts the kernels that a start needs and those that are ready: the numbers of "kernel 12 of 140"."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from functools import lru_cache
from types import CodeType, ModuleType
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
    """Count the kernels that modules, by name, and classes of plugins refer to, directly or through what they call."""
    _expected[:] = _kernels_of(tuple(places))


# A worker makes the same plugins in each episode, and looking through all that they name takes as long as 20 ticks.
@lru_cache(maxsize=64)
def _kernels_of(places: tuple[str | type, ...]) -> list[Any]:
    left: list[Any] = []
    for place in places:
        left += vars(sys.modules[place]).values() if isinstance(place, str) else place.__mro__
    packages = {_package_of(thing) for thing in left if isinstance(thing, type)} - {"abc", "builtins", "typing"}
    found: dict[int, Any] = {}
    while left:
        thing = left.pop()
        package = _package_of(thing)
        if id(thing) not in found and (package in packages or package.startswith("navloom")):
            found[id(thing)] = thing
            left += _named_in(thing)
    return [thing for thing in found.values() if _is_kernel(thing) and not _is_inlined(thing)]


def kernels_so_far(compiled: int) -> Kernels:
    """The kernels of this process, of which it has compiled some itself."""
    ready, left = set[int](), [kernel for kernel in _expected if kernel.signatures]
    while left:
        kernel = left.pop()
        if id(kernel) not in ready:
            ready.add(id(kernel))
            # A kernel that is loaded from the cache contains those it calls, which are not loaded themselves.
            left += [thing for thing in _named_in(kernel) if _is_kernel(thing)]
    return Kernels(compiled, sum(id(kernel) in ready for kernel in _expected), len(_expected))


def _named_in(thing: Any) -> list[Any]:
    """What a class holds, or what the code of a function or kernel names."""
    if isinstance(thing, type):
        held = vars(thing).values()
        return [*thing.__bases__, *(getattr(value, "__func__", getattr(value, "fget", value)) for value in held)]
    function = getattr(thing, "py_func", thing)
    codes: list[CodeType] = [function.__code__] if hasattr(function, "__code__") else []
    named: list[Any] = []
    for code in codes:  # grows: comprehensions and lambdas have code of their own
        codes += [constant for constant in code.co_consts if isinstance(constant, CodeType)]
        found = [function.__globals__.get(name) for name in code.co_names]
        named += found
        named += [vars(one).get(name) for one in found if isinstance(one, ModuleType) for name in code.co_names]
    return named


def _package_of(thing: Any) -> str:
    return str(getattr(thing, "__module__", None) or "").partition(".")[0]


def _is_inlined(kernel: Any) -> bool:
    """Whether a kernel is compiled within its callers instead of by itself."""
    return bool(kernel.targetoptions.get("inline") == "always")


def _is_kernel(value: Any) -> bool:
    # Without an import of numba, which takes a second: what compiles no kernel reads this module too.
    return hasattr(value, "signatures") and hasattr(value, "py_func")

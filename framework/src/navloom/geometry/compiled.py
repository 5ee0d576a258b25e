"""The one way this package compiles: cached on disk, without the interpreter's lock, with its types kept."""

from __future__ import annotations

from collections.abc import Callable
from typing import ParamSpec, TypeVar, cast

import numba

from navloom.kernel_cache import harden_kernel_cache

__all__ = ["compiled"]

harden_kernel_cache()

P = ParamSpec("P")
R = TypeVar("R")


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Decorator: compile a function with numba when it is first called."""
    return cast(Callable[P, R], numba.njit(cache=True, nogil=True)(function))

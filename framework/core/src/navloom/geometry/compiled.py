"""The package's compile decorator: numba with a disk cache and without the GIL, keeping the function's type."""

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
    """Decorator: compile a function with numba at its first call."""
    # nogil: a long kernel would stop the other threads of a live process, which receive messages and beat.
    return cast(Callable[P, R], numba.njit(cache=True, nogil=True)(function))

"""The compile decorator: numba with a disk cache and without the GIL, keeping the function's type."""

from __future__ import annotations

from collections.abc import Callable
from typing import ParamSpec, TypeVar, cast

import numba

__all__ = ["compiled"]

P = ParamSpec("P")
R = TypeVar("R")


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Decorator: compile a function with numba at its first call."""
    return cast(Callable[P, R], numba.njit(cache=True, nogil=True)(function))

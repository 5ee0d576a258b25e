"""Input and output structs of verbs: frozen dataclasses with slots, constructed in half the usual time."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import MISSING, Field, dataclass, fields
from typing import Any, TypeVar, dataclass_transform

__all__ = ["struct"]

S = TypeVar("S")


@dataclass_transform(frozen_default=True)
def struct(cls: type[S]) -> type[S]:
    """Declare a frozen dataclass with slots, without default factories.

    The constructor of a frozen dataclass sets each field by name. This one sets the slots directly.
    """
    made = dataclass(frozen=True, slots=True, init=False)(cls)
    made.__init__ = _constructor(made)  # type: ignore[method-assign]
    return made


def _constructor(cls: type[Any]) -> Callable[..., None]:
    """A generated `__init__`, made from the declaration alone."""
    declared: tuple[Field[Any], ...] = fields(cls)
    given: list[str] = []
    lines: list[str] = []
    names: dict[str, Any] = {}
    for one in declared:
        if one.default_factory is not MISSING:
            raise TypeError(f"{cls.__name__}.{one.name} has a default factory; give a value")
        has_default = one.default is not MISSING
        given.append(f"{one.name}=_default_{one.name}" if has_default else one.name)
        lines.append(f"    _set_{one.name}(self, {one.name})")
        names |= {f"_default_{one.name}": one.default, f"_set_{one.name}": vars(cls)[one.name].__set__}
    source = "\n".join([f"def __init__(self, {', '.join(given)}):", *lines])
    exec(compile(source, f"<struct {cls.__name__}>", "exec"), names)
    made: Callable[..., None] = names["__init__"]
    made.__qualname__ = f"{cls.__qualname__}.__init__"
    made.__annotations__ = inspect.get_annotations(cls) | {"return": None}
    return made

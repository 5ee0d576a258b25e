"""How a message is declared: a frozen dataclass whose fields are checked once, at construction."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields
from operator import attrgetter
from types import UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, dataclass_transform, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

__all__ = ["SCHEMAS", "Array", "Kind", "Message", "MessageError", "Unbounded", "message"]

M = TypeVar("M", bound="Message")


class MessageError(ValueError):
    """A field does not fit its declaration; the text names the field, what was given and what was expected."""


@dataclass(frozen=True)
class Array:
    """Shape and element type of an array field.

    Attributes:
        dtype: Element type by numpy name.
        shape: Sizes; a name stands for any size, the same one for every field of the message that uses it.
        infinite: `+inf` is a value (no echo). NaN never is.
        at_least: Smallest element allowed, or None.
    """

    dtype: str
    shape: tuple[int | str, ...]
    infinite: bool = False
    at_least: float | None = None


Unbounded = Annotated[float, "infinite"]
"""A float that may be infinite (the clearance in an empty world); never NaN."""


@dataclass(frozen=True)
class Kind:
    """What one field holds, resolved from its annotation: exactly one of the forms below.

    Attributes:
        form: "float", "int", "bool", "str", "array", "message" or "tuple".
        optional: None is a value.
        array: Declaration of an array field.
        choices: Allowed strings of a Literal field; empty where any will do.
        item: Kind of a tuple's items.
        message: Class of a nested message.
        infinite: A float that may be infinite.
    """

    form: str
    optional: bool = False
    array: Array | None = None
    choices: tuple[str, ...] = ()
    item: Kind | None = None
    message: type[Message] | None = None
    infinite: bool = False


class Message:
    """Base of everything that flows. Made with the `message` decorator only."""

    __slots__ = ()
    schema_name: str = ""
    schema_version: int = 0
    kinds: dict[str, Kind] = {}
    read_fields: Callable[[Any], tuple[Any, ...]]
    checks: tuple[tuple[str, Callable[[str, Any, dict[str, int]], Any]], ...] = ()

    def __post_init__(self) -> None:
        sizes: dict[str, int] = {}
        for (name, check), value in zip(self.checks, self.read_fields(), strict=True):
            kept = check(name, value, sizes)
            if kept is not value:
                object.__setattr__(self, name, kept)


SCHEMAS: dict[str, type[Message]] = {}
"""Every declared message class by its schema name."""


@dataclass_transform(frozen_default=True)
def message(version: int = 1) -> Callable[[type[M]], type[M]]:
    """Declare a message: makes the class a frozen dataclass with slots, checked at construction.

    Float fields take any real number and hold a finite float; array fields are copied unless they are read-only
    already, checked for element type, shape and NaN, and held read-only. Classes with array fields compare by
    identity, the others by value.
    """

    def declare(cls: type[M]) -> type[M]:
        hints = get_type_hints(cls, include_extras=True)
        names = [name for name in cls.__annotations__ if name in hints]
        kinds = {name: _kind(hints[name]) for name in names}
        holds_arrays = any(_holds_array(kind) for kind in kinds.values())
        made = dataclass(frozen=True, slots=True, eq=not holds_arrays)(cls)
        made.schema_name = f"navloom.{cls.__name__}"
        made.schema_version = version
        made.kinds = kinds
        made.read_fields = _reader([f.name for f in fields(made)])  # type: ignore[arg-type]
        made.checks = tuple((name, _checker(cls.__name__, kind)) for name, kind in kinds.items())
        SCHEMAS[made.schema_name] = made
        return made

    return declare


def _reader(names: list[str]) -> property | Callable[[Any], tuple[Any, ...]]:
    if len(names) > 1:
        get = attrgetter(*names)
        return lambda self: get(self)  # type: ignore[no-any-return]
    return lambda self: tuple(getattr(self, name) for name in names)


def _holds_array(kind: Kind) -> bool:
    if kind.form == "array":
        return True
    if kind.message is not None:
        return any(_holds_array(inner) for inner in kind.message.kinds.values())
    return kind.item is not None and _holds_array(kind.item)


def _kind(hint: Any) -> Kind:
    origin = get_origin(hint)
    if origin in (Union, UnionType):
        inner = [arg for arg in get_args(hint) if arg is not type(None)]
        kind = _kind(inner[0])
        return Kind(**{**kind.__dict__, "optional": True})
    if origin is Annotated:
        base, mark = get_args(hint)[:2]
        if isinstance(mark, Array):
            return Kind("array", array=mark)
        return Kind("float", infinite=mark == "infinite") if base is float else _kind(base)
    if origin is Literal:
        return Kind("str", choices=get_args(hint))
    if origin is tuple:
        return Kind("tuple", item=_kind(get_args(hint)[0]))
    if isinstance(hint, type) and issubclass(hint, Message):
        return Kind("message", message=hint)
    if hint in (float, int, bool, str):
        return Kind(hint.__name__)
    raise TypeError(f"a message field cannot be annotated {hint!r}")


def _checker(cls: str, kind: Kind) -> Callable[[str, Any, dict[str, int]], Any]:
    """The function that checks and normalises a value of this kind."""
    check = _CHECKERS[kind.form](cls, kind)
    if not kind.optional:
        return check
    return lambda name, value, sizes: None if value is None else check(name, value, sizes)


def _float_checker(cls: str, kind: Kind) -> Callable[[str, Any, dict[str, int]], Any]:
    def check(name: str, value: Any, sizes: dict[str, int]) -> float:
        if type(value) is not float:
            try:
                value = float(value)
            except (TypeError, ValueError):
                raise MessageError(f"{cls}.{name}: got {value!r}, expected a number") from None
        if not math.isfinite(value) and (not kind.infinite or math.isnan(value)):
            raise MessageError(f"{cls}.{name}: got {value}, expected a finite number")
        return value  # type: ignore[no-any-return]

    return check


def _plain_checker(cls: str, kind: Kind) -> Callable[[str, Any, dict[str, int]], Any]:
    wanted: type = {"int": int, "bool": bool, "str": str}[kind.form]

    def check(name: str, value: Any, sizes: dict[str, int]) -> Any:
        if type(value) is not wanted:
            if wanted is int and isinstance(value, np.integer):
                value = int(value)
            elif wanted is bool and isinstance(value, np.bool_):
                value = bool(value)
            else:
                raise MessageError(f"{cls}.{name}: got {value!r}, expected {wanted.__name__}")
        if kind.choices and value not in kind.choices:
            raise MessageError(f"{cls}.{name}: got {value!r}, expected one of {', '.join(kind.choices)}")
        return value

    return check


def _message_checker(cls: str, kind: Kind) -> Callable[[str, Any, dict[str, int]], Any]:
    wanted = kind.message
    assert wanted is not None

    def check(name: str, value: Any, sizes: dict[str, int]) -> Any:
        if not isinstance(value, wanted):
            raise MessageError(f"{cls}.{name}: got {type(value).__name__}, expected {wanted.__name__}")
        return value

    return check


def _tuple_checker(cls: str, kind: Kind) -> Callable[[str, Any, dict[str, int]], Any]:
    assert kind.item is not None
    item = _checker(cls, kind.item)

    def check(name: str, value: Any, sizes: dict[str, int]) -> Any:
        if not isinstance(value, (tuple, list)):
            raise MessageError(f"{cls}.{name}: got {type(value).__name__}, expected a tuple")
        return tuple(item(f"{name}[{i}]", entry, {}) for i, entry in enumerate(value))

    return check


def _array_checker(cls: str, kind: Kind) -> Callable[[str, Any, dict[str, int]], Any]:
    spec = kind.array
    assert spec is not None
    dtype = np.dtype(spec.dtype)
    named = tuple(enumerate(spec.shape))
    is_float = dtype.kind == "f"

    def check(name: str, value: Any, sizes: dict[str, int]) -> NDArray[Any]:
        if type(value) is not np.ndarray or value.dtype != dtype or value.ndim != len(named):
            raise MessageError(f"{cls}.{name}: got {_describe(value)}, expected {spec.dtype} of shape {spec.shape}")
        for axis, size in named:
            wanted = sizes.setdefault(size, value.shape[axis]) if isinstance(size, str) else size
            if value.shape[axis] != wanted:
                raise MessageError(
                    f"{cls}.{name}: got shape {value.shape}, expected {spec.shape}, with {size} = {wanted}"
                )
        if value.flags.writeable or not value.flags.c_contiguous:
            value = value.copy()
            value.flags.writeable = False
        if is_float:
            _refuse_bad_numbers(cls, name, value, spec)
        return value

    return check


def _refuse_bad_numbers(cls: str, name: str, value: NDArray[Any], spec: Array) -> None:
    """NaN always, infinity unless the field allows +inf, and what lies below the smallest allowed value."""
    if value.size == 0:
        return
    if spec.at_least is not None and not np.minimum.reduce(value, axis=None) >= spec.at_least:
        bad = value[~(value >= spec.at_least)].flat[0]
        raise MessageError(f"{cls}.{name}: holds {bad}, expected values >= {spec.at_least:g}, without NaN")
    if spec.infinite:
        if spec.at_least is None and np.isnan(value).any():
            raise MessageError(f"{cls}.{name}: holds NaN, expected numbers")
    elif not math.isfinite(np.add.reduce(value, axis=None)):  # a sum may overflow: only then look at each
        bad_ones = value[~np.isfinite(value)]
        if bad_ones.size:
            raise MessageError(f"{cls}.{name}: holds {bad_ones.flat[0]}, expected finite numbers")


def _describe(value: Any) -> str:
    return f"{value.dtype} of shape {value.shape}" if isinstance(value, np.ndarray) else type(value).__name__


_CHECKERS: dict[str, Callable[[str, Kind], Callable[[str, Any, dict[str, int]], Any]]] = {
    "float": _float_checker,
    "int": _plain_checker,
    "bool": _plain_checker,
    "str": _plain_checker,
    "message": _message_checker,
    "tuple": _tuple_checker,
    "array": _array_checker,
}

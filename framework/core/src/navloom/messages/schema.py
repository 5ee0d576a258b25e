"""Declares messages: frozen dataclasses whose fields are checked once, at construction."""

from __future__ import annotations

import inspect
import math
import re
import sys
from collections.abc import Callable
from dataclasses import MISSING, Field, dataclass, fields
from operator import attrgetter
from pathlib import Path
from typing import Any, TypeVar, dataclass_transform, get_type_hints, overload

from navloom.messages.checks import checker
from navloom.messages.kinds import (
    Array,
    Heading,
    Kind,
    Message,
    MessageError,
    Most,
    Name,
    NotNegative,
    Positive,
    Stamp,
    Unbounded,
    Words,
    holds_array,
    kind_of,
)

__all__ = ["OLDER", "SCHEMAS", "Array", "Heading", "Kind", "Message", "MessageError", "Most", "Name", "NotNegative",
           "Positive", "Stamp", "Unbounded", "Words", "in_version", "message",
           "older_names"]  # fmt: skip

M = TypeVar("M", bound=Message)

SCHEMAS: dict[str, type[Message]] = {}
"""Every declared message class by its schema name."""

OLDER: dict[str, type[Message]] = {}
"""Older versions of messages that are still read, by label, as `navloom.GateStatus/1`."""


@overload
def message(cls: type[M], /) -> type[M]: ...
@overload
def message(version: int = 1, now: type[Message] | None = None) -> Callable[[type[M]], type[M]]: ...
@dataclass_transform(frozen_default=True)
def message(version: Any = 1, now: type[Message] | None = None) -> Any:
    """Declare a message, as `@message` or `@message(version=2)`: the class becomes a frozen dataclass with slots.

    Its schema name begins with the top-level package of its module, as `navloom_people.Tracks`, so that two
    distributions may have messages of the same name. For a script, it is the name by which it would be imported.

    Float fields accept any real number and hold a finite float. Arrays are checked for element type, shape and NaN and
    held read-only; an array that could still be written is copied. Classes with array fields compare by identity, the
    others by value.

    Args:
        version: Of the schema; raise it with any change of the fields.
        now: The class declares an older version of this message. Its method `upgraded` returns the present one, which
            can be read by the older field names too. Bytes of the older version then decode as the present one.

    Raises:
        TypeError: A field of no known kind, a version below 1, a name that another message has, or an older version
            that is not older or cannot be upgraded.
    """
    if isinstance(version, type):
        return message()(version)
    if type(version) is not int or version < 1:
        raise TypeError(f"@message({version!r}): expected a version, a whole number from 1")

    def declare(cls: type[M]) -> type[M]:
        if not issubclass(cls, Message):
            raise TypeError(f"@message: {cls.__name__} is no message: `class {cls.__name__}(Message)`")
        _refuse_bad_names(cls)
        hints = get_type_hints(cls, include_extras=True)
        kinds = {name: kind_of(hints[name]) for name in cls.__annotations__}
        by_identity = any(holds_array(kind) for kind in kinds.values())
        # Arrays have no single truth value: `==` of such messages would raise.
        made = dataclass(frozen=True, slots=True, init=False, eq=not by_identity)(cls)
        made.schema_name = f"{_package_of(cls.__module__)}.{cls.__name__}" if now is None else now.schema_name
        made.schema_version = version
        made.kinds = kinds
        made.read_fields = _reader(list(kinds))
        made.__init__ = _constructor(made, kinds)  # type: ignore[method-assign]
        if now is not None:
            _refuse_bad_older(made, now)
            OLDER[f"{now.schema_name}/{version}"] = made
            return made
        other = SCHEMAS.setdefault(made.schema_name, made)
        # A module may be loaded again, or run as a script: the same class of the same file is no conflict.
        if (_file_of(other), other.__qualname__) != (_file_of(made), made.__qualname__):
            raise TypeError(f"message {made.schema_name} is declared in {other.__module__} already: rename this one")
        SCHEMAS[made.schema_name] = made
        return made

    return declare


def _refuse_bad_older(older: type[Message], now: type[Message]) -> None:
    if older.schema_version >= now.schema_version or not hasattr(older, "upgraded"):
        wanted = f"a version below {now.schema_version} and a method `upgraded`"
        raise TypeError(f"message {older.__name__}, an older {now.__name__}: expected {wanted}")
    for name in older.kinds:
        if not hasattr(now, name):
            raise TypeError(f"message {now.__name__}: version {older.schema_version} has {name!r}: give it a property")


def in_version(message: Message, label: str) -> Message:
    """A message as the version of a label had it; itself if it has that version, or that version is unknown here."""
    older = OLDER.get(label)
    if older is None or older.schema_name != message.schema_name:
        return message
    return older(*[getattr(message, name) for name in older.kinds])


def older_names(message: Message) -> list[str]:
    """Names of the fields that older versions of a message had, which can still be read."""
    return [name for older in OLDER.values() if older.schema_name == message.schema_name for name in older.kinds]


def _package_of(module: str) -> str:
    """Top-level package of a module, by its name."""
    if module in ("__main__", "__mp_main__"):
        main = sys.modules.get(module)
        spec, file = getattr(main, "__spec__", None), getattr(main, "__file__", None)
        module = spec.name if spec is not None else Path(file).stem if file else "__main__"
    return re.sub(r"\W", "_", module.partition(".")[0])


def _file_of(cls: type[Message]) -> str:
    """File that declares a message: a script may also be imported, under another name."""
    return getattr(sys.modules.get(cls.__module__), "__file__", None) or cls.__module__


def _refuse_bad_names(cls: type[Message]) -> None:
    if any(base.kinds for base in cls.__mro__[1:] if issubclass(base, Message)):
        raise TypeError(f"message {cls.__name__} inherits fields: name all of them, from Message directly")
    for name in cls.__annotations__:
        if name in Message.__annotations__ or name.startswith("_"):
            raise TypeError(f"message {cls.__name__}: a field cannot be called {name!r}")


def _reader(names: list[str]) -> Callable[[Any], tuple[Any, ...]]:
    if len(names) > 1:
        get = attrgetter(*names)
        return lambda self: get(self)
    return lambda self: tuple([getattr(self, name) for name in names])


# Compared with the bound instead of infinity, a range costs nothing; so messages of the framework need no second
# constructor without checks.
_FITS = {
    "float": "{0}.__class__ is float and -_inf < {0} < _inf",
    "int": "{0}.__class__ is int and -0x8000000000000000 <= {0} <= 0x7fffffffffffffff",
    "bool": "({0} is True or {0} is False)",
    "str": "{0}.__class__ is str and {0}.isascii() and len({0}) <= {most}",
    "message": "{0}.__class__ is _class_{0}",
    "tuple": "{0}.__class__ is tuple and not {0}",
}
"""Conditions under which a value is accepted without calling its check."""

_FITS_RULE = {
    "heading": "{0}.__class__ is float and -_pi <= {0} <= _pi",
    "positive": "{0}.__class__ is float and 0.0 < {0} < _inf",
    "not_negative": "{0}.__class__ is float and 0.0 <= {0} < _inf",
    "stamp": "{0}.__class__ is int and 0 <= {0} <= 0x7fffffffffffffff",
}
"""The same for a number with a rule."""


def _constructor(cls: type[Message], kinds: dict[str, Kind]) -> Callable[..., None]:
    """A generated `__init__` that checks each field inline: three times faster than calling the checks.

    The source is made from the declaration alone, without any received or configured text.
    """
    given: list[str] = []
    lines = []
    sizes = "None"
    if any(kind.form == "array" for kind in kinds.values()):
        lines.append("    _sizes = {}")
        sizes = "_sizes"
    names: dict[str, Any] = {"_inf": math.inf, "_pi": math.pi}
    declared: dict[str, Field[Any]] = {f.name: f for f in fields(cls)}  # type: ignore[arg-type]
    for name, kind in kinds.items():
        if declared[name].default_factory is not MISSING:
            raise TypeError(f"message {cls.__name__}: {name} has a default factory; give a value")
        has_default = declared[name].default is not MISSING
        given.append(f"{name}=_default_{name}" if has_default else name)
        names |= {
            f"_default_{name}": declared[name].default,
            f"_check_{name}": checker(cls.__name__, kind),
            f"_set_{name}": cls.__dict__[name].__set__,
            f"_class_{name}": kind.message,
            f"_choices_{name}": frozenset(kind.choices),
        }
        lines += [
            f"    {_unless_it_fits(name, kind)}{name} = _check_{name}({name!r}, {name}, {sizes})",
            f"    _set_{name}(self, {name})",
        ]
    source = "\n".join([f"def __init__(self, {', '.join(given)}):", *lines, "    return"])
    # The file name in brackets shows in tracebacks.
    exec(compile(source, f"<message {cls.__name__}>", "exec"), names)
    made: Callable[..., None] = names["__init__"]
    made.__qualname__ = f"{cls.__qualname__}.__init__"
    made.__annotations__ = inspect.get_annotations(cls) | {"return": None}
    return made


def _unless_it_fits(name: str, kind: Kind) -> str:
    """Source of the condition under which the check of a field must be called; empty for always."""
    if kind.form == "array":
        return f"if {name} is not None: " if kind.optional else ""
    fits = (_FITS_RULE[kind.rule] if kind.rule else _FITS[kind.form]).format(name, most=kind.most)
    if kind.infinite:
        fits = f"{name}.__class__ is float and -_inf < {name} <= _inf"
    if kind.choices:
        fits = f"{name}.__class__ is str and {name} in _choices_{name}"
    return f"if not ({f'{name} is None or ' if kind.optional else ''}{fits}): "

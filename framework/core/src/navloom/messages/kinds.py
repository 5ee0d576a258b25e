"""Kinds of message fields, read from their annotations when the class is declared."""

from __future__ import annotations

import reprlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from types import UnionType
from typing import Annotated, Any, ClassVar, Literal, Union, get_args, get_origin

import numpy as np

from navloom.errors import NavloomError

__all__ = ["DTYPES", "MAX_ARRAYS", "MAX_ITEMS", "MAX_TEXT", "RULES", "Array", "Heading", "Kind", "Message",
           "MessageError", "Most", "Name", "NotNegative", "Positive", "Stamp", "Unbounded", "Words", "brief",
           "holds_array", "kind_of", "typed"]  # fmt: skip

DTYPES = {name: np.dtype(name) for name in ("<f8", "<f4", "<i8", "<i4", "|i1", "|u1", "|b1")}
"""Element types of arrays, by their name on the wire."""

MAX_ARRAYS = 256
"""Most arrays of a message."""

MAX_ITEMS = 4096
"""Most items of a tuple field whose declaration sets no other bound with `Most`."""

MAX_TEXT = 1024
"""Most bytes of a text field whose declaration sets no other bound with `Most`."""


class MessageError(NavloomError, ValueError):
    """A field does not fit its declaration. The text names the field, what was given and what was expected."""


@dataclass(frozen=True)
class Array:
    """Shape and element type of an array field.

    Attributes:
        dtype: Element type by numpy name.
        shape: Sizes; a name means any size, but the same size in every field of the message that uses it.
        infinite: `+inf` is allowed (no echo). NaN and `-inf` never are.
        at_least, at_most: Smallest and largest element allowed, or None.
        may_be_empty: An array without elements is allowed.
    """

    dtype: str
    shape: tuple[int | str, ...]
    infinite: bool = False
    at_least: float | None = None
    at_most: float | None = None
    may_be_empty: bool = True


@dataclass(frozen=True)
class Most:
    """Bound of a text field, bytes of UTF-8, or of a tuple field, items: `Annotated[tuple[Point2D, ...], Most(16)]`.

    Of a Literal it is the room for later choices, so that a longer one does not change the limit of the header.
    """

    count: int


Name = Annotated[str, Most(255)]
"""A name: of a role, an instance, a port."""

Words = Annotated[str, "words"]
"""Text for people. A text beyond the bound is cut, so that its message is not lost."""

Unbounded = Annotated[float, "infinite"]
"""A float that may be `+inf` (the clearance in an empty world); never NaN or `-inf`."""

Heading = Annotated[float, "heading"]
"""A direction, rad, in [-π, π]. A value up to 1e-9 beyond is wrapped; others are refused."""

Positive = Annotated[float, "positive"]
"""A finite float above 0."""

NotNegative = Annotated[float, "not_negative"]
"""A finite float of at least 0."""

Stamp = Annotated[int, "stamp"]
"""A time on the run clock, ns, of at least 0."""

RULES = {"heading": float, "positive": float, "not_negative": float, "stamp": int}
"""Rules for a number field in addition to its type, each with that type."""


@dataclass(frozen=True)
class Kind:
    """What one field may hold, resolved from its annotation.

    Attributes:
        form: "float", "int", "bool", "str", "array", "message" or "tuple".
        optional: None is allowed.
        array: Declaration of an array field.
        choices: Allowed strings of a Literal field; empty for any.
        item: Kind of a tuple's items.
        message: Class of a nested message.
        infinite: A float that may be infinite.
        rule: The rule for a number, one of RULES; empty for none.
        most: Most items of a tuple, or most bytes of a text; 0 for a Literal without `Most`.
        is_cut: A longer text is cut; otherwise it is refused.
    """

    form: str
    optional: bool = False
    array: Array | None = None
    choices: tuple[str, ...] = ()
    item: Kind | None = None
    message: type[Message] | None = None
    infinite: bool = False
    rule: str = ""
    most: int = 0
    is_cut: bool = False


class Message:
    """Base of all messages. Declare a message with the `message` decorator."""

    __slots__ = ()
    schema_name: ClassVar[str] = ""
    schema_version: ClassVar[int] = 0
    kinds: ClassVar[dict[str, Kind]] = {}
    read_fields: ClassVar[Callable[[Any], tuple[Any, ...]]]

    def __reduce__(self) -> tuple[Any, ...]:
        # Through the constructor, so that an unpickled copy is checked and its arrays are read-only too.
        return type(self), self.read_fields()


def kind_of(hint: Any) -> Kind:
    """The kind of an annotation.

    Raises:
        TypeError: A message field cannot have this annotation.
    """
    origin, args = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType):
        inner = [arg for arg in args if arg is not type(None)]
        if len(inner) == 1:
            return Kind(**{**kind_of(inner[0]).__dict__, "optional": True})
    elif origin is Annotated:
        return _marked(*args[:2])
    elif origin is Literal:
        if all(type(choice) is str for choice in args):
            return Kind("str", choices=args)
    elif origin is tuple:
        if len(args) == 2 and args[1] is Ellipsis:
            return Kind("tuple", item=kind_of(args[0]), most=MAX_ITEMS)
    elif isinstance(hint, type) and issubclass(hint, Message):
        return Kind("message", message=hint)
    elif hint in (float, int, bool, str):
        return Kind(hint.__name__, most=MAX_TEXT if hint is str else 0)
    raise TypeError(f"a message field cannot be annotated {hint!r}")


def _marked(base: Any, mark: Any) -> Kind:
    """The kind of `Annotated[base, mark]`."""
    if isinstance(mark, Array):
        if np.dtype(mark.dtype).str not in DTYPES:
            raise TypeError(f"a message field cannot be annotated {mark!r}")
        return Kind("array", array=mark)
    kind = kind_of(base)
    if isinstance(mark, Most) and (kind.most or kind.choices):
        return replace(kind, most=mark.count)
    if mark == "words" and base is str:
        return replace(kind, is_cut=True)
    if mark == "infinite" and base is float:
        return replace(kind, infinite=True)
    return replace(kind, rule=mark) if isinstance(mark, str) and RULES.get(mark) is base else kind


def holds_array(kind: Kind) -> bool:
    """Whether there is an array in a field of this kind, at any depth."""
    if kind.form == "array":
        return True
    if kind.message is not None:
        return any(holds_array(inner) for inner in kind.message.kinds.values())
    return kind.item is not None and holds_array(kind.item)


_REPR = reprlib.Repr()
# A value from the network may be deep and long, and an error is one line.
_REPR.maxlevel = 2
_REPR.maxstring = _REPR.maxother = 80


def brief(value: Any) -> str:
    """A short representation of any value for an error text; never raises."""
    try:
        return _REPR.repr(value)
    except (ValueError, RecursionError):  # a number of thousands of digits
        return f"a {type(value).__name__}"


def typed(kind: Kind) -> str:
    """Type of a field in words."""
    if kind.array is not None:
        shape = ", ".join(map(str, kind.array.shape))
        text = f"array of {kind.array.dtype}, shape ({shape})"
        text += ", +inf allowed" if kind.array.infinite else ""
    elif kind.message is not None:
        text = kind.message.schema_name
    elif kind.item is not None:
        text = f"list of {typed(kind.item)}"
    elif kind.choices:
        text = "one of " + ", ".join(map(repr, kind.choices))
    else:
        text = f"{kind.form}, +inf allowed" if kind.infinite else kind.form
    return f"{text} or null" if kind.optional else text

"""Checks of message fields: each takes a value and returns it as the message will hold it.

The constructor generated in `schema` accepts values that already fit without a call, so most of these checks see only
arrays, tuples and values that need conversion.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navloom.messages.kinds import Array, Kind, MessageError, brief

__all__ = ["Check", "checker"]

Check = Callable[[str, Any, dict[str, int]], Any]
"""(name of the field, given value, sizes found so far in the message) -> value to hold."""


def checker(cls: str, kind: Kind) -> Check:
    """The function that checks and normalises a value of this kind; `cls` is the class name for errors."""
    check = _CHECKERS[kind.form](cls, kind)
    if not kind.optional:
        return check
    return lambda name, value, sizes: None if value is None else check(name, value, sizes)


def _float_checker(cls: str, kind: Kind) -> Check:
    wanted = "a number or +inf" if kind.infinite else "a finite number"
    held = _HELD_TO.get(kind.rule)

    def check(name: str, value: Any, sizes: dict[str, int]) -> float:
        # A bool is a number in Python, but not in a message.
        if not isinstance(value, Real) or isinstance(value, bool):
            raise MessageError(f"{cls}.{name}: got {brief(value)}, expected a number")
        try:
            number = float(value)
        except OverflowError:
            raise MessageError(f"{cls}.{name}: got {brief(value)}, expected a number below 1.8e308") from None
        if not math.isfinite(number) and not (kind.infinite and number == math.inf):
            raise MessageError(f"{cls}.{name}: got {number}, expected {wanted}")
        return number if held is None else held(f"{cls}.{name}", number)

    return check


def _int_checker(cls: str, kind: Kind) -> Check:
    def check(name: str, value: Any, sizes: dict[str, int]) -> int:
        if not isinstance(value, (int, np.integer)) or isinstance(value, bool):
            raise MessageError(f"{cls}.{name}: got {brief(value)}, expected int")
        number = int(value)
        # MessagePack and other languages have no longer integers.
        if not -(2**63) <= number < 2**63:
            raise MessageError(f"{cls}.{name}: got {brief(number)}, expected a signed 64-bit number")
        if kind.rule == "stamp" and number < 0:
            raise MessageError(f"{cls}.{name}: got {number}, expected a run clock in ns, at least 0")
        return number

    return check


def _heading(place: str, angle: float) -> float:
    """A heading in [-π, π]; a value beyond it by rounding alone is wrapped."""
    if -math.pi <= angle <= math.pi:
        return angle
    if abs(angle) <= math.pi + _ROUNDING:
        return angle - math.copysign(math.tau, angle)
    # More than two turns: nobody means radians.
    hint = f"degrees? math.radians({angle:g}) is {math.radians(angle):.4g}" if abs(angle) > 2.0 * math.tau else ""
    raise MessageError(
        f"{place}: got {angle}, expected rad in [-π, π]; {hint or 'wrap it: math.remainder(heading, math.tau)'}"
    )


def _positive(place: str, number: float) -> float:
    # Written so that NaN is refused too.
    if not number > 0.0:
        raise MessageError(f"{place}: got {number}, expected a number above 0")
    return number


def _not_negative(place: str, number: float) -> float:
    if not number >= 0.0:
        raise MessageError(f"{place}: got {number}, expected a number of at least 0")
    return number


_ROUNDING = 1e-9
"""Largest excess over ±π that counts as rounding, rad."""

_HELD_TO = {"heading": _heading, "positive": _positive, "not_negative": _not_negative}


def _bool_checker(cls: str, kind: Kind) -> Check:
    def check(name: str, value: Any, sizes: dict[str, int]) -> bool:
        if not isinstance(value, (bool, np.bool_)):
            raise MessageError(f"{cls}.{name}: got {brief(value)}, expected bool")
        return bool(value)

    return check


def _str_checker(cls: str, kind: Kind) -> Check:
    def check(name: str, value: Any, sizes: dict[str, int]) -> str:
        if not isinstance(value, str):
            raise MessageError(f"{cls}.{name}: got {brief(value)}, expected str")
        text = str(value)
        if kind.choices and text not in kind.choices:
            raise MessageError(f"{cls}.{name}: got {brief(text)}, expected one of {', '.join(kind.choices)}")
        try:
            # The bound is in bytes, as on the wire.
            size = len(text.encode())
        except UnicodeEncodeError:
            raise MessageError(f"{cls}.{name}: got {brief(text)}, expected text without lone surrogates") from None
        if size <= kind.most or kind.choices:
            return text
        if not kind.is_cut:
            raise MessageError(f"{cls}.{name}: got a text of {size} bytes, expected at most {kind.most}")
        # Cut in bytes, where the last character may be cut in half.
        return text.encode()[: kind.most - len(_CUT.encode())].decode(errors="ignore") + _CUT

    return check


_CUT = "…"
"""End of a text that was cut."""


def _message_checker(cls: str, kind: Kind) -> Check:
    wanted = kind.message
    assert wanted is not None

    def check(name: str, value: Any, sizes: dict[str, int]) -> Any:
        if not isinstance(value, wanted):
            raise MessageError(f"{cls}.{name}: got {type(value).__name__}, expected {wanted.__name__}")
        return value

    return check


def _tuple_checker(cls: str, kind: Kind) -> Check:
    assert kind.item is not None
    item, is_text = checker(cls, kind.item), kind.item.form == "str"
    # The last tuple of text is recognised by identity: the names of what moves are checked once, not in each tick.
    known: list[tuple[Any, ...]] = [()]

    def check(name: str, value: Any, sizes: dict[str, int]) -> Any:
        if value is known[0]:
            return value
        if not isinstance(value, (tuple, list)):
            raise MessageError(f"{cls}.{name}: got {type(value).__name__}, expected a tuple")
        if len(value) > kind.most:
            raise MessageError(f"{cls}.{name}: got {len(value)} items, expected at most {kind.most}; use an array")
        found = tuple([item(f"{name}[{i}]", entry, {}) for i, entry in enumerate(value)])
        if is_text and type(value) is tuple and all(a is b for a, b in zip(found, value, strict=True)):
            known[0] = found = value
        return found

    return check


def _array_checker(cls: str, kind: Kind) -> Check:
    spec = kind.array
    assert spec is not None
    dtype = np.dtype(spec.dtype)
    named, dimensions = tuple(enumerate(spec.shape)), len(spec.shape)
    refuse = _contents_check(spec)
    # The last two immutable arrays are recognised by identity: a sensor's bearings are checked once, not in each tick.
    known: list[NDArray[Any] | None] = [None, None]
    first_size = spec.shape[0] if dimensions and isinstance(spec.shape[0], str) else ""
    is_sized_by_first = bool(first_size) and not any(isinstance(size, str) for size in spec.shape[1:])

    def check(name: str, value: Any, sizes: dict[str, int]) -> NDArray[Any]:
        if value is not None and (value is known[0] or value is known[1]):
            # Its shape was compared before; only sizes shared with other fields are left to check.
            if not is_sized_by_first or sizes.setdefault(first_size, len(value)) != len(value):
                compare_sizes(name, value.shape, sizes)
            return value  # type: ignore[no-any-return]
        if type(value) is not np.ndarray or value.dtype != dtype or value.ndim != dimensions:
            raise MessageError(f"{cls}.{name}: got {_describe(value)}, expected {spec.dtype} of shape {spec.shape}")
        compare_sizes(name, value.shape, sizes)
        if not value.size and not spec.may_be_empty:
            raise MessageError(f"{cls}.{name}: got shape {value.shape}, expected at least one element")
        held: NDArray[Any] = value
        if not _is_frozen(held):
            # Whoever passes a writable array may change it later, and messages are immutable.
            held = held.copy()
            held.flags.writeable = False
        if refuse is not None and held.size:
            refuse(cls, name, spec, held)
        if held is value and held.size <= _BY_DOT:
            known[1], known[0] = known[0], held
        return held

    def compare_sizes(name: str, shape: tuple[int, ...], sizes: dict[str, int]) -> None:
        if shape == spec.shape:
            return
        for axis, size in named:
            wanted = sizes.setdefault(size, shape[axis]) if isinstance(size, str) else size
            if shape[axis] != wanted:
                raise MessageError(f"{cls}.{name}: got shape {shape}, expected {spec.shape}, with {size} = {wanted}")

    return check


def _is_frozen(value: NDArray[Any]) -> bool:
    """Whether the elements are immutable, here and through every array or buffer that this is a view of."""
    flags = value.flags
    if flags.writeable or not flags.c_contiguous:
        return False
    # A read-only view of a writable array changes with it.
    base: object = value.base
    while type(base) is np.ndarray:
        if base.flags.writeable:
            return False
        base = base.base
    return base is None or type(base) is bytes or (type(base) is memoryview and base.readonly)


_BY_DOT = 4096
"""Largest array, in elements, that is checked by a dot product, which is fastest; beyond it BLAS may start threads."""


_BY_SUM = 64
"""Largest array, in elements, for which a sum in Python is faster than a call of numpy."""


def _contents_check(spec: Array) -> Callable[[str, str, Array, NDArray[Any]], None] | None:
    """A function that checks the values of a non-empty array of the declared type and shape; None if all values fit.

    It takes class name, field, declaration and array, and raises MessageError.
    """
    if np.dtype(spec.dtype).kind == "f":
        return _refuse_bad_numbers
    return None if spec.at_least is None and spec.at_most is None else _refuse_beyond


def _is_plainly_fine(numbers: list[float], spec: Array) -> bool:
    """Whether a sum proves that there is no NaN or forbidden infinity; False means that it is not decided."""
    total = sum(numbers)
    if spec.at_least is not None and not min(numbers) >= spec.at_least:
        return False
    return -math.inf < total < math.inf or (spec.infinite and total == math.inf)


def _refuse_bad_numbers(cls: str, name: str, spec: Array, value: NDArray[Any]) -> None:
    """Refuse NaN, infinity unless the field allows +inf, and values below the smallest allowed one."""
    flat = value.ravel()  # a view: arrays are contiguous here
    if flat.size <= _BY_SUM and _is_plainly_fine(flat.tolist(), spec):
        return
    # argmin finds the smallest value or a NaN. After a wake-up it takes 5 µs, a ufunc with its larger code 11 µs.
    if spec.at_least is not None and not flat.item(flat.argmin()) >= spec.at_least:
        bad = flat[~(flat >= spec.at_least)][0]
        raise MessageError(f"{cls}.{name}: holds {bad}, expected values >= {spec.at_least:g}, without NaN")
    if spec.infinite:
        if spec.at_least is None and not (flat > -math.inf).all():
            raise MessageError(f"{cls}.{name}: holds NaN or -inf, expected numbers or +inf")
    elif flat.size > _BY_DOT or not math.isfinite(np.vdot(flat, flat)):  # squares may overflow: then check each
        finite = np.isfinite(flat)
        if not finite.all():
            raise MessageError(f"{cls}.{name}: holds {flat[~finite][0]}, expected finite numbers")


def _refuse_beyond(cls: str, name: str, spec: Array, value: NDArray[Any]) -> None:
    """Refuse integers below the smallest or above the largest allowed value."""
    least = -math.inf if spec.at_least is None else spec.at_least
    most = math.inf if spec.at_most is None else spec.at_most
    for bad in (value.item(value.argmin()), value.item(value.argmax())):
        if not least <= bad <= most:
            raise MessageError(f"{cls}.{name}: holds {bad}, expected values from {least:g} to {most:g}")


def _describe(value: Any) -> str:
    return f"{value.dtype} of shape {value.shape}" if isinstance(value, np.ndarray) else type(value).__name__


_CHECKERS: dict[str, Callable[[str, Kind], Check]] = {
    "float": _float_checker,
    "int": _int_checker,
    "bool": _bool_checker,
    "str": _str_checker,
    "message": _message_checker,
    "tuple": _tuple_checker,
    "array": _array_checker,
}

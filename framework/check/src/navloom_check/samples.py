"""Messages of any class, generated from its declaration, for inputs that a plugin declares itself."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
from navloom.messages import Message
from navloom.messages.kinds import Array, Kind

__all__ = ["sample"]

M = TypeVar("M", bound=Message)


def sample(cls: type[M], rng: np.random.Generator, stamp_ns: int = 0) -> M:
    """A message whose fields hold ordinary values within their declared bounds.

    Args:
        cls: Class of the message.
        rng: Source of the values.
        stamp_ns: Value of its fields of the kind `Stamp`, ns.
    """
    sizes: dict[str, int] = {}
    return cls(*(_value(kind, rng, stamp_ns, sizes) for kind in cls.kinds.values()))


def _value(kind: Kind, rng: np.random.Generator, stamp_ns: int, sizes: dict[str, int]) -> Any:
    if kind.optional and rng.random() < 0.25:
        return None
    if kind.choices:
        return kind.choices[int(rng.integers(len(kind.choices)))]
    if kind.form == "float":
        return _number(kind.rule, rng)
    if kind.form == "int":
        return stamp_ns if kind.rule == "stamp" else int(rng.integers(0, 100))
    if kind.form == "bool":
        return bool(rng.integers(2))
    if kind.form == "str":
        return "sample"[: kind.most or None]
    if kind.form == "message":
        assert kind.message is not None
        return sample(kind.message, rng, stamp_ns)
    if kind.form == "tuple":
        assert kind.item is not None
        return tuple(_value(kind.item, rng, stamp_ns, {}) for _ in range(min(kind.most, int(rng.integers(0, 4)))))
    assert kind.array is not None
    return _array(kind.array, rng, sizes)


def _number(rule: str, rng: np.random.Generator) -> float:
    if rule == "heading":
        return float(rng.uniform(-3.0, 3.0))
    return float(rng.uniform(0.1, 2.0)) if rule in ("positive", "not_negative") else float(rng.normal())


def _array(spec: Array, rng: np.random.Generator, sizes: dict[str, int]) -> Any:
    shape = [size if isinstance(size, int) else sizes.setdefault(size, int(rng.integers(2, 6))) for size in spec.shape]
    dtype = np.dtype(spec.dtype)
    low = 0.0 if spec.at_least is None else spec.at_least
    high = low + 2.0 if spec.at_most is None else spec.at_most
    if dtype.kind == "b":
        return rng.integers(2, size=shape).astype(dtype)
    values = rng.uniform(low, high, shape)
    return (np.round(values) if dtype.kind in "iu" else values).astype(dtype)

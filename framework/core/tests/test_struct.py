"""Structs of roles: frozen dataclasses whose constructor sets the slots itself."""

from __future__ import annotations

import pickle
from dataclasses import FrozenInstanceError, field, replace

import pytest
from navloom.roles.struct import struct


@struct
class Asked:
    """The input of a verb."""

    stamp_ns: int
    names: tuple[str, ...]
    share: float = 1.0


def test_fields_are_taken_in_order_or_by_name_with_defaults() -> None:
    assert Asked(3, ("a",)) == Asked(names=("a",), stamp_ns=3, share=1.0)


def test_a_field_cannot_be_set_again() -> None:
    asked = Asked(3, ())
    with pytest.raises(FrozenInstanceError):
        asked.share = 0.5  # type: ignore[misc]


def test_it_is_copied_replaced_and_printed_as_any_dataclass() -> None:
    asked = Asked(3, ("a",), 0.5)
    assert pickle.loads(pickle.dumps(asked)) == asked
    assert replace(asked, stamp_ns=4) == Asked(4, ("a",), 0.5)
    assert repr(asked).endswith("Asked(stamp_ns=3, names=('a',), share=0.5)")


def test_a_field_that_is_missing_is_named() -> None:
    with pytest.raises(TypeError, match="names"):
        Asked(3)  # type: ignore[call-arg]


def test_a_default_factory_is_refused() -> None:
    with pytest.raises(TypeError, match="names has a default factory; give a value"):

        @struct
        class Wrong:
            names: list[str] = field(default_factory=list)

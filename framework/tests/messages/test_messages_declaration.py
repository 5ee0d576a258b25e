"""What a message class may be declared with."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import field
from typing import Annotated, Any, Literal

import numpy as np
import pytest
from navloom.messages import SCHEMAS, Array, Message, MessageError, Point2D, message


@pytest.fixture(autouse=True)
def _forget_declared() -> Iterator[None]:
    before = dict(SCHEMAS)
    yield
    SCHEMAS.clear()
    SCHEMAS.update(before)


def test_defaults_are_used_and_checked() -> None:
    @message()
    class Named(Message):
        value: float
        name: Literal["a", "b"] = "b"

    assert Named(1.0).name == "b" and Named(1.0, "a").name == "a"
    with pytest.raises(MessageError, match=r"Named\.name"):
        Named(1.0, "c")  # type: ignore[arg-type]


def test_the_name_of_another_message_is_refused_and_the_first_one_stays() -> None:
    first = SCHEMAS["navloom.Path"]
    with pytest.raises(TypeError, match=r"navloom\.Path is declared in navloom\.messages\.mapping already"):
        declare("Path", {"x": float})
    assert SCHEMAS["navloom.Path"] is first


@pytest.mark.parametrize(
    "hint",
    [
        bytes,
        complex,
        dict[str, int],
        list[int],
        tuple[float, float],
        float | int,
        float | int | None,
        Literal[1, 2],
        Annotated[np.ndarray, Array("uint16", ("n",))],
        Annotated[np.ndarray, Array("object", ("n",))],
    ],
    ids=str,
)
def test_an_annotation_the_codec_cannot_carry_is_refused_at_declaration(hint: Any) -> None:
    with pytest.raises(TypeError, match="a message field cannot be annotated"):
        declare("Odd", {"value": hint})
    assert "navloom.Odd" not in SCHEMAS


@pytest.mark.parametrize("name", ["kinds", "schema_name", "read_fields", "_hidden"])
def test_a_field_name_that_would_hide_a_part_of_the_class_is_refused(name: str) -> None:
    with pytest.raises(TypeError, match=f"a field cannot be called '{name}'"):
        declare("Odd", {name: float})


def test_inherited_fields_and_default_factories_are_refused() -> None:
    with pytest.raises(TypeError, match="inherits fields"):

        @message()
        class Further(Point2D):
            z: float

    with pytest.raises(TypeError, match="default factory"):

        @message()
        class Made(Message):
            names: tuple[str, ...] = field(default_factory=tuple)


def declare(name: str, hints: dict[str, Any]) -> type[Message]:
    return message()(type(name, (Message,), {"__annotations__": hints, "__module__": __name__}))

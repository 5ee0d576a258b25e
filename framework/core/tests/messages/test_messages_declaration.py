"""Declarations of message classes, valid and refused."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from dataclasses import field
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pytest
from navloom.messages import SCHEMAS, Array, Message, MessageError, Point2D, message
from navloom.messages.codec import schema_label

HERE = __name__.partition(".")[0]


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


def test_a_message_is_declared_with_and_without_brackets() -> None:
    @message
    class Bare(Message):
        value: float

    @message(version=3)
    class Third(Message):
        value: float

    assert (schema_label(Bare), schema_label(Third)) == (f"{HERE}.Bare/1", f"{HERE}.Third/3")
    assert Bare(1).value == 1.0 and isinstance(Bare, type)
    for wrong in ("2", 0, True, None):
        with pytest.raises(TypeError, match=rf"@message\({wrong!r}\): expected a version, a whole number from 1"):
            message(wrong)  # type: ignore[call-overload]
    with pytest.raises(TypeError, match="@message: Plain is no message: `class Plain\\(Message\\)`"):
        message(type("Plain", (), {}))


def test_a_message_is_named_after_the_package_that_declares_it() -> None:
    first = SCHEMAS["navloom.Path"]
    made = declare("Path", {"x": float})
    assert made.schema_name == f"{HERE}.Path" and SCHEMAS["navloom.Path"] is first and SCHEMAS[f"{HERE}.Path"] is made


def test_the_name_of_another_message_of_the_package_is_refused_and_the_first_one_stays() -> None:
    first = declare("Path", {"x": float})
    with pytest.raises(TypeError, match=rf"{HERE}\.Path is declared in {__name__} already"):

        @message
        class Path(Message):
            x: float

    assert SCHEMAS[f"{HERE}.Path"] is first


SCRIPT = """
from navloom.messages import Message, message

@message
class Beacons(Message):
    count: int

print(Beacons.schema_name)
if __name__ == "__main__":
    import my_beacons  # as an entry point would
"""


def test_a_scripts_messages_are_named_as_if_it_were_imported(tmp_path: Path) -> None:
    (tmp_path / "my_beacons.py").write_text(SCRIPT, "utf-8")
    for words in (["my_beacons.py"], ["-m", "my_beacons"]):
        done = subprocess.run([sys.executable, *words], cwd=tmp_path, capture_output=True, text=True, timeout=60)
        assert (done.stderr, done.stdout) == ("", "my_beacons.Beacons\nmy_beacons.Beacons\n")


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
    assert f"{HERE}.Odd" not in SCHEMAS


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

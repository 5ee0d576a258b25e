"""The message reference names every message, field, type and port: additions and renames must be written there."""

from __future__ import annotations

import re
from pathlib import Path
from typing import get_args

import navloom.messages
import pytest
from navloom.engine.catalogue import FRAMEWORK
from navloom.engine.node_ports import Wired
from navloom.engine.streams import sensor_port
from navloom.messages import SCHEMAS, Envelope, Message, RangeScan, ReasonCode
from navloom.messages.bounds import header_limit, size_limit
from navloom.messages.kinds import MAX_ITEMS, MAX_TEXT, Kind
from navloom.messages.stop_reasons import StopKind
from navloom_live.transport.quality_of_service import quality_of

PAGE = (Path(__file__).resolve().parents[1] / "docs" / "messages.md").read_text("utf-8")
CLASSES = sorted(
    (cls for cls in SCHEMAS.values() if cls.__module__.startswith(navloom.messages.__name__)), key=lambda c: c.__name__
)


def section(title: str) -> str:
    found = re.search(rf"^(#+) {re.escape(title)}\n(.*?)(?=^#|\Z)", PAGE, re.MULTILINE | re.DOTALL)
    assert found, f"docs/messages.md has no section {title!r}"
    return found.group(2)


def rows(title: str) -> list[list[str]]:
    """Cells of a section's table, without its two header lines."""
    lines = [line for line in section(title).splitlines() if line.startswith("|")]
    return [[cell.strip().strip("`") for cell in line.strip("|").split("|")] for line in lines[2:]]


RULES = {"": "", "heading": ", in [-π, π]", "positive": ", > 0", "not_negative": ", >= 0", "stamp": ", >= 0"}
"""Rule of a number -> how the page writes it."""
NAMED = {get_args(StopKind): "kind of stop", get_args(ReasonCode): "reason code"}
"""Enumerations that grow, and that `navloom messages` lists -> how the page calls them."""
BOUNDED = {MAX_TEXT: "str", 255: "name"}
"""Bound of a text, bytes -> its type as the page writes it."""


def written(kind: Kind) -> str:
    """A kind as the page writes it."""
    if kind.array is not None:
        text = f"{kind.array.dtype} ({', '.join(map(str, kind.array.shape))})"
        text += ", +inf allowed" if kind.array.infinite else ""
        text += "" if kind.array.at_least is None else f", >= {kind.array.at_least:g}"
        text += "" if kind.array.at_most is None else f", <= {kind.array.at_most:g}"
        text += "" if kind.array.may_be_empty else ", not empty"
    elif kind.message is not None:
        text = kind.message.__name__
    elif kind.item is not None:
        text = f"tuple of {written(kind.item)}" + (f", at most {kind.most}" if kind.most != MAX_ITEMS else "")
    elif kind.choices:
        text = NAMED.get(kind.choices) or " / ".join(choice or "empty" for choice in kind.choices)
    elif kind.form == "str":
        text = "words" if kind.is_cut else BOUNDED.get(kind.most) or f"str, at most {kind.most} bytes"
    else:
        text = kind.form + (", +inf allowed" if kind.infinite else "") + RULES[kind.rule]
    return f"{text} or None" if kind.optional else text


@pytest.mark.parametrize("cls", CLASSES, ids=lambda cls: cls.__name__)
def test_every_field_is_there_with_its_type_and_a_meaning(cls: type[Message]) -> None:
    table = rows(cls.__name__)
    assert [row[:2] for row in table] == [[name, written(kind)] for name, kind in cls.kinds.items()]
    assert all(len(row) == 3 and row[2] for row in table)


@pytest.mark.parametrize("cls", CLASSES, ids=lambda cls: cls.__name__)
def test_every_docstring_names_every_field(cls: type[Message]) -> None:
    """`navloom messages NAME` prints the docstring's text about each field."""
    assert [name for name in cls.kinds if not re.search(rf"\b{name}\b", cls.__doc__ or "")] == []


def test_the_page_names_no_message_that_does_not_exist() -> None:
    assert sorted(re.findall(r"^### (\w+)$", PAGE, re.MULTILINE)) == [cls.__name__ for cls in CLASSES]


def test_the_envelope_is_there_field_by_field() -> None:
    assert [row[0] for row in rows("Envelope")] == list(Envelope._fields)


def test_every_port_is_there_with_messages_that_exist() -> None:
    sensors = {"platform": [sensor_port("a sensor's name", RangeScan)]}
    ports = [(role, port.name) for role, node in FRAMEWORK.nodes.items() for port in node.ports(Wired(role, sensors))]
    table = rows("Keys")
    assert [(role, port) for role, port, _ in table] == ports
    names = {cls.__name__ for cls in CLASSES}
    assert all(set(messages.split(", ")) <= names for _, _, messages in table)


def test_the_form_of_a_key_is_there() -> None:
    assert "`<realm>/<robot>/<role>/<instance>/<port>`" in section("Keys")


def test_the_bound_of_every_message_is_there_and_a_command_is_small() -> None:
    bounds = [(cls.__name__, str(header_limit(cls)), str(size_limit(cls) or "arrays")) for cls in CLASSES]
    assert [tuple(row) for row in rows("How large a message is")] == bounds
    urgent = [cls for cls in CLASSES if quality_of(cls).priority == "real_time"]
    assert [cls.__name__ for cls in urgent] == ["Command", "TrackingCommand"]
    assert all((size_limit(cls) or 1 << 30) <= 704 for cls in urgent)

"""docs/messages.md is generated: docs/site/message_tables.py reads types, docstrings and limits of the messages."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from types import ModuleType

import navloom.messages
import pytest
from navloom.messages import SCHEMAS, Envelope, Message, Odometry
from navloom.messages.bounds import size_limit
from navloom_live.transport.quality_of_service import quality_of

DOCS = Path(__file__).resolve().parents[1] / "docs"
CLASSES = sorted(
    (cls for cls in SCHEMAS.values() if cls.__module__.startswith(navloom.messages.__name__)), key=lambda c: c.__name__
)


@pytest.fixture(scope="module")
def tables() -> ModuleType:
    """The module that makes the page, which the site's build imports from its own folder."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "path", [str(DOCS / "site"), *sys.path])
        import message_tables

        return message_tables


@pytest.mark.parametrize("cls", CLASSES, ids=lambda cls: cls.__name__)
def test_every_docstring_names_every_field(cls: type[Message]) -> None:
    """The page and `navloom messages NAME` show the docstring's text about each field."""
    from navloom.cli.describing.docstrings import meanings

    assert list(meanings(re.sub(r"\n    ", "\n", cls.__doc__ or ""))) == list(cls.kinds)


def test_the_page_has_a_place_for_every_generated_part(tables: ModuleType) -> None:
    named = re.findall(r"<!-- generated: (\w+) -->", (DOCS / "messages.md").read_text("utf-8"))
    assert sorted(named) == sorted(tables.PARTS)


def test_a_table_of_fields_has_types_units_and_frames(tables: ModuleType) -> None:
    lines = tables.field_table(Odometry).splitlines()
    assert lines[2] == "| `stamp_ns` | int, >= 0 | Run clock of the measurement. |"
    assert lines[3].startswith("| `pose` | [Pose2D](#pose2d) | Base in the odometry frame")


def test_every_message_is_on_the_page_once(tables: ModuleType) -> None:
    headings = re.findall(r"^### (\w+)$", tables.message_sections(), re.MULTILINE)
    assert sorted(headings) == [cls.__name__ for cls in CLASSES]


def test_a_message_that_no_section_lists_is_refused(tables: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(tables.GROUPS, "Poses and velocities", ("Point2D", "Pose2D"))
    with pytest.raises(ValueError, match=r"it differs by .'Twist2D'."):
        tables.message_sections()


def test_the_envelope_is_there_field_by_field(tables: ModuleType) -> None:
    rows = tables.envelope_table().splitlines()[2:]
    assert [row.split("`")[1] for row in rows] == list(Envelope._fields)


def test_the_form_of_a_key_is_there() -> None:
    assert "`<realm>/<robot>/<role>/<instance>/<port>`" in (DOCS / "messages.md").read_text("utf-8")


def test_an_urgent_message_is_small(tables: ModuleType) -> None:
    urgent = [cls for cls in CLASSES if quality_of(cls).priority == "real_time"]
    assert [cls.__name__ for cls in urgent] == ["Command", "TrackingCommand"]
    assert all((size_limit(cls) or 1 << 30) <= 704 for cls in urgent)
    assert "| Command | 634 | 640 |" in tables.size_table()

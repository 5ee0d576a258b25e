"""docs/architecture.md and decisions.md: the files that they name exist and contain the names that the text gives."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

TOP = Path(__file__).resolve().parents[1]
PARTS = [path for path in sorted(TOP.glob("framework/*/src/*")) if (path / "__init__.py").exists()]
"""Packages of the framework; a file is named from its package, or from the folder above."""
PAGES = [TOP / "docs" / name for name in ("architecture.md", "decisions.md")]
FILE = re.compile(r"`((?:[a-z_]+/)+[a-z_]+\.py)`")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_file_that_the_page_names_exists(page: Path) -> None:
    named = FILE.findall(page.read_text("utf-8"))
    assert len(named) > 5
    assert [name for name in named if file_of(name) is None and not (TOP / name).is_file()] == []


def file_of(name: str) -> Path | None:
    tops = [*PARTS, *(path.parent for path in PARTS), *TOP.glob("plugins/*/src"), *TOP.glob("plugins/*/src/*")]
    return next((top / name for top in tops if (top / name).is_file()), None)


def rows(title: str) -> list[str]:
    """Rows of the table after a line, without its head."""
    text = PAGES[0].read_text("utf-8").split(title, 1)[1]
    return [line for line in text[: text.index("\n## ")].splitlines() if line.startswith("|")][2:]


def test_each_row_from_a_question_to_code_names_code_that_exists() -> None:
    found = 0
    for row in rows("To find a line of code"):
        text = ""
        for name in re.findall(r"`([^`]+)`", row.split("|")[2]):
            if FILE.fullmatch(f"`{name}`"):
                path = file_of(name)
                assert path is not None, name
                text = path.read_text("utf-8")
            elif text and not name.startswith("["):  # a table of a config
                assert re.search(rf"(def|class) {name}\b|\b{name}:", text), f"{row}: {name}"
                found += 1
    assert found >= 25


def test_each_package_is_in_the_table() -> None:
    listed = set(re.findall(r"`(\w+)`", " ".join(rows("Another test checks"))))
    packages = {path.parent.name for part in PARTS for path in [*part.glob("__init__.py"), *part.glob("*/__init__.py")]}
    assert packages <= listed


def test_each_class_named_on_the_way_of_a_sweep_and_a_command_exists() -> None:
    text = PAGES[0].read_text("utf-8").split("**The way of a sweep**", 1)[1].split("**Every random number**", 1)[0]
    code = "".join(path.read_text("utf-8") for part in PARTS for path in part.rglob("*.py"))
    classes = set(re.findall(r"`([A-Z]\w+)", text))
    assert len(classes) > 12
    assert [name for name in sorted(classes) if f"class {name}" not in code] == []

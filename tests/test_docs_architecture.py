"""docs/architecture.md, lab/decisions.md, READMEs and docstrings of packages: what they name exists."""

from __future__ import annotations

import ast
import re
import runpy
import tomllib
from pathlib import Path

import pytest
from navloom.roles import ROLES

TOP = Path(__file__).resolve().parents[1]
PARTS = [path for path in sorted(TOP.glob("framework/*/src/*")) if (path / "__init__.py").exists()]
"""Packages of the framework; a file is named from its package, or from the folder above."""
PAGES = [TOP / "docs" / name for name in ("architecture.md", "lab/decisions.md")]
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


def test_each_module_in_the_table_of_the_live_packages_exists() -> None:
    live, listed = next(part for part in PARTS if part.name == "navloom_live"), []
    for row in rows("once per process. Readers in the publisher's process"):
        package, modules = row.split("|")[1:3]
        listed += [live / package.strip(" `") / f"{module}.py" for module in re.findall(r"`(\w+)`", modules)]
    assert len(listed) > 30
    assert [str(path.relative_to(live)) for path in listed if not path.is_file()] == []


def test_the_page_gives_the_layers_that_are_enforced() -> None:
    text = " ".join(PAGES[0].read_text("utf-8").split())
    for contract in tomllib.loads((TOP / "pyproject.toml").read_text("utf-8"))["tool"]["importlinter"]["contracts"]:
        if contract["name"].startswith("Houses"):
            layers = [layer.replace("navloom.", "").replace(" | ", ", ") for layer in contract["layers"]]
            assert f"`{' -> '.join(layers)}`" in text


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_each_attribute_of_a_class_that_the_page_names_exists(page: Path) -> None:
    code = "".join(path.read_text("utf-8") for part in PARTS for path in part.rglob("*.py"))
    named = re.findall(r"`([A-Z]\w+)\.(\w+)`", page.read_text("utf-8"))
    assert named
    assert [
        f"{cls}.{name}"
        for cls, name in named
        if f"class {cls}" not in code or not re.search(rf"def {name}\b|\b{name}:|self\.{name} =|\b{name} =", code)
    ] == []


def test_the_picture_of_the_nodes_is_what_its_script_draws() -> None:
    script = TOP / "docs" / "pictures" / "architecture.py"
    drawn = runpy.run_path(str(script))["picture"]()
    assert drawn == script.with_suffix(".svg").read_text("utf-8"), f"run: python {script.relative_to(TOP)}"
    assert all(f">{role}</text>" in drawn for role in ("platform", "operator", "gate", *ROLES))


def named_files(text: str) -> list[str]:
    return re.findall(r"`((?:\w+/)*\w+\.py)`", text)


@pytest.mark.parametrize("readme", sorted(TOP.glob("*/*/README.md")), ids=lambda path: path.parent.name)
def test_each_file_that_a_readme_names_exists(readme: Path) -> None:
    files = [f"/{path.relative_to(TOP)}" for path in [*readme.parent.rglob("*.py"), *TOP.glob("tests/*.py")]]
    named = named_files(readme.read_text("utf-8"))
    assert [name for name in named if not any(file.endswith(f"/{name}") for file in files)] == []


@pytest.mark.parametrize("part", PARTS, ids=lambda path: path.name)
def test_each_file_that_the_docstring_of_a_package_names_exists(part: Path) -> None:
    wrong = []
    for package in part.rglob("__init__.py"):
        docstring = ast.get_docstring(ast.parse(package.read_text("utf-8"))) or ""
        folders = (package.parent, part)
        wrong += [name for name in named_files(docstring) if not any((folder / name).is_file() for folder in folders)]
    assert wrong == []

"""Every block of the README and the docs runs, and what the README tells people to type works."""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path

import pytest
from navloom.cli import main
from navloom.config import load_config
from navloom.plugins import Registry
from navloom.runtime.build import assemble

TOP = Path(__file__).resolve().parents[1]
PAGES = [TOP / "README.md", *sorted((TOP / "docs").glob("*.md"))]


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text("utf-8"), re.MULTILINE | re.DOTALL)


def commands() -> list[list[str]]:
    """The navloom commands of each block of the README but the two set-up blocks; one may use what another left."""
    found = []
    for block in blocks(TOP / "README.md", "sh"):
        lines = [line.partition("#")[0].strip() for line in block.splitlines()]
        found.append([line.removeprefix("uv run navloom ") for line in lines if line.startswith("uv run navloom ")])
    return [lines for lines in found if lines]


def test_there_are_commands_to_check() -> None:
    assert sum(map(len, commands())) >= 8


@pytest.mark.parametrize("lines", commands(), ids=lambda lines: lines[0])
def test_the_commands_of_the_readme_succeed(
    lines: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for line in lines:
        monkeypatch.setattr(sys, "argv", ["navloom", *line.split()])
        with pytest.raises(SystemExit) as caught:
            main()
        assert not caught.value.code, (line, capsys.readouterr().err)


def test_the_two_set_up_commands_are_there() -> None:
    text = (TOP / "README.md").read_text("utf-8")
    for name in ("run", "test"):
        block = re.search(rf"<!-- {name} -->\n```sh\n(.*?)```", text, re.DOTALL)
        assert block is not None and block[1].startswith("python3 uv.py run "), name


def test_the_readmes_config_fits(tmp_path: Path) -> None:
    first, more = blocks(TOP / "README.md", "toml")
    path = tmp_path / "robot.toml"
    path.write_text(first + more, "utf-8")
    system = assemble(load_config(str(path)))
    assert ("avoider", "wary") in system.parts and system.map is not None


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_toml_blocks_parse(page: Path) -> None:
    for block in blocks(page, "toml"):
        assert tomllib.loads(block)


def test_the_plugin_of_the_docs_registers_and_steers() -> None:
    (source,) = blocks(TOP / "docs" / "writing-a-plugin.md", "python")
    scope: dict[str, object] = {"__name__": "my_plugins"}
    exec(compile(source, "writing-a-plugin.md", "exec"), scope)
    registry = Registry()
    scope["navloom_register"](registry)  # type: ignore[operator]
    assert ("controller", "proportional") in registry.roles


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\((?!https?:)([^)#]+)\)", page.read_text("utf-8")):
        assert (page.parent / target).exists(), target

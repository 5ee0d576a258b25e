"""Project files beside the code: each is checked for what its readers or tools need from it."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

TOP = Path(__file__).resolve().parents[1]
DISTRIBUTIONS = {"ruff": "ruff", "mypy": "mypy", "lint-imports": "import-linter"}
"""Program of a hook -> the distribution that installs it."""


def read(name: str) -> Any:
    return yaml.safe_load((TOP / name).read_text("utf-8"))


def version() -> str:
    return str(tomllib.loads((TOP / "framework" / "core" / "pyproject.toml").read_text("utf-8"))["project"]["version"])


def hooks() -> list[dict[str, Any]]:
    return [hook for repo in read(".pre-commit-config.yaml")["repos"] for hook in repo["hooks"]]


def test_the_citation_has_what_version_1_2_of_its_schema_asks_for() -> None:
    cited = read("CITATION.cff")
    known = {"cff-version", "message", "title", "abstract", "type", "version", "license", "authors", "keywords"}
    assert cited["cff-version"] == "1.2.0" and cited["type"] in ("software", "dataset")
    assert cited.keys() <= known | {"references", "preferred-citation", "date-released", "repository-code", "url"}
    assert {"cff-version", "message", "title", "authors"} <= cited.keys()
    assert len(set(cited["keywords"])) == len(cited["keywords"]) > 0
    assert cited["version"] == version() and cited["license"] == "Apache-2.0"
    for work in (cited, *cited["references"]):
        assert work["authors"] and work["title"]
        for author in work["authors"]:
            assert author.keys() in ({"name"}, {"family-names", "given-names"}), author


def test_the_citation_names_the_paper_as_it_was_published() -> None:
    (paper,) = read("CITATION.cff")["references"]
    assert paper["type"] == "conference-paper" and paper["year"] == 2013
    assert paper["conference"]["name"] == "ICIEA 2013"
    assert [author["family-names"] for author in paper["authors"]] == ["Hoang", "Hiep", "Duong", "Van", "Duong", "Vinh"]
    (number,) = paper["identifiers"]
    assert number["type"] in ("doi", "url", "swh", "other") and number["value"] == "arXiv:1611.09436"


def test_every_hook_is_a_tool_of_the_test_group_and_fetches_nothing() -> None:
    group = tomllib.loads((TOP / "pyproject.toml").read_text("utf-8"))["dependency-groups"]["test"]
    installed = {re.split(r"[~=\[<>]", name)[0] for name in group if isinstance(name, str)}
    for repo in read(".pre-commit-config.yaml")["repos"]:
        assert repo["repo"] == "local"
    for hook in hooks():
        assert hook["language"] == "system" and {"id", "name", "entry"} <= hook.keys()
        words = hook["entry"].split()
        assert words[:4] == ["uv", "run", "--group", "test"]
        assert DISTRIBUTIONS[words[4]] in installed
        assert (Path(sys.executable).parent / words[4]).exists()


@pytest.mark.parametrize("hook", hooks(), ids=lambda hook: hook["id"])
def test_hooks_match_files_that_exist(hook: dict[str, Any]) -> None:
    pattern = re.compile(hook.get("files", r"\.pyi?$"))
    listed = subprocess.run(["git", "ls-files"], cwd=TOP, capture_output=True, text=True, timeout=30, check=False)
    if listed.returncode:
        pytest.skip("needs a git checkout")
    assert any(pattern.search(name) for name in listed.stdout.splitlines())


@pytest.mark.parametrize("hook", [one for one in hooks() if one["id"].startswith("ruff")], ids=lambda hook: hook["id"])
def test_hooks_on_files_repair_what_breaks_a_house_rule(hook: dict[str, Any], tmp_path: Path) -> None:
    """tests/test_house_rules.py covers mypy and import-linter, which check the whole project."""
    shutil.copy(TOP / "pyproject.toml", tmp_path)
    bad = tmp_path / "bad.py"
    bad.write_text("import sys\nimport os\nprint( os.name,sys.path )\n", "utf-8")
    command = [sys.executable, "-m", *hook["entry"].split()[4:], "bad.py"]
    subprocess.run(command, cwd=tmp_path, capture_output=True, timeout=60, check=False)
    text = bad.read_text("utf-8")
    assert text.startswith("import os\nimport sys\n") if "check" in hook["id"] else "print(os.name, sys.path)" in text


def test_the_changelog_keeps_its_form() -> None:
    text = (TOP / "CHANGELOG.md").read_text("utf-8")
    releases = re.findall(r"^## \[(.+?)\](?: - (\d{4}-\d\d-\d\d))?$", text, re.MULTILINE)
    assert releases[0] == ("Unreleased", "") and all(day for _, day in releases[1:])
    assert version() in [name for name, _ in releases]
    assert len(re.findall(r"^## ", text, re.MULTILINE)) == len(releases)
    kinds = set(re.findall(r"^### (.+)$", text, re.MULTILINE))
    assert kinds <= {"Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"} and kinds


def test_commands_and_files_that_contributing_names_exist() -> None:
    text = (TOP / "CONTRIBUTING.md").read_text("utf-8")
    for target in re.findall(r"\]\((?!https?:)([^)#]+)\)", text):
        assert (TOP / target).exists(), target
    commands = re.findall(r"^\$ uv run pytest (.+?)(?:  +#.*)?$", text, re.MULTILINE)
    assert len(commands) >= 5
    for command in commands:
        for word in command.split():
            assert "/" not in word or (TOP / word).exists(), word
    for path in re.findall(r"`([\w/]+\.py)`", text):
        assert (TOP / path).exists(), path

"""The distribution of `examples/people`, put on the path as if it were installed."""

from __future__ import annotations

import os
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest
from navloom.cli import main

PEOPLE = Path(__file__).parents[2] / "examples" / "people"


def put_on_path(project: Path, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Have this process and those that start from it find a project's modules and entry points."""
    about = tomllib.loads((project / "pyproject.toml").read_text("utf-8"))["project"]
    name, version = about["name"], about["version"]
    info = folder / f"{name.replace('-', '_')}-{version}.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n", "utf-8")
    points = [f"{key} = {value}" for key, value in about["entry-points"]["navloom"].items()]
    (info / "entry_points.txt").write_text("\n".join(["[navloom]", *points, ""]), "utf-8")
    for entry in (folder, project):
        monkeypatch.syspath_prepend(str(entry))
    path = [str(folder), str(project), os.environ.get("PYTHONPATH")]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, path)))


@pytest.fixture
def people(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Config of a robot that minds people."""
    put_on_path(PEOPLE, tmp_path / "site", monkeypatch)
    return PEOPLE / "people.toml"


@pytest.fixture
def typed(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str, str]]:
    """A command in this process: takes its words; gives exit code, output and errors."""

    def run(*words: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["navloom", *words])
        with pytest.raises(SystemExit) as ended:
            main()
        out, err = capsys.readouterr()
        assert isinstance(ended.value.code, int)
        return ended.value.code, out, err

    return run

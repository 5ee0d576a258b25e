"""Distributions that are put on the path as if they were installed, from their pyproject.toml."""

from __future__ import annotations

import os
import tomllib
from pathlib import Path

import pytest

__all__ = ["put_on_path"]


def put_on_path(project: Path, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Make a project's modules and entry points visible to this process and its children.

    Args:
        project: Folder with its pyproject.toml and modules.
        folder: Folder for its metadata.
    """
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

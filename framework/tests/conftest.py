"""Fixtures of tests of several packages."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from importlib import invalidate_caches
from pathlib import Path

import pytest
from navloom.messages import SCHEMAS

Install = Callable[..., None]


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Install]:
    """Installs a distribution of one module for this test: name, source, entry points, version."""
    folder = tmp_path / "site"
    folder.mkdir()
    monkeypatch.syspath_prepend(str(folder))
    before, schemas = set(sys.modules), dict(SCHEMAS)

    def add(module: str, source: str, points: Sequence[str], version: str = "1.0") -> None:
        name = module.replace("_", "-")
        info = folder / f"{module}-{version}.dist-info"
        info.mkdir()
        head = f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\nSummary: What {name} is for.\n"
        (info / "METADATA").write_text(head, "utf-8")
        lines = ["[navloom]", *(f"{point} = {module}" for point in points), ""]
        (info / "entry_points.txt").write_text("\n".join(lines), "utf-8")
        (folder / f"{module}.py").write_text(source, "utf-8")
        invalidate_caches()

    yield add
    for name in set(sys.modules) - before:
        if (folder / f"{name}.py").exists():
            del sys.modules[name]
    SCHEMAS.clear()
    SCHEMAS.update(schemas)
    invalidate_caches()

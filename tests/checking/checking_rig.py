"""Puts the planted and the odd plugins on the path as if installed, each with its own entry point."""

from __future__ import annotations

import os
from importlib import import_module
from pathlib import Path

import pytest
from planted import Entries, Entry

__all__ = ["FAULTS", "ODD", "SOUND", "install"]

HERE = Path(__file__).parent
FAULTY = ("planted.avoiders", "planted.planners", "planted.movers", "planted.mappers", "planted.others",
          "planted.surroundings", "planted.scenes", "planted.seeing", "planted.lasting",
          "planted.importing", "planted.agreeing", "planted.hearing",
          "planted.claiming")  # fmt: skip


def _entries(*modules: str) -> dict[str, tuple[Entry, str]]:
    """Entries by full name, such as `avoider.degrees`, each with the target of its entry point."""
    found = {}
    for module in modules:
        entries = import_module(module).ENTRIES
        assert isinstance(entries, Entries)
        for name, entry in vars(entries).items():
            found[f"{entry.kind}.{name}"] = (entry, f"{module}:ENTRIES.{name}")
    return found


FAULTS = _entries(*FAULTY)
SOUND = _entries("planted.sound")
ODD = _entries("odd.plugins")


def install(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Make all of them visible to this process and its children.

    Args:
        folder: Folder for their metadata.
    """
    info = folder / "planted-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: planted\nVersion: 1.0\n", "utf-8")
    points = [f"{name} = {target}" for name, (_, target) in {**FAULTS, **SOUND, **ODD}.items()]
    (info / "entry_points.txt").write_text("\n".join(["[navloom]", *points, ""]), "utf-8")
    for entry in (folder, HERE):
        monkeypatch.syspath_prepend(str(entry))
    path = [str(folder), str(HERE), os.environ.get("PYTHONPATH")]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, path)))

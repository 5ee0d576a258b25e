"""The distribution of `examples/people`, put on the path as if it were installed."""

from __future__ import annotations

from pathlib import Path

import pytest
from dist_rig import put_on_path

PEOPLE = Path(__file__).parents[2] / "examples" / "people"


@pytest.fixture
def people(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Config of a robot that avoids people."""
    put_on_path(PEOPLE, tmp_path / "site", monkeypatch)
    return PEOPLE / "people.toml"

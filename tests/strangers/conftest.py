"""The distribution of `examples/people`, put on the path as if it were installed."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from dist_rig import put_on_path
from navloom.cli import main

PEOPLE = Path(__file__).parents[2] / "examples" / "people"


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

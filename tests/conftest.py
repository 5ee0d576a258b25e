"""Fixtures that tests across the packages share: the data folder, and runs of the shipped config `paper`."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from navloom.config import load_config
from navloom.runs.episode import Episode, run_episode


@pytest.fixture(scope="session")
def data() -> Path:
    """The folder of public data sets; tests that need it are skipped without it."""
    folder = os.environ.get("NAVLOOM_DATA", "")
    if not folder or not Path(folder).is_dir():
        pytest.skip("NAVLOOM_DATA does not name a folder with the public data sets")
    return Path(folder)


@pytest.fixture(scope="session")
def paper() -> Callable[..., Episode]:
    """Runs the shipped config `paper` with overrides."""

    def run(*overrides: str) -> Episode:
        return run_episode(load_config("paper", overrides))

    return run

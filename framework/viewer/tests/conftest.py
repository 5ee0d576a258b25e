"""Fixtures of the viewer's tests: a strict SDK, and servers that replace viewers."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest
from navloom_viewer.program import Program


@pytest.fixture(autouse=True)
def strict(monkeypatch: pytest.MonkeyPatch) -> None:
    """Makes the SDK raise where it would only warn."""
    monkeypatch.setenv("RERUN_STRICT", "1")


@pytest.fixture
def server() -> Iterator[Callable[[], Program]]:
    """Starts servers that replace viewers, without a window; all are ended with the test."""
    started: list[Program] = []

    def start() -> Program:
        started.append(Program(options=("--serve-grpc",)))
        return started[-1]

    yield start
    for program in started:
        program.end()

"""A tool that had joined a robot before reaches a process that the robot gains, with all that it has declared."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from navloom.messages import Command
from navloom_live.transport.links import Link
from navloom_live.transport.quality_of_service import quality_of
from navloom_live.transport.zenoh_bus import Bus, Question

SOON = 10.0
NEW = "lab/r1/avoider/new/command"


@pytest.fixture
def folder() -> Iterator[Path]:
    with TemporaryDirectory(prefix="nl", dir="/tmp") as name:
        yield Path(name)


def test_streams_tokens_and_answers_of_a_gained_process_reach_a_tool(folder: Path) -> None:
    ends = [f"unixsock-stream/{folder}/{name}.sock" for name in ("old", "new")]
    got: dict[str, bytes] = {}
    came, arrived = threading.Event(), threading.Event()

    def receive(key: str, data: bytes | None, label: str) -> None:
        got[key] = data or b""
        if key == NEW:
            arrived.set()

    def answer(question: Question) -> None:
        question.answer("lab/r1/avoider/new/describe", b"{}")

    with Bus(Link("peer", (ends[0],))), Bus(Link("peer", (), (ends[0],))) as tool:
        tool.subscribe("lab/r1/avoider/*/command", receive)
        tool.watch("lab/r1/*/*/alive/*", lambda key, alive: came.set())
        with Bus(Link("peer", (ends[1],), (ends[0],))) as new:
            stream = new.publication(NEW, quality_of(Command))
            new.serve("lab/r1/avoider/new/describe", answer)
            new.announce("lab/r1/avoider/new/alive/1")
            tool.reach(ends[1])
            assert came.wait(SOON)
            limit = time.monotonic() + SOON
            while not arrived.is_set() and time.monotonic() < limit:
                stream.put(b"x", "Command/1")
                arrived.wait(0.05)
            assert got == {NEW: b"x"}
            assert [one.data for one in tool.ask("lab/r1/avoider/new/describe")] == [b"{}"]


def test_a_bus_that_is_closed_opens_no_further_session(folder: Path) -> None:
    end = f"unixsock-stream/{folder}/old.sock"
    with Bus(Link("peer", (end,))) as old:
        tool = Bus(Link("peer", (), (end,)))
        tool.close()
        tool.reach(end)
        limit = time.monotonic() + SOON
        while old.neighbours():
            assert time.monotonic() < limit
            time.sleep(0.01)

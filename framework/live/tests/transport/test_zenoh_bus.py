"""A client that lost its router: its declarations return with the router, whichever side comes back first."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable, Iterator

import pytest
from navloom.messages import Command
from navloom_live.transport import zenoh_session
from navloom_live.transport.links import Link
from navloom_live.transport.quality_of_service import quality_of
from navloom_live.transport.zenoh_bus import TIMED_OUT, Bus, Question

SOON = 20.0


@pytest.fixture
def end() -> str:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{taken.getsockname()[1]}"


@pytest.fixture
def clients(end: str) -> Iterator[tuple[Bus, Bus, Bus]]:
    """A router and two clients of it."""
    link = Link("client", (), (end,))
    router = Bus(Link("router", (end,), ()))
    with Bus(link) as first, Bus(link) as second:
        yield router, first, second
    router.close()


def until(condition: Callable[[], bool], again: Callable[[], None] = lambda: None) -> None:
    waited = threading.Event()
    for _ in range(int(SOON / 0.02)):
        if condition():
            return
        again()
        waited.wait(0.02)
    raise AssertionError("it did not happen")


def test_streams_tokens_and_answers_return_after_a_restart_of_the_router(
    clients: tuple[Bus, Bus, Bus], end: str
) -> None:
    router, first, second = clients
    heard: list[bytes | None] = []
    alive: list[tuple[str, bool]] = []
    stream = first.publication("lab/r1/gate/main/command", quality_of(Command))
    second.subscribe("lab/r1/gate/main/command", lambda key, data, label: heard.append(data))
    first.announce("lab/r1/gate/main/alive/1")
    second.watch("lab/r1/*/*/alive/*", lambda key, has_come: alive.append((key, has_come)))
    first.serve("lab/r1/gate/main/describe", lambda question: answer(question))

    def answer(question: Question) -> None:
        question.answer(question.key, b"here", "Text 1")

    until(lambda: bool(heard) and bool(alive), lambda: stream.put(b"before", "Command 1"))
    router.close()
    until(lambda: first.losses == 1 and second.losses == 1)
    heard.clear()
    with Bus(Link("router", (end,), ())):
        until(lambda: b"after" in heard, lambda: stream.put(b"after", "Command 1"))
        until(lambda: alive[-1] == ("lab/r1/gate/main/alive/1", True))
        assert ("lab/r1/gate/main/alive/1", False) in alive
        until(lambda: [found.data for found in second.ask("lab/r1/gate/main/describe")] == [b"here"])


def test_the_first_message_after_a_declaration_reaches_a_reader_that_was_there(clients: tuple[Bus, Bus, Bus]) -> None:
    _, first, second = clients
    keys = [f"lab/r1/gate/n{number}/command" for number in range(30)]
    heard: list[str] = []
    for key in keys:
        second.subscribe(key, lambda key, data, label: heard.append(key))
    until(lambda: keys[0] in heard, lambda: first.publication(keys[0], quality_of(Command)).put(b"ready", "Command 1"))
    heard.clear()
    for key in keys[1:]:
        first.publication(key, quality_of(Command)).put(b"now", "Command 1")
    until(lambda: set(keys[1:]) <= set(heard))


def test_a_process_that_subscribed_before_its_token_receives_the_next_message(clients: tuple[Bus, Bus, Bus]) -> None:
    _, first, second = clients
    for number in range(30):
        key, heard = f"lab/r1/gate/n{number}/command", list[bytes | None]()
        stream = first.publication(key, quality_of(Command))
        first.watch(f"lab/r1/n{number}", lambda key, has_come, stream=stream: stream.put(b"now", "Command 1"))
        second.subscribe(key, lambda key, data, label, heard=heard: heard.append(data))
        second.announce(f"lab/r1/n{number}")
        until(lambda heard=heard: heard == [b"now"])


def test_a_query_ends_with_an_answer_a_time_out_or_the_end_of_the_session(clients: tuple[Bus, Bus, Bus]) -> None:
    _, first, second = clients
    held: list[Question] = []
    first.serve("lab/r1/goal/main/submit", held.append)
    until(lambda: bool(held), lambda: list(second.ask("lab/r1/goal/main/submit", timeout=0.05)))
    began = time.monotonic()
    assert [answer.refusal for answer in second.ask("lab/r1/goal/main/submit", timeout=0.3)] == [TIMED_OUT]
    assert 0.3 <= time.monotonic() - began < 2.0
    asking = threading.Thread(target=lambda: list(second.ask("lab/r1/goal/main/submit", timeout=60.0)))
    asked = len(held)
    asking.start()
    until(lambda: len(held) > asked)
    second.close()
    asking.join(SOON)
    assert not asking.is_alive()


def test_a_query_that_zenoh_never_ends_times_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(zenoh_session, "QUERY_END_MARGIN", 0.1)
    began = time.monotonic()
    assert list(zenoh_session.Replies(0.1)) == []
    assert time.monotonic() - began < 2.0


def test_a_message_larger_than_its_stream_carries_is_not_copied(clients: tuple[Bus, Bus, Bus]) -> None:
    _, first, second = clients
    heard: list[int | None] = []
    key = "lab/r1/gate/main/command"
    second.subscribe(key, lambda key, data, label: heard.append(None if data is None else len(data)), 640)
    stream = first.publication(key, quality_of(Command))
    until(lambda: bool(heard), lambda: stream.put(b"begin", "Command 1"))
    stream.put(bytes(641), "Command 1")
    stream.put(bytes(640), "Command 1")
    until(lambda: 640 in heard)
    assert heard[-2:] == [None, 640]


def test_between_two_routers_nothing_is_asked_for_in_vain_and_the_end_is_quick(
    clients: tuple[Bus, Bus, Bus],
) -> None:
    router, first, _ = clients
    router.close()
    until(lambda: first.losses == 1)
    assert list(first.ask("lab/**", timeout=0.2)) == [] and first.alive("lab/**", timeout=0.2) == []
    first.close()

"""The last message of a stream for late joiners: encoded once, and bounded in bytes per second."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
from navloom.messages import Feedback
from navloom.messages.codec import decode, encode, schema_label
from navloom_live.live import node_output
from navloom_live.live.node_output import NOTHING, Outlet
from navloom_live.transport.query_limits import TOO_MANY

KEY = "lab/r1/goal/main/feedback"


class Wire:
    """Replaces the bus; keeps the handlers of queries."""

    take: Callable[[Any], None]

    def publication(self, key: str, quality: object, lossless: bool) -> Any:
        return SimpleNamespace(is_heard=True, put=lambda data, label: None)

    def serve(self, key: str, take: Callable[[Any], None], is_large: bool = False) -> None:
        self.take = take


@pytest.fixture
def wire() -> Wire:
    return Wire()


def ask(wire: Wire) -> str | bytes:
    found: list[str | bytes] = []
    question = SimpleNamespace(answer=lambda key, data, label: found.append(data), refuse=found.append)
    wire.take(question)
    return found[0]


def test_a_query_before_the_first_message_is_refused_with_that_reason(wire: Wire) -> None:
    Outlet(KEY, wire, lossless=False, retained=True)  # type: ignore[arg-type]
    assert ask(wire) == NOTHING


def test_each_message_is_encoded_once_for_all_queries(wire: Wire, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = Outlet(KEY, wire, lossless=False, retained=True)  # type: ignore[arg-type]
    for number in (1, 2):
        kept.publish(Feedback(number, "driving", 1.0, 2.0, 0.0, 0), number, 0, 0, 0)
        encoded: list[int] = []
        monkeypatch.setattr(node_output, "encode", lambda *given, encoded=encoded: encoded.append(1) or encode(*given))
        answers = [ask(wire) for _ in range(50)]
        assert len(encoded) == 1 and set(answers) == {encode(*kept.last)}  # type: ignore[misc]


def test_beyond_its_allowance_it_refuses(wire: Wire) -> None:
    kept = Outlet(KEY, wire, lossless=False, retained=True)  # type: ignore[arg-type]
    kept.publish(Feedback(1, "driving", 1.0, 2.0, 0.0, 0), 1, 0, 0, 0)
    answers = [ask(wire) for _ in range(5000)]
    most = node_output.AT_ONCE / node_output.LEAST
    assert most <= sum(isinstance(answer, bytes) for answer in answers) <= most + 500
    assert answers[-1] == TOO_MANY


def test_a_message_without_a_reader_in_another_process_is_not_encoded() -> None:
    sent: list[bytes] = []
    way = SimpleNamespace(is_heard=False, put=lambda data, label: sent.append(data))
    bus: Any = SimpleNamespace(publication=lambda *given: way, serve=lambda *given: None)
    outlet = Outlet(KEY, bus, lossless=False, retained=False)
    outlet.publish(Feedback(1, "driving", 1.0, 2.0, 0.0, 0), 1, 0, 0, 0)
    assert not sent
    way.is_heard = True  # a recorder joins, and gets the next message
    outlet.publish(Feedback(2, "driving", 1.0, 2.0, 0.0, 0), 2, 0, 0, 0)
    ((message, envelope),) = [decode(data, schema_label(Feedback)) for data in sent]
    assert (message.goal_id, envelope.sequence) == (2, 2)  # type: ignore[attr-defined]

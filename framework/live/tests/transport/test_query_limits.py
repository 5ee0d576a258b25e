"""Queries are limited in size, nesting and rate before they are read, and important ones go first."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable
from typing import Any

import pytest
from navloom_live.transport.query_limits import (
    BURST,
    DEEPEST,
    LARGEST,
    LARGEST_LIST,
    RANKS,
    READING,
    REFUSALS,
    TOO_MANY,
    WAITING,
    Allowance,
    Desk,
    KeptJson,
    QuestionError,
    largest_of,
    rank_of,
    read_question,
)

SOON = 10.0


class Asked:
    """A query as the bus delivers it, with its outcome."""

    def __init__(self, size: int = 0) -> None:
        self.size = size
        self.fate = ""
        self.done = threading.Event()

    def refuse(self, reason: str) -> None:
        self._end(reason)

    def answer(self) -> None:
        self._end("answered")

    def drop(self) -> None:
        self._end("dropped")

    def _end(self, fate: str) -> None:
        assert not self.fate, "ended twice"
        self.fate = fate
        self.done.set()


def answer(question: Any) -> None:
    question.answer()


def ask(window: Callable[[Any], None], size: int = 0) -> Asked:
    asked = Asked(size)
    window(asked)
    return asked


# --- reading --------------------------------------------------------------------------------------------------------


def test_an_empty_query_is_an_empty_object() -> None:
    assert read_question(b"") == {}


def test_a_goal_with_a_thousand_via_points_is_read() -> None:
    given = {"x": 1.0, "y": 2.0, "via": [[1.5, -2.5]] * 1000}
    assert read_question(json.dumps(given).encode()) == given


@pytest.mark.parametrize("data", [b"[" * 100_000, b'{"a":' * 100_000, b'{"a": ' + b"[" * 50 + b"]" * 50 + b"}"])
def test_a_query_nested_too_deeply_is_refused_in_one_line_before_it_is_parsed(data: bytes) -> None:
    began = time.thread_time()
    with pytest.raises(QuestionError, match=f"^request not understood: nested more than {DEEPEST} levels deep$"):
        read_question(data)
    assert time.thread_time() - began < 0.1


@pytest.mark.parametrize(
    ("data", "what"),
    [
        (b"[1]", "got list, expected an object"),
        (b"nan", "Expecting value"),
        (b'{"x": ', "Expecting value"),
        (b"\xff\xfe", "utf"),
        (b'{"x": ' + b"9" * 5000 + b"}", "digits"),
        (b"\x91" * 100, "utf"),
    ],
)
def test_a_query_that_is_no_object_is_refused_in_one_line(data: bytes, what: str) -> None:
    with pytest.raises(QuestionError, match=what) as refused:
        read_question(data)
    assert "\n" not in str(refused.value)


# --- taking ---------------------------------------------------------------------------------------------------------


def test_a_query_larger_than_its_service_allows_is_refused_with_the_limit_and_never_read() -> None:
    window = Desk().window("describe", answer)
    assert ask(window, LARGEST + 1).fate == f"a request of {LARGEST + 1} bytes: describe takes at most {LARGEST}"
    assert ask(window, 20_000_000).fate.startswith("a request of 20000000 bytes")
    fits = ask(window, LARGEST)
    assert fits.done.wait(SOON) and fits.fate == "answered"


def test_lists_may_be_larger() -> None:
    assert largest_of("submit") == largest_of("params/set") == LARGEST_LIST
    assert {largest_of(service) for service in RANKS if service not in ("submit", "params/set")} == {LARGEST}


def test_beyond_its_rate_a_service_refuses_at_once_and_then_drops() -> None:
    window = Desk().window("describe", answer)
    asked = [ask(window) for _ in range(3000)]
    assert all(one.done.wait(SOON) for one in asked)
    fates = [one.fate for one in asked]
    assert 1 <= fates.count("answered") <= BURST + 100  # the allowance that it gains meanwhile
    assert 1 <= fates.count(TOO_MANY) <= REFUSALS + 20
    assert fates.count("dropped") > 2000


def test_a_flood_of_one_service_leaves_another_its_own_rate() -> None:
    desk = Desk()
    describe, stop = desk.window("describe", answer), desk.window("stop", answer)
    for _ in range(1000):
        ask(describe)
    stopped = ask(stop)
    assert stopped.done.wait(SOON) and stopped.fate == "answered"


def test_a_stop_is_answered_while_other_queries_wait_for_a_busy_node() -> None:
    desk, free = Desk(), threading.Event()

    def hang(question: Any) -> None:
        free.wait(SOON)
        question.answer()

    stuck = [desk.window(service, hang) for service in ("cancel", "resume", "submit", "swap", "describe")]
    waiting = [ask(window) for window in stuck for _ in range(WAITING)]
    stop = ask(desk.window("stop", answer))
    assert stop.done.wait(SOON) and stop.fate == "answered"
    assert not any(one.fate == "answered" for one in waiting)
    free.set()
    assert all(one.done.wait(SOON) for one in waiting)


def test_the_number_of_waiting_queries_is_limited() -> None:
    desk, free = Desk(), threading.Event()
    window = desk.window("describe", lambda question: free.wait(SOON) and answer(question))  # type: ignore[func-returns-value]
    asked = [ask(window) for _ in range(WAITING + 10)]
    assert sum(one.fate == TOO_MANY for one in asked) in (9, 10)  # one may be in progress
    free.set()


def test_an_error_in_one_query_ends_no_thread() -> None:
    def fail(question: Any) -> None:
        raise RuntimeError("told to fail")

    desk = Desk()
    failing, healthy = desk.window("describe", fail), desk.window("describe", answer)
    for _ in range(5):
        failed = ask(failing)
        assert failed.done.wait(SOON) and failed.fate == "request not understood: RuntimeError: told to fail"
    well = ask(healthy)
    assert well.done.wait(SOON) and well.fate == "answered"


def test_stopping_ranks_before_driving_and_driving_before_reading() -> None:
    assert rank_of("stop") < rank_of("resume") < rank_of("submit") < rank_of("describe") == READING
    assert rank_of("params/get") == rank_of("config") == READING


# --- rate and cost --------------------------------------------------------------------------------------------------


def test_an_allowance_fills_again(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [100.0]
    monkeypatch.setattr("navloom_live.transport.query_limits.time.monotonic", lambda: now[0])
    allowance = Allowance(10.0, 3.0)
    assert [allowance.spend() for _ in range(4)] == [True, True, True, False]
    now[0] += 0.2
    assert [allowance.spend() for _ in range(3)] == [True, True, False]
    now[0] += 60.0
    assert not allowance.spend(3.5) and allowance.spend(3.0) and not allowance.spend()


def test_json_is_cached_for_a_while_but_its_clocks_are_always_new(monkeypatch: pytest.MonkeyPatch) -> None:
    now, made, clock = [100.0], [0], [0]
    monkeypatch.setattr("navloom_live.transport.query_limits.time.monotonic", lambda: now[0])

    def make() -> dict[str, int]:
        made[0] += 1
        return {"made": made[0], "clock_ns": -1}

    def tick() -> dict[str, int]:
        clock[0] += 1
        return {"clock_ns": clock[0]}

    kept = KeptJson(make, tick)
    assert [json.loads(kept.to_bytes()) for _ in range(3)] == [{"made": 1, "clock_ns": n} for n in (1, 2, 3)]
    now[0] += 0.06
    assert json.loads(kept.to_bytes()) == {"made": 2, "clock_ns": 4}

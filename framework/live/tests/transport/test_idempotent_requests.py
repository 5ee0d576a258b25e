"""A request is carried out once and has one answer, however often it is sent."""

from __future__ import annotations

import threading
from typing import Any

import pytest
from navloom_live.transport.idempotent_requests import KEPT, REQUEST, Once


class Service:
    """Counts what it carries out; refuses on request."""

    def __init__(self) -> None:
        self.done: list[Any] = []

    def __call__(self, given: dict[str, Any]) -> dict[str, Any]:
        self.done.append(given["x"])
        if given["x"] < 0:
            raise ValueError(f"no: {given['x']}")
        return {"number": len(self.done)}


def test_a_repeated_request_is_not_carried_out_again_and_has_the_same_answer() -> None:
    service = Service()
    handle = Once().guard(service)
    assert [handle({"x": 1, REQUEST: "a"})["number"] for _ in range(3)] == [1, 1, 1]
    assert handle({"x": 1, REQUEST: "b"}) == {"number": 2}
    assert service.done == [1, 1]


def test_a_refusal_is_repeated_too() -> None:
    service = Service()
    handle = Once().guard(service)
    for _ in range(2):
        with pytest.raises(ValueError, match="no: -1"):
            handle({"x": -1, REQUEST: "a"})
    assert service.done == [-1]


def test_a_request_without_a_name_is_carried_out_each_time() -> None:
    service = Service()
    handle = Once().guard(service)
    assert [handle({"x": 1})["number"] for _ in range(3)] == [1, 2, 3]


def test_a_repetition_during_the_work_gets_the_same_answer() -> None:
    begun, may_end, answers = threading.Event(), threading.Event(), []

    def slow(given: dict[str, Any]) -> dict[str, Any]:
        begun.set()
        assert may_end.wait(10.0)
        return {"number": 7}

    handle = Once().guard(slow)
    threads = [threading.Thread(target=lambda: answers.append(handle({REQUEST: "a"}))) for _ in range(5)]
    for thread in threads:
        thread.start()
    assert begun.wait(10.0) and not answers
    may_end.set()
    for thread in threads:
        thread.join(10.0)
    assert answers == [{"number": 7}] * 5


def test_only_the_last_answers_are_stored() -> None:
    service = Service()
    handle = Once().guard(service)
    for number in range(KEPT + 1):
        handle({"x": number, REQUEST: str(number)})
    assert handle({"x": 1, REQUEST: "1"}) == {"number": 2}  # still known
    assert handle({"x": 0, REQUEST: "0"}) == {"number": KEPT + 2}


@pytest.mark.parametrize("name", [7, [], {}, "x" * 65])
def test_an_invalid_name_is_refused(name: Any) -> None:
    with pytest.raises(ValueError, match="request is not a text of at most 64 characters"):
        Once().guard(Service())({"x": 1, REQUEST: name})

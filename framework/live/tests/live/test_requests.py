"""Requests and answers of services, on the wire and back."""

from __future__ import annotations

import json
from typing import Any

import pytest
from navloom.errors import NavloomError
from navloom.inputs.typed_json import from_json
from navloom_live.live import requests
from navloom_live.live.service import GATE, STOP, Nothing, Service, reply, request_bytes
from navloom_live.transport.idempotent_requests import REQUEST, Once

NOTHING, NUMBER = Nothing(), requests.GoalNumber(7)
VALUES = requests.ParameterValues(2, {"reach": 1.5, "names": ["a"]})
TABLE = requests.Alternative("avoider", "vff", "vff", True)
CASES: list[tuple[Service[Any, Any], Any, dict[str, Any], Any, dict[str, Any]]] = [
    (requests.SUBMIT, requests.Submit(1.0, 2.0, None, ((0.5, 0.25),)),
     {"x": 1.0, "y": 2.0, "heading": None, "via": [[0.5, 0.25]]}, NUMBER, {"goal_id": 7}),
    (requests.CANCEL, NOTHING, {}, NUMBER, {"goal_id": 7}),
    (requests.REPLAN, NOTHING, {}, NUMBER, {"goal_id": 7}),
    (requests.PLACE, requests.Place(1.0, 2.0, 0.5, 0.7, 0.25),
     {"x": 1.0, "y": 2.0, "heading": 0.5, "spread": 0.7, "heading_spread": 0.25},
     requests.Placed(True, "occupied"), {"placed": True, "warning": "occupied"}),
    (requests.RELOCALISE, NOTHING, {}, NOTHING, {}),
    (requests.PLAN, requests.Between((0.0, 0.0, 0.5), (1.0, 0.0, 0.0)),
     {"start": [0.0, 0.0, 0.5], "goal": [1.0, 0.0, 0.0]},
     requests.Planned((), "no_path", "a wall"), {"points": [], "kind": "no_path", "detail": "a wall"}),
    (requests.CLEAR, NOTHING, {}, NOTHING, {}),
    (requests.LIMIT, requests.SpeedLimit(50.0, True), {"speed": 50.0, "is_percentage": True},
     requests.SpeedLimit(0.2), {"speed": 0.2, "is_percentage": False}),
    (requests.SWAP, requests.Swap("avoider", "vff"), {"role": "avoider", "instance": "vff"},
     requests.Selected(("avoider vff",), "vfh", 3), {"pending": ["avoider vff"], "selected": "vfh", "epoch": 3}),
    *((service, NOTHING, {}, NOTHING, {}) for service in GATE.values()),
    (requests.GET_PARAMETERS, NOTHING, {}, VALUES, {"version": 2, "values": {"reach": 1.5, "names": ["a"]}}),
    (requests.SET_PARAMETERS, requests.Assignments(("reach = 1.5",)), {"values": ["reach = 1.5"]},
     VALUES, {"version": 2, "values": {"reach": 1.5, "names": ["a"]}}),
    (requests.ADD, requests.Add("avoider", "vff"), {"role": "avoider", "instance": "vff", "again": False},
     requests.Added(True, "failed", "ended", "last"),
     {"is_new": True, "state": "failed", "why": "ended", "last_words": "last"}),
    (requests.EXTEND, requests.Extend(TABLE, "avoider-vff"),
     {"alternative": {"role": "avoider", "plugin": "vff", "name": "vff", "shadow": True}, "process": "avoider-vff"},
     requests.Extended("ab"), {"config_sha256": "ab"}),
]  # fmt: skip


class Question:
    """A question, and what became of it."""

    def __init__(self, data: bytes) -> None:
        self.data, self.size, self.said = data, len(data), b""

    def answer(self, key: str, data: bytes, label: str) -> None:
        self.said = data

    def refuse(self, reason: str) -> None:
        self.said = f"refused: {reason}".encode()


def ask(service: Service[Any, Any], handler: Any, data: bytes) -> bytes:
    question = Question(data)
    reply("lab/r1/x", service, handler, Once())(question)  # type: ignore[arg-type]
    return question.said


@pytest.mark.parametrize(
    ("service", "asked", "wire", "answered", "back"), CASES, ids=[service.name for service, *_ in CASES]
)
def test_request_and_answer_come_back_from_the_wire_as_they_were(
    service: Service[Any, Any], asked: Any, wire: dict[str, Any], answered: Any, back: dict[str, Any]
) -> None:
    sent = request_bytes(asked)
    assert {**wire, REQUEST: json.loads(sent)[REQUEST]} == json.loads(sent)
    heard: list[Any] = []

    def handle(one: Any) -> Any:
        heard.append(one)
        return answered

    said = ask(service, handle, sent)
    assert heard == [asked] and json.loads(said) == back
    assert from_json(service.answered, said) == answered


def test_every_request_has_a_name_of_its_own() -> None:
    assert request_bytes(NOTHING) != request_bytes(NOTHING)


def test_a_request_of_another_version_may_lack_defaults_and_have_more() -> None:
    heard: list[Any] = []
    ask(requests.SUBMIT, lambda one: heard.append(one) or NUMBER, b'{"x": 1, "y": 2.5, "speed": "slow"}')
    assert heard == [requests.Submit(1.0, 2.5)]
    assert ask(STOP, lambda one: one, b"") == b"{}"
    assert from_json(Nothing, b'{"done": "stop"}') == NOTHING  # the answer of robots before


@pytest.mark.parametrize(
    ("given", "why"),
    [
        ({"x": 1.0}, "object missing required field y"),
        ({"x": 1.0, "y": "2"}, "y: expected float, got str"),
        ({"x": True, "y": 2.0}, "x: expected float, got bool"),
        ({"x": 1.0, "y": 2.0, "via": [[1.0]]}, "via[0]: expected array of length 2, got 1"),
        ({"x": 1.0, "y": 2.0, "heading": {}}, "heading: expected float | null, got object"),
        ({"x": 10**400, "y": 2.0}, "x: number out of range"),
    ],
)
def test_a_request_that_cannot_be_read_is_refused_with_the_field(given: dict[str, Any], why: str) -> None:
    said = ask(requests.SUBMIT, lambda one: pytest.fail("carried out"), json.dumps(given).encode())
    assert said.decode() == f"refused: request not understood: submit: {why}"


def test_a_handlers_error_refuses_the_request_with_its_text() -> None:
    def refuse(one: Any) -> Any:
        raise NavloomError("it is occupied")

    assert ask(requests.CANCEL, refuse, b"{}") == b"refused: it is occupied"

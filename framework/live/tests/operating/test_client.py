"""How a client handles answers, lost and invalid ones too."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Iterator
from typing import Any

import pytest
from navloom.messages import GoalResult, Point2D
from navloom_live.live.mailbox import Inlet, Mailbox
from navloom_live.live.requests import GET_PARAMETERS, SUBMIT, Submit
from navloom_live.live.service import Nothing
from navloom_live.operating import client as client_module
from navloom_live.operating import navigator
from navloom_live.operating.client import Client, ClientError, Refused, Unanswered
from navloom_live.operating.diagnosis import examine
from navloom_live.operating.navigator import GoalHandle, GoalStreams
from navloom_live.operating.robot_nodes import answering, listing
from navloom_live.operating.stream_measurement import clock_offsets
from navloom_live.transport.idempotent_requests import Once
from navloom_live.transport.zenoh_bus import TIMED_OUT, Answer

from .described import KEYS, described

FORCES = KEYS.port("avoider", "forces", "describe")


class Bus:
    """Replaces the network: some answers, and the tokens of the goal node."""

    def __init__(self, *answers: Answer) -> None:
        self.answers = answers
        self.lives = ["a"]

    def ask(self, key: str, data: bytes = b"", timeout: float = 1.0) -> Iterator[Answer]:
        yield from self.answers

    def alive(self, key: str) -> list[str]:
        return [KEYS.alive("goal", "main", life) for life in self.lives]


def client(*answers: bytes) -> Client:
    return Client(Bus(*(Answer(FORCES, data, "json", "") for data in answers)), KEYS)  # type: ignore[arg-type]


def test_an_answer_that_cannot_be_read_is_skipped_and_listed_with_one_sentence() -> None:
    good = Answer(
        KEYS.port("gate", "main", "describe"), json.dumps(described("gate", "main").to_json()).encode(), "", ""
    )
    asked = Client(Bus(Answer(FORCES, b"{}", "json", ""), good), KEYS)  # type: ignore[arg-type]
    assert [node.role for node in asked.describe()] == ["gate"]
    nodes = listing(asked)
    assert [node.name for node in answering(nodes)] == ["gate main"]
    (mute,) = (node for node in nodes if node.name == "avoider forces")
    assert mute.unreadable.startswith("avoider forces: its description cannot be read (")
    assert clock_offsets(client(b"{}"), [described("avoider", "forces")]) == {}


def test_the_doctor_reports_a_description_that_cannot_be_read_as_one_finding() -> None:
    finding, *others = examine(client(b"{}"), None, "robot.toml")[1]
    assert finding.what.startswith("avoider forces: its description cannot be read")
    assert finding.remedy == "install the same version on both"
    assert not any("avoider" in other.what for other in others)


def test_a_node_that_claims_another_name_is_listed_under_its_key() -> None:
    liar = json.dumps(described("controller", "aaa").to_json()).encode()
    (node,) = client(liar).describe()
    assert (node.role, node.instance) == ("avoider", "forces")


@pytest.mark.parametrize(
    ("answer", "what"),
    [
        (b"me", "Expecting value: line 1 column 1 (char 0)"),
        (b'{"version": 1}', "object missing required field values"),
        (b'{"version": "1.0", "values": {}}', "version: expected int, got str"),
    ],
)
def test_an_answer_that_cannot_be_read_gives_one_message(answer: bytes, what: str) -> None:
    what = f"the answer of avoider forces to params/get cannot be read ({what}); install the same version"
    with pytest.raises(ClientError, match=re.escape(what)):
        client(answer).call("avoider", "forces", GET_PARAMETERS, Nothing())


class LossyBus(Bus):
    """A service behind a network that loses chosen answers; the requests have been carried out."""

    def __init__(self, *fates: str) -> None:
        super().__init__()
        self.fates = list(fates)
        self.done = 0
        self.asked: list[float] = []
        self._handle = Once().guard(self._submit)

    def _submit(self, given: dict[str, Any]) -> dict[str, Any]:
        self.done += 1
        return {"goal_id": self.done}

    def ask(self, key: str, data: bytes = b"", timeout: float = 1.0) -> Iterator[Answer]:
        fate = self.fates.pop(0) if self.fates else "answered"
        self.asked.append(timeout)
        if fate == "restarted":
            self.lives = ["b"]
        if fate == "refused":
            yield Answer("", b"", "", "rejected: it is occupied")
        if fate in ("answered", "lost", "late"):
            answer = json.dumps(self._handle(json.loads(data))).encode()
            if fate == "answered":
                yield Answer(key, answer, "json", "")
        if fate in ("late", "silent"):
            yield Answer("", b"", "", TIMED_OUT)


def submit(bus: Bus, timeout: float = 5.0) -> int:
    asked = Client(bus, KEYS)  # type: ignore[arg-type]
    return asked.call("goal", "main", SUBMIT, Submit(1.0, 2.0), timeout).goal_id


@pytest.mark.parametrize("fates", [(), ("lost",), ("late", "lost"), ("unheard", "silent", "lost", "lost")])
def test_a_request_whose_answer_is_lost_is_retried_and_carried_out_once(fates: tuple[str, ...]) -> None:
    bus = LossyBus(*fates)
    assert submit(bus) == 1
    assert bus.done == 1 and len(bus.asked) == len(fates) + 1
    assert submit(bus) == 2  # the next request has another name


@pytest.mark.parametrize("fate", ["silent", "unheard", "lost"])
def test_a_service_without_an_answer_ends_in_a_typed_error_within_its_time(fate: str) -> None:
    bus = LossyBus(*[fate] * 1000)
    began = time.monotonic()
    with pytest.raises(Unanswered, match=r"goal main does not answer within 0\.2 s \(submit\); it may or may not"):
        submit(bus, 0.2)
    assert time.monotonic() - began < 1.0
    assert all(0.0 < timeout <= 0.2 for timeout in bus.asked) and bus.done <= 1


def test_a_refusal_is_an_answer_and_is_not_retried() -> None:
    bus = LossyBus("refused")
    with pytest.raises(Refused, match="rejected: it is occupied"):
        submit(bus)
    assert len(bus.asked) == 1


def test_a_request_is_not_retried_at_a_process_that_restarted_meanwhile() -> None:
    bus = LossyBus("restarted")
    with pytest.raises(Unanswered, match=r"goal main restarted during the request \(submit\)"):
        submit(bus)
    assert len(bus.asked) == 1


def test_a_missing_service_is_not_queried(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(client_module, "TOOL_JOIN_WAIT", 0.1)
    bus = LossyBus()
    bus.lives = []
    with pytest.raises(ClientError, match=r"goal main does not answer \(submit\): it is not there") as caught:
        submit(bus)
    assert not isinstance(caught.value, Unanswered) and bus.asked == []


class Clock:
    """Replaces `time` in the module that waits."""

    def __init__(self) -> None:
        self.now = 0.0

    def monotonic(self) -> float:
        self.now += 0.1
        return self.now


def handle(bus: Bus, monkeypatch: pytest.MonkeyPatch) -> GoalHandle:
    monkeypatch.setattr(navigator, "time", Clock())
    mailbox = Mailbox()
    monkeypatch.setattr(mailbox, "wait", lambda seen, timeout: seen)
    streams = GoalStreams(
        *(Inlet(KEYS.port("goal", "main", port), mailbox, 4) for port in ("result", "feedback", "gate", "odometry"))
    )
    return GoalHandle(Client(bus, KEYS), mailbox, streams, 3)  # type: ignore[arg-type]


def test_waiting_ends_with_an_error_when_the_goal_node_has_forgotten_the_goal(monkeypatch: pytest.MonkeyPatch) -> None:
    bus = Bus()
    waiting = handle(bus, monkeypatch)
    bus.lives = ["b"]
    with pytest.raises(ClientError, match="restarted and does not know goal 3"):
        waiting.wait(60)


def test_waiting_ends_with_an_error_when_the_robot_goes_down(monkeypatch: pytest.MonkeyPatch) -> None:
    bus = Bus()
    waiting = handle(bus, monkeypatch)
    bus.lives = []
    monkeypatch.setattr(Client, "was_ended", True)
    with pytest.raises(ClientError, match="lab/r1 went down, and goal 3 with it"):
        waiting.wait(60)


def test_a_restarted_goal_node_may_still_report_the_result(monkeypatch: pytest.MonkeyPatch) -> None:
    bus = Bus()
    waiting = handle(bus, monkeypatch)
    bus.lives = ["b"]
    told: dict[str, Any] = {"result": GoalResult(3, "error", "restarted", Point2D(0.0, 0.0))}
    monkeypatch.setattr(navigator, "last", lambda client, role, instance, port: told.get(port))
    assert waiting.wait(60).reason == "restarted"


def test_a_goal_node_that_is_briefly_unreachable_has_not_forgotten_the_goal(monkeypatch: pytest.MonkeyPatch) -> None:
    bus = Bus()
    waiting = handle(bus, monkeypatch)
    monkeypatch.setattr(Client, "has_nodes", lambda self: True)
    bus.lives = []
    with pytest.raises(TimeoutError):
        waiting.wait(30)

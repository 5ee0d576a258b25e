"""What a tool makes of answers: of those that are none, too."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import pytest
from navloom.messages import GoalResult, Point2D
from navloom.runtime import navigator
from navloom.runtime.client import Client, ClientError
from navloom.runtime.findings import differing, failing, flowing, sharing, unheard
from navloom.runtime.looking import listing
from navloom.runtime.mailbox import Inlet, Mailbox
from navloom.runtime.metering import clock_offsets
from navloom.runtime.navigator import GoalHandle, Streams
from navloom.runtime.zenoh_bus import Answer

from .described import KEYS, described

FORCES = KEYS.port("avoider", "forces", "describe")


class Bus:
    """Stands in for the network: some answers, and the lives of the goal's node."""

    def __init__(self, *answers: Answer) -> None:
        self.answers = answers
        self.lives = ["a"]

    def ask(self, key: str, data: bytes = b"", timeout: float = 1.0) -> Iterator[Answer]:
        yield from self.answers

    def alive(self, key: str) -> list[str]:
        return [KEYS.alive("goal", "main", life) for life in self.lives]


def client(*answers: bytes) -> Client:
    return Client(Bus(*(Answer(FORCES, data, "json", "") for data in answers)), KEYS)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "data",
    [
        b"me", b"\xff", b"[]", b'"x"', b"null", b'{"tick": "late"}', b'{"active": 1}', b'{"streams": []}',
        b'{"streams": {"a": 1}}', b'{"places": {"avoider": "drive"}}', b'{"places": {"avoider vfh": 3}}',
        b'{"hosts": {"drive": null}}', b'{"wall_ns": "now"}', b'{"streams": {"a": {}}}', b'{"versions": {"numpy": []}}',
        b'{"late_ticks": "many"}',
    ],
    ids=lambda data: data.decode(errors="replace"),
)  # fmt: skip
def test_an_answer_that_is_no_description_is_passed_over(data: bytes) -> None:
    good = Answer(KEYS.port("gate", "main", "describe"), json.dumps(described("gate", "main")).encode(), "json", "")
    asked = Client(Bus(Answer(FORCES, data, "json", ""), good), KEYS)  # type: ignore[arg-type]
    assert [node["role"] for node in asked.describe()] == ["gate"]
    assert [node["role"] for node in listing(asked) if node["answers"]] == ["gate"]
    assert clock_offsets(client(data), [described("avoider", "forces") | {"answers": True}]) == {}


def test_doctor_makes_something_of_an_instance_that_says_nothing_of_itself() -> None:
    nodes = [node for node in listing(client(b"{}")) if node["answers"]]
    assert len(nodes) == 1
    for check in (failing, flowing, differing, unheard, sharing):
        check(nodes)


def test_who_answers_under_another_name_is_listed_under_its_own() -> None:
    liar = json.dumps(described("controller", "aaa")).encode()
    (node,) = client(liar).describe()
    assert (node["role"], node["instance"]) == ("avoider", "forces")


def test_a_service_that_answers_nonsense_is_one_message() -> None:
    with pytest.raises(ClientError, match="avoider forces answers params/get with no JSON"):
        client(b"me").call("avoider", "forces", "params/get", {})


class Clock:
    """Stands in for `time` in the module that waits."""

    def __init__(self) -> None:
        self.now = 0.0

    def monotonic(self) -> float:
        self.now += 0.1
        return self.now


def handle(bus: Bus, monkeypatch: pytest.MonkeyPatch) -> GoalHandle:
    monkeypatch.setattr(navigator, "time", Clock())
    mailbox = Mailbox()
    monkeypatch.setattr(mailbox, "wait", lambda seen, timeout: seen)
    streams = Streams(
        *(Inlet(KEYS.port("goal", "main", port), mailbox, 4) for port in ("result", "feedback", "gate", "odometry"))
    )
    return GoalHandle(Client(bus, KEYS), mailbox, streams, 3)  # type: ignore[arg-type]


def test_who_waits_for_a_goal_that_its_node_has_forgotten_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    bus = Bus()
    waiting = handle(bus, monkeypatch)
    bus.lives = ["b"]
    with pytest.raises(ClientError, match="began anew and knows nothing of goal 3"):
        waiting.wait(60)


def test_who_waits_for_a_goal_of_a_robot_that_goes_down_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    bus = Bus()
    waiting = handle(bus, monkeypatch)
    bus.lives = []
    monkeypatch.setattr(Client, "was_ended", True)
    with pytest.raises(ClientError, match="lab/r1 went down, and goal 3 with it"):
        waiting.wait(60)


def test_a_node_that_began_anew_and_tells_what_became_of_the_goal_is_believed(monkeypatch: pytest.MonkeyPatch) -> None:
    bus = Bus()
    waiting = handle(bus, monkeypatch)
    bus.lives = ["b"]
    told: dict[str, Any] = {"result": GoalResult(3, "error", "restarted", Point2D(0.0, 0.0))}
    monkeypatch.setattr(Client, "last", lambda self, role, instance, port, timeout=1.0: told.get(port))
    assert waiting.wait(60).reason == "restarted"


def test_a_goal_node_that_is_away_for_a_moment_has_forgotten_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    bus = Bus()
    waiting = handle(bus, monkeypatch)
    monkeypatch.setattr(Client, "has_nodes", lambda self: True)
    bus.lives = []
    with pytest.raises(TimeoutError):
        waiting.wait(30)

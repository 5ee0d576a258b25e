"""The inputs of a recorded step are found again: by number, by active instance, and by request of the executor."""

from __future__ import annotations

from typing import Any

import pytest
from navloom.config import load_config
from navloom.engine.node_ports import Input, NodeSpec
from navloom.engine.streams import ControllerPorts
from navloom.messages import (
    Command,
    Envelope,
    Goal,
    InputRead,
    Message,
    OperatorRequest,
    Point2D,
    Selection,
    StepReport,
    Twist2D,
)
from navloom.messages.codec import encode, schema_label
from navloom_recording import message_cache as shelves
from navloom_recording.message_cache import Entry, Shelf
from navloom_recording.reader import RawRecorded
from navloom_recording.step_inputs import Chosen, Fed, Feeder, Step


def command(speed: float) -> Command:
    return Command(Twist2D(speed, 0.0, 0.0))


def entry(key: str, message: Message, sequence: int, tick: int, place: int) -> Entry:
    data = encode(message, Envelope(key, sequence, tick, tick, tick, 0))
    return Entry(RawRecorded(key, schema_label(type(message)), memoryview(data), place, sequence), place)


def step(read: dict[str, tuple[int, ...]], tick: int = 5, epoch: int = 0, told: str = "", place: int = 10) -> Step:
    reads = tuple(InputRead(name, numbers) for name, numbers in read.items())
    report = StepReport("tick", reads, (), True, 0, 0, 0, "", told)
    return Step("node", "main", report, Envelope("lab/r1/node/main/step", 1, tick, tick, tick, epoch), place, place)


def feed(reading: Any, shelf: Shelf, one: Step, chosen: Chosen | None = None, delayed: bool = False) -> Fed:
    spec = NodeSpec("node", (Input("given", ControllerPorts.command, reading, delayed),), ())
    chosen = chosen or Chosen(load_config("paper").config)
    feeder = Feeder("lab/r1", shelf, chosen, {"controller": ("lyapunov_tracker@printed", "other")})
    return feeder.feed(spec, one, one.at.tick - 1)


@pytest.fixture
def shelf() -> Shelf:
    found = Shelf()
    for name, share in (("lyapunov_tracker@printed", 0.1), ("other", 0.2)):
        for number in range(1, 9):
            key = f"lab/r1/controller/{name}/command"
            found.put(entry(key, command(share * number), number, number, number))
    return found


def speeds(found: Any) -> list[float]:
    return [round(one.twist.vx, 6) for one in found]


def test_samples_news_and_tracks_are_found_by_number(shelf: Shelf) -> None:
    assert feed("latest", shelf, step({"given": (4,)})).given["given"].twist.vx == pytest.approx(0.4)
    assert feed("latest", shelf, step({"given": ()})).given["given"] is None
    assert speeds(feed("new", shelf, step({"given": (3, 4)})).given["given"]) == [0.3, 0.4]
    assert speeds(feed("track", shelf, step({"given": (1, 3, 5, 5)})).given["given"]) == [0.1, 0.2, 0.3, 0.5]
    message, at = feed("offers", shelf, step({"given": (2,)})).given["given"]
    assert (round(message.twist.vx, 6), at.sequence) == (0.2, 2)


def test_the_same_message_is_the_same_object_each_time(shelf: Shelf) -> None:
    first, again = (feed("latest", shelf, step({"given": (4,)})).given["given"] for _ in range(2))
    assert first is again


def test_a_missing_input_is_named(shelf: Shelf) -> None:
    found = feed("new", shelf, step({"given": (8, 9, 10)}))
    assert found.missing == ["given (controller.command number 9 and 1 more)"] and speeds(found.given["given"]) == [0.8]


def test_the_active_instance_is_read_and_waiting_messages_stay(shelf: Shelf) -> None:
    chosen = Chosen(load_config("paper").config)
    chosen.learn(Selection(1, 5, ("controller other",)))
    assert feed("latest", shelf, step({"given": (4,)}, epoch=1), chosen).given["given"].twist.vx == pytest.approx(0.8)
    assert feed("latest", shelf, step({"given": (4,)}, epoch=0), chosen).given["given"].twist.vx == pytest.approx(0.4)
    # Published in ticks 3 and 4 under the old selection, in 5 and 6 under the new one.
    found = feed("track", shelf, step({"given": (3, 6)}, tick=6, epoch=1), chosen)
    assert speeds(found.given["given"]) == [0.3, 0.4, 1.0, 1.2]


def test_inputs_that_a_record_does_not_name_are_found_by_tick(shelf: Shelf) -> None:
    assert speeds(feed("new", shelf, step({}, tick=5)).given["given"]) == [0.5]
    assert feed("latest", shelf, step({}, tick=5), delayed=True).given["given"].twist.vx == pytest.approx(0.4)


def test_requests_of_a_service_are_repeated(shelf: Shelf) -> None:
    told = '{"submitted": [{"do": "goal", "goal": [3, 1.0, 2.0, null, [[0.5, 0.5]]]}, {"do": "cancel", "goal": null}]}'
    found = feed("new", shelf, step({"given": (0, 0)}, told=told)).given["given"]
    assert found == (OperatorRequest("goal", Goal(3, 1.0, 2.0, None, (Point2D(0.5, 0.5),))), OperatorRequest("cancel"))


def test_of_equal_numbers_the_nearest_is_used_and_old_ones_are_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shelves, "MOST", 3)
    shelf = Shelf()
    key = "lab/r1/controller/other/command"
    for place, sequence in enumerate((1, 2, 3, 1, 2)):
        shelf.put(entry(key, command(0.1 * place), sequence, place, place))
    near = shelf.get(key, 2, 5)
    assert near is not None and near.place == 4 and len(shelf.recent(key)) == 3
    assert shelf.get(key, 3, 5) is not None and shelf.get(key, 9, 5) is None
    assert [one.place for one in shelf.recent(key)] == [2, 3, 4]

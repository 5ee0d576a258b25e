"""Steps and queues: what a node reads and publishes in its second and third step, as well as in its first."""

from __future__ import annotations

from collections import deque
from typing import Any

import pytest
from navloom.engine import stepper as stepper_module
from navloom.engine.node_ports import Input, Latest, New, NodeSpec, Offers, Output, Wired
from navloom.engine.nodes.node_base import Node, Tick
from navloom.engine.stepper import Stepper, waiting_words
from navloom.engine.streams import AvoiderPorts, ControllerPorts, GatePorts, LocalizerPorts
from navloom.engine.wiring import Slot, Wire, make_wire, runs
from navloom.messages import Command, Message, Twist2D


def command(vx: float) -> Command:
    return Command(Twist2D(vx, 0.0, 0.0))


def put(slot: Slot, number: int, tick: int, cause_ns: int = 0) -> Message:
    message = command(0.01 * number)
    slot.put(message, number, (tick, 50 * tick, cause_ns, 0), tick)
    return message


def wire_of(reading: Any, delayed: bool = False, triggers: bool = False) -> tuple[Any, Slot]:
    slot = Slot("key", "place")
    return make_wire(Input("in", AvoiderPorts.command, reading, delayed, triggers), slot), slot


def at(number: int) -> Tick:
    return Tick(number, 0.05 * number, 50 * number, 0)


# --- queues -----------------------------------------------------------------------------------------------------------


def test_a_queue_gives_the_messages_since_the_step_before_oldest_first() -> None:
    wire, slot = wire_of("new")
    wire.prepare(0, -1)
    assert wire.values == () and not wire.has_news(-1, 0)
    first, second = put(slot, 1, 1), put(slot, 2, 1)
    assert wire.has_news(0, 1) and wire.sequences(1, 0) == (1, 2)
    wire.prepare(1, 0)
    assert wire.values == (first, second)
    wire.prepare(2, 1)
    assert wire.values == ()
    third = put(slot, 3, 3)
    wire.prepare(3, 2)
    assert wire.values == (third,)
    wire.prepare(4, 3)
    assert wire.values == ()


@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize(("triggers", "is_read"), [(False, False), (True, True)])
def test_messages_of_before_count_only_where_they_make_the_node_step(count: int, triggers: bool, is_read: bool) -> None:
    """Of tick 1, read in tick 3 for what was published since tick 1."""
    wire, slot = wire_of("new", triggers=triggers)
    old = [put(slot, k, 1) for k in range(count)]
    assert wire.sequences(3, 1) == (tuple(range(count)) if is_read else ())
    wire.prepare(3, 1)
    assert wire.values == (tuple(old) if is_read else ())
    wire.prepare(4, 3)
    assert wire.values == (), "they are gone"


def test_one_message_of_this_tick_is_read() -> None:
    wire, slot = wire_of("new")
    new = put(slot, 1, 2)
    wire.prepare(2, 1)
    assert wire.values == (new,)


def test_a_delayed_queue_gives_what_was_published_before_this_tick() -> None:
    wire, slot = wire_of("new", delayed=True)
    first = put(slot, 1, 1)
    assert not wire.has_news(0, 1)
    wire.prepare(1, 0)
    assert wire.values == ()
    second, third = put(slot, 2, 2), put(slot, 3, 3)
    assert wire.has_news(0, 3) and wire.sequences(3, 9) == (1, 2)
    wire.prepare(3, 9)
    assert wire.values == (first, second), "whatever the last step was"
    wire.prepare(4, 3)
    assert wire.values == (third,)
    wire.prepare(5, 4)
    assert wire.values == () and not wire.has_news(0, 9)


def test_a_delayed_queue_of_one_message_keeps_it_for_the_next_tick() -> None:
    wire, slot = wire_of("new", delayed=True)
    only = put(slot, 1, 4)
    wire.prepare(4, 3)
    assert wire.values == ()
    wire.prepare(5, 4)
    assert wire.values == (only,)


def test_a_queue_that_is_redirected_keeps_what_waits_and_hears_no_more_of_the_old_slot() -> None:
    wire, old = wire_of("new")
    other, rest = Slot("other", "other"), deque[Any]()
    old.queues.append(rest)
    first = put(old, 1, 1)
    wire.lead_to(other)
    put(old, 2, 1)
    third = put(other, 1, 2)
    assert wire.slot is other and old.queues == [rest] and len(rest) == 2
    wire.prepare(2, 0)
    assert wire.values == (first, third)


def test_a_queue_keeps_1024_messages_and_a_track_4096() -> None:
    for reading, length in (("new", 1024), ("track", 4096)):
        wire, slot = wire_of(reading)
        for k in range(1, length + 3):
            put(slot, k, 1)
        assert len(wire.queue) == length and wire.queue[0][2] == 3


def test_a_track_gives_the_newest_messages_read_before_or_not() -> None:
    wire, slot = wire_of("track")
    messages = [put(slot, number, tick) for number, tick in ((1, 1), (2, 1), (4, 2), (7, 3), (8, 3))]
    for _ in range(2):
        assert list(wire.values) == messages and len(wire.values) == 5
        assert wire.values[-2] is messages[3] and list(reversed(wire.values)) == messages[::-1]
    assert wire.sequences(3, 2) == (1, 2, 4, 4, 7, 8)
    assert not wire.is_read_ahead


@pytest.mark.parametrize(
    ("numbers", "found"),
    [([], ()), ([5], (5, 5)), ([5, 6, 7], (5, 7)), ([1, 3], (1, 1, 3, 3)), ([1, 2, 4, 5, 9], (1, 2, 4, 5, 9, 9)),
     ([4, 4], (4, 4, 4, 4))],
)  # fmt: skip
def test_runs_of_numbers(numbers: list[int], found: tuple[int, ...]) -> None:
    assert runs(numbers) == found


# --- the newest message -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("reading", ["latest", "offers"])
def test_a_delayed_reader_has_the_newest_message_of_earlier_ticks(reading: str) -> None:
    wire, slot = wire_of(reading, delayed=True)
    wire.prepare(0, -1)
    assert wire.value is None and wire.sequences(0, -1) == () and not wire.has_news(-1, 0)
    first = put(slot, 1, 1)
    wire.prepare(1, 0)
    assert wire.value is None and not wire.has_news(-1, 1) and wire.sequences(1, 0) == ()
    wire.prepare(2, 1)
    assert wire.value is first and wire.has_news(0, 2) and not wire.has_news(1, 2)
    second = put(slot, 2, 2)
    wire.prepare(2, 1)
    assert wire.value is first and wire.sequences(2, 1) == (1,)
    put(slot, 3, 2)
    wire.prepare(3, 2)
    assert wire.value is slot.message and wire.sequences(3, 2) == (3,) and second is not slot.message
    assert wire.has_news(1, 2) is False and wire.has_news(0, 2) and wire.has_news(1, 3)


def test_a_delayed_reader_of_a_later_publisher_reads_the_slot() -> None:
    given, slot = Input("in", AvoiderPorts.command, "latest", True), Slot("key", "place")
    assert type(make_wire(given, slot, is_plain=True)) is type(make_wire(Input("in", AvoiderPorts.command), slot))
    assert type(make_wire(given, slot)) is not type(make_wire(given, slot, is_plain=True))
    assert type(make_wire(Input("in", AvoiderPorts.command, "new", True), slot, is_plain=True)).__name__ == "QueueWire"


def test_an_envelope_is_made_once_and_again_for_the_next_message() -> None:
    slot = Slot("key", "place")
    assert slot.envelope is None and (slot.tick, slot.sequence, slot.older) == (-1, 0, (None, 0, -1))
    put(slot, 1, 1)
    first = slot.envelope
    assert slot.envelope is first
    put(slot, 2, 1)
    assert slot.envelope is not first and slot.envelope is not None and slot.envelope.sequence == 2
    assert slot.label(Command) is slot.label(Command) and slot.label(Command).startswith(b"place ")


# --- steps ------------------------------------------------------------------------------------------------------------


class Passer(Node):
    """Passes on the newest command; breaks where it is asked to."""

    role = "gate"
    heard = Latest(AvoiderPorts.command, triggers=True)
    also = Latest(ControllerPorts.command, triggers=True)
    asked = New(LocalizerPorts.pose)
    command = Output(GatePorts.command)
    cause = Offers(AvoiderPorts.command)

    def __init__(self) -> None:
        self.breaks: BaseException | None = None

    def step(self, tick: Tick) -> None:
        self.command.put(self.heard.value)  # type: ignore[arg-type]
        if self.breaks is not None:
            raise self.breaks
        self.command.put(command(9.0))


def stepper_of(
    needed: tuple[str, ...] = (), ticks: bool = False, cause: str = "heard"
) -> tuple[Stepper, dict[str, Slot]]:
    """A stepper of a node with three inputs, and the slots of these."""
    node, plain = Passer(), Passer.spec(Wired("gate"))
    inputs = tuple(
        Input(given.name, given.source, given.reading, given.delayed, given.triggers, given.name in needed)
        for given in plain.inputs
    )
    spec = NodeSpec("gate", inputs, plain.ports, cause, ticks)
    slots = {given.name: Slot(given.name, given.name) for given in inputs}
    made = Stepper(spec, node, "main", {"command": Slot("out", "out")})
    made.connect([make_wire(given, slots[given.name]) for given in inputs])
    return made, slots


def test_only_a_new_message_makes_it_step_each_time() -> None:
    made, slots = stepper_of()
    assert made.fired(0) == ""
    put(slots["also"], 1, 1)
    assert made.fired(1) == "also"
    made.step(at(1), 0)
    assert made.stepped == 1 and made.fired(1) == "" and made.fired(2) == ""
    put(slots["heard"], 1, 2)
    put(slots["asked"], 1, 3)
    assert made.fired(2) == "heard"
    made.step(at(2), 1)
    assert made.fired(3) == "", "a message that does not trigger"
    put(slots["also"], 2, 3)
    assert made.fired(3) == "also"


def test_one_that_ticks_steps_in_every_tick_once_it_has_what_it_needs() -> None:
    made, slots = stepper_of(("also", "asked"), ticks=True)
    assert made.fired(1) == "" and made.lacks == ("controller.command", "localizer.pose")
    put(slots["also"], 1, 1)
    assert made.fired(1) == "" and made.lacks == ("localizer.pose",)
    put(slots["asked"], 1, 2)
    assert made.fired(2) == "tick" and made.lacks == () and not made.is_short(3)
    assert made.fired(3) == "tick"


def test_what_it_publishes_comes_in_order_and_is_new_in_each_step() -> None:
    made, slots = stepper_of()
    messages = []
    for tick in (1, 2):
        messages.append(put(slots["heard"], tick, tick))
        outputs = made.step(at(tick), tick - 1)
        assert [message for _, message in outputs] == [messages[-1], command(9.0)]
        assert all(out.name == "command" and out.slot is made.slots["command"] for out, _ in outputs)


@pytest.mark.parametrize("error", [ValueError("broke"), SystemExit(3)])
def test_a_step_that_fails_publishes_nothing_and_the_next_one_does(error: BaseException) -> None:
    made, slots = stepper_of()
    node: Any = made.node
    put(slots["heard"], 1, 1)
    node.breaks = error
    assert made.step(at(1), 0) == [] and made.fault != "" and made.stepped == 1
    assert made.busy_since_ns is None
    node.breaks = None
    assert len(made.step(at(2), 1)) == 2 and made.fault == ""


def test_it_says_how_long_a_step_took_and_since_when_it_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    times = iter([100, 130, 1000, 1007])
    monkeypatch.setattr(stepper_module, "monotonic_ns", lambda: next(times))
    made, seen = stepper_of()[0], list[int | None]()
    assert (made.spent_ns, made.busy_since_ns, made.stepped) == (0, None, -1)
    for spent in (30, 7):
        made.run(at(1), lambda tick: seen.append(made.busy_since_ns))
        assert made.spent_ns == spent and made.busy_since_ns is None
    assert seen == [100, 1000]


def test_its_outputs_derive_from_its_cause() -> None:
    made, slots = stepper_of()
    assert made.cause_of(700) == 700, "nothing has been heard yet"
    for number in (1, 2):
        put(slots["heard"], number, number, cause_ns=100 * number)
        put(slots["also"], number, number, cause_ns=999)
        assert made.cause_of(700) == 100 * number
    assert stepper_of(cause="")[0].cause_of(700) == 700


def test_what_it_would_read_is_told_by_input() -> None:
    made, slots = stepper_of()
    put(slots["heard"], 4, 1)
    for number in (1, 2):
        put(slots["asked"], number, number)
    assert made.read_marks(2, 0) == (("heard", (4,)), ("also", ()), ("asked", (1, 2)))
    assert made.read_marks(2, 1) == (("heard", (4,)), ("also", ()), ("asked", (2,)))
    made.prepare(2, 1)
    node: Any = made.node
    assert list(node.asked.values) == [command(0.02)]


def test_outputs_are_held_back_for_the_delay_in_order() -> None:
    made, _ = stepper_of()
    made.delay = 2
    first, second, third = ([(object(), command(k))] for k in (1.0, 2.0, 3.0))
    made.hold_back(first, at(3), 30)  # type: ignore[arg-type]
    made.hold_back(second, at(3), 31)  # type: ignore[arg-type]
    made.hold_back(third, at(4), 40)  # type: ignore[arg-type]
    assert made.due(4) == []
    assert made.due(5) == [(first, at(3), 30), (second, at(3), 31)]
    assert made.due(5) == [] and made.due(6) == [(third, at(4), 40)]


def test_which_streams_an_instance_waits_for() -> None:
    assert waiting_words("mapper", "main", ()) == ""
    assert waiting_words("mapper", "main", ("a.b", "c.d")) == "mapper main for a.b and c.d"


def test_a_wire_of_its_own_gives_itself() -> None:
    wire = Wire(Input("in", AvoiderPorts.command), Slot("key", "place"))
    attributes: dict[str, Any] = {}
    wire.bind(attributes, "name")
    assert attributes == {"name": wire} and wire.queue is None

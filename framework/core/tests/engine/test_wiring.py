"""Slots and wires: envelopes are made when read, and inputs can be redirected to another instance."""

from __future__ import annotations

from navloom.engine.node_ports import Latest, Offers, Wired
from navloom.engine.nodes.node_base import Node, Tick
from navloom.engine.stepper import Stepper
from navloom.engine.streams import AvoiderPorts, LocalizerPorts
from navloom.engine.wiring import Slot, make_wire
from navloom.messages import Command, Envelope, Message, Odometry, Pose2D, Twist2D


def command(vx: float) -> Command:
    return Command(Twist2D(vx, 0.0, 0.0))


class Reader(Node):
    """Reads a command, and another one with when it was made."""

    ticks = True
    plain = Latest(AvoiderPorts.command)
    dated = Offers(AvoiderPorts.command)
    unread = Latest(LocalizerPorts.pose)

    def step(self, tick: Tick) -> None:
        """Nothing is published."""


def test_an_envelope_is_numbered_and_dated_by_its_step() -> None:
    slot = Slot("lab/r1/avoider/main/command", "avoider main command")
    slot.put(command(0.1), 1, (4, 200, 150, 2), 4)
    assert slot.envelope == Envelope("lab/r1/avoider/main/command", 1, 4, 200, 150, 2)


def test_a_watcher_is_given_the_envelope_of_the_message() -> None:
    slot, seen = Slot("key", "place"), list[tuple[Message, Envelope]]()
    slot.watchers.append(lambda message, at: seen.append((message, at)))
    given = command(0.1)
    slot.put(given, 7, (4, 200, 150, 2), 4)
    assert seen == [(given, Envelope("key", 7, 4, 200, 150, 2))]


def test_a_message_that_came_in_an_envelope_keeps_it() -> None:
    slot, at = Slot("key", "place"), Envelope("other", 9, 4, 200, 150, 2)
    slot.take(command(0.1), at, 5)
    assert slot.envelope is at
    assert (slot.sequence, slot.when, slot.tick) == (9, (4, 200, 150, 2), 5)


def test_a_reader_of_the_ticks_before_is_given_the_message_of_the_tick_before() -> None:
    slot, first = Slot("key", "place"), command(0.1)
    slot.put(first, 1, (3, 150, 150, 0), 3)
    slot.put(command(0.2), 2, (4, 200, 200, 0), 4)
    slot.put(command(0.3), 3, (4, 200, 200, 0), 4)
    assert slot.older == (first, 1, 3)


def test_inputs_that_are_redirected_to_another_instance_read_it() -> None:
    old, new, pose = Slot("old", "old"), Slot("new", "new"), Slot("pose", "pose")
    old.put(command(0.1), 1, (3, 150, 150, 0), 3)
    new.put(command(0.2), 5, (3, 150, 140, 1), 3)
    node, spec = Reader(), Reader.spec(Wired("reader"))
    stepper = Stepper(spec, node, "main", {})
    stepper.connect([make_wire(given, pose if given.name == "unread" else old) for given in spec.inputs])
    assert (node.plain.value, node.dated.when) == (command(0.1), (3, 150, 150, 0))
    for wire in stepper.wires[:2]:
        wire.lead_to(new)
    assert (node.plain.value, node.dated.when) == (command(0.2), (3, 150, 140, 1))
    assert node.unread.value is None


def test_readers_of_a_late_sensor_receive_the_time_of_its_measurement_and_watchers_its_stamp() -> None:
    slot, seen = Slot("key", "place", offset_ns=-120), list[Message]()
    slot.watchers.append(lambda message, at: seen.append(message))
    given = Odometry(500, Pose2D(1.0, 0.0, 0.0), Twist2D(0.0, 0.0, 0.0))
    slot.put(given, 1, (4, 500, 500, 0), 4)
    assert seen == [given]
    assert slot.message == Odometry(380, given.pose, given.twist)


def test_a_corrected_stamp_is_not_before_the_beginning_of_the_run_clock() -> None:
    slot = Slot("key", "place", offset_ns=-120)
    slot.put(Odometry(50, Pose2D(1.0, 0.0, 0.0), Twist2D(0.0, 0.0, 0.0)), 1, (1, 50, 50, 0), 1)
    assert slot.message is not None and vars(type(slot.message))["stamp_ns"].__get__(slot.message) == 0

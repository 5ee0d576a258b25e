"""Mailboxes: bounded, counted, and robust against malformed messages."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import pytest
from navloom.messages import Command, Contact, Envelope, Message, StepReport
from navloom.messages.bounds import size_limit
from navloom.messages.codec import encode, schema_label
from navloom_live.live.mailbox import Inlet, Mailbox, Packet
from navloom_live.live.process_streams import Switchboard
from navloom_live.transport.keyspace import KeySpace

KEY = "lab/r1/platform/p/contact"


def packet(sequence: int, touching: bool = True) -> Packet:
    return Packet(encode(Contact(touching), Envelope(KEY, sequence, sequence, 0, 0, 0)), schema_label(Contact))


def sequences(inlet: Inlet) -> list[int]:
    return [envelope.sequence for _, envelope in inlet.take()]


def test_a_full_stream_drops_its_oldest_and_counts_it() -> None:
    inlet = Inlet(KEY, Mailbox(), 2)
    for number in range(1, 6):
        inlet.give(packet(number))
    assert sequences(inlet) == [4, 5]
    assert (inlet.counts.received, inlet.counts.dropped) == (5, 3)


def test_a_flood_of_one_stream_takes_nothing_from_another() -> None:
    mailbox = Mailbox()
    flooded, quiet = Inlet(KEY, mailbox, 16), Inlet("lab/r1/x/y/z", mailbox, 16)
    quiet.give(packet(1))
    for _ in range(10_000):
        flooded.give(Packet(b"\x00" * 40, "navloom.Contact/1"))
    assert sequences(quiet) == [1]
    assert sequences(flooded) == []
    assert (flooded.counts.dropped, flooded.counts.malformed) == (10_000 - 16, 16)
    assert "navloom.Contact/1" in flooded.counts.complaint


@pytest.mark.parametrize("limit", [1, 16])
def test_an_answer_to_a_query_is_dropped_if_the_stream_has_brought_a_newer_message(limit: int) -> None:
    inlet = Inlet(KEY, Mailbox(), limit)
    inlet.give(packet(4))
    asked_ns = time.monotonic_ns()
    data, label = packet(5).data, schema_label(Contact)
    inlet.give(Packet(data, label, KEY, asked_ns=asked_ns))
    assert sequences(inlet)[-1] == 5  # nothing newer has come
    inlet.give(packet(6))
    inlet.give(Packet(data, label, KEY, asked_ns=asked_ns))
    assert sequences(inlet) == [6]
    assert inlet.counts.late == 1


def test_a_message_is_decoded_once_for_all_readers() -> None:
    mailbox, shared = Mailbox(), packet(1)
    first, second = Inlet(KEY, mailbox, 1), Inlet(KEY, mailbox, 1)
    first.give(shared)
    second.give(shared)
    [(one, _)], [(other, _)] = list(first.take()), list(second.take())
    assert one is other


def test_a_message_from_the_same_process_arrives_as_it_is() -> None:
    inlet = Inlet(KEY, Mailbox(), 1)
    message: Message = Contact(False)
    inlet.give((message, Envelope(KEY, 1, 1, 0, 0, 0)))
    assert next(inlet.take())[0] is message


def test_ages_are_kept_where_the_clock_is_known() -> None:
    ages = iter([0.5, None, 0.25])
    inlet = Inlet(KEY, Mailbox(), None, lambda cause: next(ages))
    for number in range(3):
        inlet.give(packet(number))
    list(inlet.take())
    summary = inlet.counts.summary(latest=False)
    assert (summary.age_p50_s, summary.age_p99_s) == (0.5, 0.5)


def test_waiting_ends_with_a_message_or_a_time_out() -> None:
    mailbox = Mailbox()
    assert mailbox.wait(0, 0.0) == 0
    inlet = Inlet(KEY, mailbox, 1)
    thread = threading.Thread(target=lambda: inlet.give(packet(1)))
    thread.start()
    assert mailbox.wait(0, 10.0) == 1
    thread.join()
    assert mailbox.wait(0, 10.0) == 1  # a message that is unread already ends the wait at once


def test_of_many_simultaneous_wake_ups_none_is_lost() -> None:
    mailbox, each, givers = Mailbox(), 3000, 4
    inlets = [Inlet(KEY, mailbox, None) for _ in range(givers)]
    shared = packet(1)

    def give(inlet: Inlet) -> None:
        for _ in range(each):
            inlet.give(shared)

    def listen() -> None:
        heard = seen = 0
        while heard < each * givers:
            seen = mailbox.wait(seen, None)  # blocks for ever if a wake-up is lost
            heard += sum(len(list(inlet.take())) for inlet in inlets)

    listening = threading.Thread(target=listen, daemon=True)
    threads = [listening, *(threading.Thread(target=give, args=(inlet,)) for inlet in inlets)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(30.0)
    assert not listening.is_alive()
    assert mailbox.news == each * givers


def test_a_message_of_another_kind_is_malformed_and_one_of_another_stream_misrouted() -> None:
    inlet = Inlet(KEY, Mailbox(), 4)
    data, label = packet(1).data, packet(1).label
    inlet.give(Packet(data, label, KEY, Contact))
    inlet.give(Packet(data, label, "lab/r1/platform/q/contact", Contact))
    inlet.give(Packet(data, label, KEY, StepReport))
    assert sequences(inlet) == [1]
    assert (inlet.counts.malformed, inlet.counts.misrouted) == (1, 1)
    assert inlet.counts.complaint == f"Contact arrived on {KEY}, which carries StepReport"
    assert inlet.counts.summary(latest=False).origin == KEY


def test_a_message_too_large_for_its_stream_is_counted_and_dropped() -> None:
    class Bus:
        def subscribe(self, key: str, receive: Callable[[str, bytes | None, str], None], most: int) -> None:
            self.receive, self.most = receive, most

    bus, keys = Bus(), KeySpace("lab", "r1")
    board = Switchboard(bus, keys, False)  # type: ignore[arg-type]
    inlet = board.inlet(("gate", "main"), "command", Mailbox(), 1)
    board.connect()
    assert bus.most == size_limit(Command) and bus.most < 700
    bus.receive(inlet.key, None, schema_label(Command))
    assert (inlet.counts.received, inlet.counts.malformed) == (1, 1) and not list(inlet.take())
    assert inlet.counts.complaint == f"no Command is larger than {bus.most} bytes"


def test_a_message_caused_in_the_future_is_refused_and_does_not_hide_later_ones() -> None:
    inlet = Inlet(KEY, Mailbox(), 8, lambda cause_ns: (10_000_000_000 - cause_ns) * 1e-9)
    for cause in (9.9, 15.0, 10.0, 10.4):
        inlet.give((Contact(False), Envelope(KEY, 1, 1, 0, round(cause * 1e9), 0)))
    assert [at.cause_ns for _, at in inlet.take()] == [9_900_000_000, 10_000_000_000, 10_400_000_000]
    assert inlet.counts.malformed == 1 and "5.0 s in the future" in inlet.counts.complaint


def test_the_platforms_own_messages_are_never_ahead_of_the_clock() -> None:
    inlet = Inlet(KEY, Mailbox(), 8, lambda cause_ns: (10_000_000_000 - cause_ns) * 1e-9, tells_time=True)
    inlet.give((Contact(False), Envelope(KEY, 1, 1, 0, 15_000_000_000, 0)))  # after a gap of 5 s
    assert len(list(inlet.take())) == 1 and inlet.counts.malformed == 0


def test_a_stream_that_does_not_trigger_wakes_its_reader_only_on_request() -> None:
    mailbox = Mailbox()
    quiet = Inlet(KEY, mailbox, 4, rings=False)
    quiet.give(packet(1))
    assert mailbox.wait(0, 0.0) == 0 and quiet.has_news
    quiet.listen()  # the message is there already: the node must read it
    assert mailbox.wait(0, 5.0) == 1
    quiet.give(packet(2))
    assert mailbox.wait(1, 5.0) == 2 and len(list(quiet.take())) == 2

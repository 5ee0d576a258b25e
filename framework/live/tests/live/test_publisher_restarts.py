"""A restart of a publisher is distinguished from a late message."""

from __future__ import annotations

import pytest
from navloom.messages import Envelope
from navloom_live.live import publisher_restarts
from navloom_live.live.publisher_restarts import BACKWARDS, RestartWatch, RivalWatch
from navloom_live.timing import RIVAL_WINDOW


def at(sequence: int, tick: int) -> Envelope:
    return Envelope("lab/r1/platform/p/step", sequence, tick, 0, 0, 0)


@pytest.mark.parametrize(
    ("sequence", "tick", "has_restarted"),
    [
        (500, 900, False),  # the same message again
        (501, 901, False),  # the next
        (510, 910, False),  # some were lost
        (1, 940, True),  # its process restarted, and the run clock continues
        (1, 0, True),  # the run clock restarted too
        (480, 880, False),  # delayed by a cut cable, and overtaken
        (500 - BACKWARDS, 900 - BACKWARDS, True),  # no message is delayed for so long
    ],
)
def test_a_restarted_publisher_is_distinguished_from_a_delayed_message(
    sequence: int, tick: int, has_restarted: bool
) -> None:
    watch = RestartWatch()
    assert not watch.has_restarted(at(500, 900))
    assert watch.has_restarted(at(sequence, tick)) is has_restarted


def test_a_restart_is_found_once_and_a_late_message_before_it_does_not_hide_it() -> None:
    watch = RestartWatch()
    envelopes = [at(500, 900), at(480, 880), at(1, 940), at(499, 899), at(2, 941), at(1, 970)]
    assert [watch.has_restarted(envelope) for envelope in envelopes] == [False, False, True, False, False, True]


def is_split(*messages: tuple[int, float]) -> bool:
    """Whether two publishers are found in (sequence number, run clock in s), of which none is delayed but late ones."""
    watch, now = RivalWatch(), [0.0]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(publisher_restarts.time, "monotonic", lambda: now[0])
        for sequence, stamp in messages:
            now[0] = max(now[0], stamp)
            watch.note(sequence, round(stamp * 1e9))
        return watch.is_split


def turns(first: int, second: int, count: int) -> list[tuple[int, float]]:
    """Messages of two processes that both publish in each tick of 50 ms."""
    return [(begin + n, 0.05 * n) for n in range(count) for begin in (first, second)]


@pytest.mark.parametrize("second", [20, 499, 501, 503, 9000])
def test_two_publishers_are_found_within_four_ticks_however_near_their_numbers_are(second: int) -> None:
    assert is_split(*turns(500, second, 4))


def test_two_publishers_are_found_although_half_of_the_messages_are_lost() -> None:
    assert is_split(*turns(500, 20, 12)[::3])


@pytest.mark.parametrize(
    "messages",
    [
        [(n, 0.05 * n) for n in range(1, 50)],  # one process
        [(n, 0.05 * n) for n in range(1, 50, 3)],  # of which messages are lost
        [(n, 0.05 * n) for n in range(1, 50) for _ in range(2)],  # each arrives by two links
        [*((n, 0.05 * n) for n in range(400, 500)), *((n, 20.0 + 0.05 * n) for n in range(1, 600))],  # a restart
        [(n, 1.0 * life + 0.05 * n) for life in range(9) for n in range(1, 4 + life % 3)],  # it dies again and again
        [one for n in range(20) for one in ((500 + n, 25.0 + 0.05 * n), (480 + n, 24.0 + 0.05 * n))],  # a delayed part
        [(500, 25.0), (502, 25.1), (501, 25.05), (503, 25.15), (504, 25.2), (505, 25.25)],  # one is overtaken
    ],
    ids=["one", "losses", "doubled", "restart", "crashes", "delayed", "overtaken"],
)
def test_one_publisher_is_never_taken_for_two(messages: list[tuple[int, float]]) -> None:
    assert not is_split(*messages)


def test_once_only_one_is_heard_it_counts_as_the_only_one(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [100.0]
    monkeypatch.setattr(publisher_restarts.time, "monotonic", lambda: now[0])
    watch = RivalWatch()
    for sequence, stamp in turns(500, 20, 4):
        watch.note(sequence, round(stamp * 1e9))
    assert watch.is_split
    now[0] += RIVAL_WINDOW
    watch.note(504, 200_000_000)
    assert not watch.is_split

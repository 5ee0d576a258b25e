"""A restart of a publisher is distinguished from a late message."""

from __future__ import annotations

import pytest
from navloom.live.restarts import BACKWARDS, RestartWatch
from navloom.messages import Envelope


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
    assert [watch.has_restarted(one) for one in envelopes] == [False, False, True, False, False, True]

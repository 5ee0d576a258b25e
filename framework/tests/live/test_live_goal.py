"""What a live goal makes of the platform's reports."""

from __future__ import annotations

import pytest
from navloom.live.live import BACKWARDS
from navloom.live.live_goal import began_anew
from navloom.messages import Envelope


@pytest.mark.parametrize(
    ("sequence", "tick", "is_new"),
    [
        (501, 901, False),  # the next
        (510, 910, False),  # some were lost
        (1, 940, True),  # its process was started again, and its clock goes on
        (1, 0, True),  # and so was its supervisor
        (480, 880, False),  # held up by a cut cable, and overtaken
        (500 - BACKWARDS, 900 - BACKWARDS, True),  # nothing is held up for as long
    ],
)
def test_a_platform_that_began_anew_is_told_from_a_report_that_was_held_up(
    sequence: int, tick: int, is_new: bool
) -> None:
    key = "lab/r1/platform/p/step"
    last = Envelope(key, 500, 900, 0, 0, 0)
    assert began_anew(last, Envelope(key, sequence, tick, 0, 0, 0)) is is_new

"""The kinds of stops: each has a row in the one table, and each reason has one text."""

from __future__ import annotations

from string import Formatter
from typing import get_args

import pytest
from navloom.messages import StopReason
from navloom.messages.stop_reasons import STOPS, StopKind

KINDS = get_args(StopKind)
TEXTS = {
    "operator": StopReason("operator"),
    "no room to turn": StopReason("no_room"),
    "silent: platform": StopReason("silent_platform"),
    "silent: sensor laser": StopReason("silent_sensor", "laser"),
    "silent: avoider": StopReason("silent", "avoider"),
    "stale: operator desk": StopReason("stale_operator", "desk"),
    "stale: goal main": StopReason("goal_late"),
    "stale: controller law": StopReason("stale", "controller law"),
    "waits: avoider vfh for platform.laser and people.tracks": StopReason(
        "waits", "avoider vfh", "platform.laser and people.tracks"
    ),
    "waits: avoider vfh": StopReason("waits", "avoider vfh"),
    "rivals: controller main on host a (process 1) and on host b (process 2)": StopReason(
        "rivals", "controller main", "on host a (process 1) and on host b (process 2)"
    ),
    "gone: goal main does not step": StopReason("goal_halted"),
    "gone: localizer odometry": StopReason("gone", "localizer odometry"),
    "a reason of another version": StopReason("other", "a reason of another version"),
}


def test_every_kind_has_a_row() -> None:
    assert set(STOPS) == set(KINDS)


@pytest.mark.parametrize("kind", KINDS)
def test_every_row_says_what_it_is_and_what_to_do(kind: StopKind) -> None:
    stop = STOPS[kind]
    assert stop.words and stop.remedy
    named = {name for text in (stop.words, stop.remedy, stop.advice) for _, name, _, _ in Formatter().parse(text)}
    assert named <= {None, "who", "of", "limit", "stream"}


@pytest.mark.parametrize("kind", KINDS)
def test_the_text_of_every_kind_is_read_as_that_kind(kind: StopKind) -> None:
    takes_who = not STOPS[kind].text or STOPS[kind].text.endswith(" ")
    reason = StopReason(kind, "mapper other" if takes_who else "", "a thing" if STOPS[kind].joint else "")
    assert StopReason.parse(reason.text) == reason


@pytest.mark.parametrize("text", TEXTS)
def test_the_texts_of_version_1_are_read(text: str) -> None:
    assert StopReason.parse(text) == TEXTS[text] and TEXTS[text].text == text


def test_a_reason_in_words_names_who_and_the_first_stream() -> None:
    words, remedy = StopReason("waits", "avoider vfh", "platform.laser and people.tracks").in_words()
    assert words == "avoider vfh waits for platform.laser and people.tracks"
    assert remedy.startswith("`navloom hz platform/laser` shows")


def test_no_text_is_no_reason() -> None:
    assert StopReason.parse("") is None

"""Presence of nodes: one that appears and disappears all the time costs the others little."""

from __future__ import annotations

import threading
import time

from navloom_live.live.presence import LIVES, MEET_INTERVAL, Presence
from navloom_live.transport.keyspace import KeySpace

KEYS = KeySpace("lab", "r1")
SHADOW = ("avoider", "shadow")
SOON = 10.0


def test_an_instance_is_present_while_one_of_its_tokens_is() -> None:
    presence = Presence(KEYS, [("gate", "main")], lambda source, again: None)
    for life, alive in (("a", True), ("b", True), ("a", False)):
        presence.change(KEYS.alive(*SHADOW, life), alive)
    assert presence.is_alive(SHADOW) and presence.is_alive(("gate", "main"))
    presence.change(KEYS.alive(*SHADOW, "b"), False)
    assert not presence.is_alive(SHADOW)


def test_more_lives_than_a_robot_has_are_not_heeded() -> None:
    came: list[bool] = []
    presence = Presence(KEYS, [], lambda source, again: came.append(again))
    for number in range(5000):
        presence.change(KEYS.alive(*SHADOW, str(number)), True)
    assert len(came) == LIVES
    for number in range(5000):
        presence.change(KEYS.alive(*SHADOW, str(number)), False)
    assert not presence.is_alive(SHADOW)


def test_a_flapping_instance_is_greeted_rarely_and_delays_no_other() -> None:
    presence = Presence(KEYS, [], lambda source, again: None)
    met: list[tuple[str, str]] = []
    other, ending = threading.Event(), threading.Event()

    def meet(source: tuple[str, str]) -> None:
        met.append(source)
        if source != SHADOW:
            other.set()

    following = threading.Thread(target=presence.follow, args=(meet, ending.is_set))
    following.start()
    for number in range(2000):
        presence.change(KEYS.alive(*SHADOW, str(number)), True)
        presence.change(KEYS.alive(*SHADOW, str(number)), False)
    presence.change(KEYS.alive("mapper", "m", "1"), True)
    assert other.wait(SOON)
    presence.change(KEYS.alive(*SHADOW, "last"), True)  # the last appearance is greeted as well, MEET_INTERVAL s later
    limit = time.monotonic() + SOON
    while met.count(SHADOW) < 2 and time.monotonic() < limit:
        time.sleep(MEET_INTERVAL / 10)
    assert met.count(SHADOW) >= 2
    ending.set()
    following.join(SOON)
    assert met.count(("mapper", "m")) == 1
    assert 1 <= met.count(SHADOW) <= 20

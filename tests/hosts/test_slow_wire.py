"""The model of the slow cable has the rate, delay and loss that were requested."""

from __future__ import annotations

import random

from slow_wire import QUEUE, Direction


def way(loss: float = 0.0) -> Direction:
    return Direction(8000.0, 0.5, loss, random.Random(1))


def test_frames_leave_one_after_the_other_and_arrive_the_delay_later() -> None:
    cable = way()
    cable.enter(b"x" * 100, 10.0)  # 0.1 s at 8000 bit/s
    cable.enter(b"y" * 200, 10.0)
    assert round(cable.wait(10.0), 6) == 0.6
    assert cable.due(10.59) == []
    assert cable.due(10.61) == [b"x" * 100]
    assert cable.due(10.79) == []
    assert cable.due(10.81) == [b"y" * 200]
    assert cable.wait(11.0) == float("inf")


def test_a_share_of_the_frames_is_lost() -> None:
    cable = way(loss=0.2)
    for number in range(QUEUE):
        cable.enter(b"x", float(number))
    assert 0.75 * QUEUE < len(cable.due(1e9)) < 0.85 * QUEUE


def test_a_full_queue_loses_further_frames() -> None:
    cable = way()
    for _ in range(QUEUE + 5):
        cable.enter(b"x", 0.0)
    assert len(cable.due(1e9)) == QUEUE

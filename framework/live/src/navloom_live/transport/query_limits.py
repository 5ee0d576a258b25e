"""Limits on queries: size, nesting, rank and rate, all checked before a query is handled."""

from __future__ import annotations

import json
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

from navloom.errors import NavloomError

from navloom_live.transport.zenoh_bus import Question

__all__ = [
    "RANKS",
    "TOO_MANY",
    "WAITING",
    "Allowance",
    "Desk",
    "KeptJson",
    "QuestionError",
    "largest_of",
    "read_question",
]

LARGEST, LARGEST_LIST = 1024, 65_536
"""Largest query, and largest one that may hold a list (via points or parameters), bytes."""
DEEPEST = 16
"""Deepest nesting of lists and objects; a goal's list of points has three levels."""
RANKS: Mapping[str, int] = {
    "stop": 0,
    **dict.fromkeys(("cancel", "resume", "release"), 1),
    **dict.fromkeys(("submit", "swap", "enter_unseen", "place", "replan", "params/set", "memory", "add", "extend"), 2),
    **dict.fromkeys(("relocalise", "plan", "clear", "limit"), 2),
}
"""Rank of each service, 0 for the most important. Services that only read come last."""
READING = 3
"""Rank of a service that is not in RANKS, and number of the last rank."""
WAITING = 64
"""Most waiting queries of one rank."""
RATE, BURST = 100.0, 100.0
"""Answered queries of one service: in the long run, Hz, and at once."""
REFUSALS = 20.0
"""Refusals of one process: in the long run, Hz, and at once. Further queries are dropped without a refusal, which costs
as much as an answer."""
TOO_MANY = "too many requests: try again in 1 s"
"""Refusal of a query beyond the rate."""
CACHE_AGE = 0.05
"""How long an answer that only reads may be reused, s."""
_BRACKETS = b"[]{}"
_OTHERS = bytes(set(range(256)) - set(_BRACKETS))


class QuestionError(NavloomError, ValueError):
    """A query is refused. The text says why."""


class Allowance:
    """A token bucket: a rate limit that allows bursts.

    Args:
        rate: Tokens per second in the long run.
        burst: Most tokens that may be spent at once.
    """

    def __init__(self, rate: float, burst: float) -> None:
        self._rate, self._burst = rate, burst
        self._left, self._at = burst, time.monotonic()

    def spend(self, cost: float = 1.0) -> bool:
        """Spend tokens if there are enough; returns whether there were."""
        now = time.monotonic()
        self._left = min(self._burst, self._left + (now - self._at) * self._rate)
        self._at = now
        if self._left < cost:
            return False
        self._left -= cost
        return True


class Desk:
    """Answers the queries to one process, the most important first.

    There is one thread for each rank. It answers queries of its own rank and of more important ones, so that a query
    never waits for a less important one, and queries that only read occupy at most one thread.
    """

    def __init__(self) -> None:
        self._waiting: list[deque[tuple[Question, Callable[[Question], None]]]] = [
            deque() for _ in range(READING + 1)
        ]  # fmt: skip
        self._news = threading.Condition()
        self._refusals = Allowance(REFUSALS, REFUSALS)
        for rank in range(READING + 1):
            # Started at once: a thread that is made on demand comes late for a stop.
            threading.Thread(target=self._work, args=(rank,), name=f"service {rank}", daemon=True).start()

    def window(self, service: str, answer: Callable[[Question], None]) -> Callable[[Question], None]:
        """A callback that takes a service's queries on the network's thread and has them answered on another thread."""
        allowance, largest, waiting = Allowance(RATE, BURST), largest_of(service), self._waiting[rank_of(service)]

        def take(question: Question) -> None:
            if question.size > largest:
                self._refuse(question, f"a request of {question.size} bytes: {service} takes at most {largest}")
            # Before it is queued: a flood must not fill the memory of a robot.
            elif len(waiting) >= WAITING or not allowance.spend():
                self._refuse(question, TOO_MANY)
            else:
                with self._news:
                    waiting.append((question, answer))
                    # All, since threads of lower ranks may answer it as well.
                    self._news.notify_all()

        return take

    def _refuse(self, question: Question, reason: str) -> None:
        if self._refusals.spend():
            question.refuse(reason)
        else:
            question.drop()

    def _work(self, rank: int) -> None:
        own = self._waiting[: rank + 1]
        while True:
            with self._news:
                self._news.wait_for(lambda: any(own))
                # The most important one first, even for the thread of the lowest rank.
                question, answer = next(queue for queue in own if queue).popleft()
            try:
                answer(question)
            except Exception as error:  # if the thread ended, a whole rank would get no answers
                question.refuse(f"request not understood: {type(error).__name__}: {error}")


class KeptJson:
    """A JSON object that is cached for CACHE_AGE, except for entries that are always new.

    Args:
        make: Makes the entries that may be cached.
        now: Makes the entries that must be new.
    """

    def __init__(self, make: Callable[[], Mapping[str, Any]], now: Callable[[], Mapping[str, Any]]) -> None:
        self._make, self._now = make, now
        self._kept, self._made = b"", -1.0

    def to_bytes(self) -> bytes:
        """The JSON object."""
        time_now = time.monotonic()
        if self._made < 0.0 or time_now - self._made > CACHE_AGE:
            self._kept, self._made = json.dumps(self._make()).encode(), time_now
        # Joined as text: the cached part is large, and dumping it again would defeat the cache.
        return self._kept[:-1] + b", " + json.dumps(self._now()).encode()[1:]


def rank_of(service: str) -> int:
    """Rank of a service, 0 for the most important."""
    return RANKS.get(service, READING)


def largest_of(service: str) -> int:
    """Largest query to a service, bytes."""
    return LARGEST_LIST if service in ("submit", "params/set") else LARGEST


def read_question(data: bytes) -> dict[str, Any]:
    """The JSON object of a query; an empty query is an empty object.

    Raises:
        QuestionError: It is no JSON object, or nested more than DEEPEST levels deep.
    """
    if not data:
        return {}
    depth = 0
    # Counted before parsing: Python's parser recurses, and a thousand levels would overflow its stack.
    for bracket in data.translate(None, _OTHERS):  # brackets in a string count too; no request has many
        depth += 1 if bracket in b"[{" else -1
        if depth > DEEPEST:
            raise QuestionError(f"request not understood: nested more than {DEEPEST} levels deep")
    try:
        given = json.loads(data.decode())
    except ValueError as error:
        raise QuestionError(f"request not understood: {error}") from None
    if not isinstance(given, dict):
        raise QuestionError(f"request not understood: got {type(given).__name__}, expected an object")
    return given

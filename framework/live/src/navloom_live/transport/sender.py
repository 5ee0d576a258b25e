"""Sends messages and answers on its own thread, for callers that must never wait for a router."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress

__all__ = ["Sender"]

MOST = 32 * 2**20
"""Largest queue of messages to send, bytes: beyond it the oldest message is dropped."""
LEAST = 1024
"""Smallest size that a message counts as, bytes."""


class Sender:
    """A thread that sends messages in the order in which it received them."""

    def __init__(self) -> None:
        self._waiting: deque[tuple[int, Callable[[], None]]] = deque()
        self._size = 0
        self._news = threading.Condition()
        self._is_ending = False
        threading.Thread(target=self._run, name="sender", daemon=True).start()

    def hand(self, send: Callable[[], None], size: int) -> None:
        """Queue a message of `size` bytes; returns at once."""
        with self._news:
            # Small messages cost memory too; counted as zero bytes, they would have no limit.
            self._waiting.append((max(LEAST, size), send))
            self._size += self._waiting[-1][0]
            # The oldest: by now it is of least use.
            while self._size > MOST:
                self._size -= self._waiting.popleft()[0]
            self._news.notify()

    def close(self) -> None:
        """Stop sending; waiting messages are dropped."""
        with self._news:
            self._is_ending = True
            self._waiting.clear()
            self._news.notify()

    def _run(self) -> None:
        while True:
            with self._news:
                self._news.wait_for(lambda: self._waiting or self._is_ending)
                if self._is_ending:
                    return
                size, send = self._waiting.popleft()
                self._size -= size
            with suppress(Exception):  # one failed answer must not end the thread
                send()

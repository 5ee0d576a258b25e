"""Sends in the place of those who publish and answer, who must never wait for a router."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress

__all__ = ["Sender"]

MOST = 32 * 2**20
"""Bytes that wait to be sent, at most: beyond them the oldest message is dropped."""
LEAST = 1024
"""Bytes that a small message counts as."""


class Sender:
    """A thread that sends, in the order in which messages were handed to it."""

    def __init__(self) -> None:
        self._waiting: deque[tuple[int, Callable[[], None]]] = deque()
        self._size = 0
        self._news = threading.Condition()
        self._is_ending = False
        threading.Thread(target=self._run, name="sender", daemon=True).start()

    def hand(self, send: Callable[[], None], size: int) -> None:
        """Have a message of so many bytes sent; returns at once."""
        with self._news:
            self._waiting.append((max(LEAST, size), send))
            self._size += self._waiting[-1][0]
            while self._size > MOST:
                self._size -= self._waiting.popleft()[0]
            self._news.notify()

    def close(self) -> None:
        """Send no more; what waits is dropped."""
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
            with suppress(Exception):  # an answer that fails must not end all that is sent
                send()

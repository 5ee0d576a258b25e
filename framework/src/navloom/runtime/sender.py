"""Sends in the place of those who publish, who must never wait for a router."""

from __future__ import annotations

import threading
from collections import deque

from navloom.runtime.zenoh_session import Publisher

__all__ = ["Sender"]

MOST = 32 * 2**20
"""Bytes that wait to be sent, at most: beyond them the oldest message is dropped."""


class Sender:
    """A thread that puts messages, in the order in which they were handed to it."""

    def __init__(self) -> None:
        self._waiting: deque[tuple[Publisher, bytes, str]] = deque()
        self._size = 0
        self._news = threading.Condition()
        self._is_ending = False
        self._thread = threading.Thread(target=self._run, name="sender", daemon=True)
        self._thread.start()

    def put(self, publisher: Publisher, data: bytes, label: str) -> None:
        """Hand a message over."""
        with self._news:
            self._waiting.append((publisher, data, label))
            self._size += len(data)
            while self._size > MOST:
                self._size -= len(self._waiting.popleft()[1])
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
                publisher, data, label = self._waiting.popleft()
                self._size -= len(data)
            publisher.put(data, label)

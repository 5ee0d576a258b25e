"""Executes each request once, even if the client repeats it."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

__all__ = ["REQUEST", "Once"]

REQUEST = "request"
"""Field that identifies a request: a text that the client makes up, and sends again when it retries."""
LONGEST_NAME = 64
"""Longest identifier, in characters."""
KEPT = 256
"""Number of requests whose answers are kept. Clients retry for a few seconds, in which fewer requests come."""

Handler = Callable[[dict[str, Any]], dict[str, Any]]


class Once:
    """Keeps the answers to the last requests, and returns them again for retries."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._answers: OrderedDict[str, Future[dict[str, Any]]] = OrderedDict()

    def guard(self, handler: Handler) -> Handler:
        """Wrap a handler so that it runs once for each identifier; requests without one always run."""

        def handle(given: dict[str, Any]) -> dict[str, Any]:
            name = given.pop(REQUEST, None)
            if name is None:
                return handler(given)
            if not isinstance(name, str) or len(name) > LONGEST_NAME:
                raise ValueError(f"{REQUEST} is not a text of at most {LONGEST_NAME} characters")
            answer, is_new = self._answer(name)
            if is_new:
                try:
                    answer.set_result(handler(given))
                # Kept like an answer: a retry must fail in the same way, not run the handler again.
                except BaseException as error:
                    answer.set_exception(error)
            return answer.result()  # waits if the request is still being handled

        return handle

    def _answer(self, name: str) -> tuple[Future[dict[str, Any]], bool]:
        """Future of the answer to a request, and whether the request is new."""
        with self._lock:
            found = self._answers.get(name)
            if found is not None:
                return found, False
            # The oldest: its client has given up long ago.
            while len(self._answers) >= KEPT:
                self._answers.popitem(last=False)
            found = self._answers[name] = Future()
            return found, True

"""Requests that are done once, however often they are asked."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

__all__ = ["REQUEST", "Once"]

REQUEST = "request"
"""Entry of a request that names it: a text that its client makes up, and repeats where it asks again."""
LONGEST_NAME = 64
"""Characters of such a name."""
KEPT = 256
"""Requests whose answers are kept. A client asks again for a few seconds, in which nobody gives so many."""

Handler = Callable[[dict[str, Any]], dict[str, Any]]


class Once:
    """Keeps the answers of the last requests, and gives them again to who asks again."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._answers: OrderedDict[str, Future[dict[str, Any]]] = OrderedDict()

    def guard(self, handler: Handler) -> Handler:
        """A handler that does each named request once. One without a name is done whenever it is asked."""

        def handle(given: dict[str, Any]) -> dict[str, Any]:
            name = given.pop(REQUEST, None)
            if name is None:
                return handler(given)
            if not isinstance(name, str) or len(name) > LONGEST_NAME:
                raise ValueError(f"{REQUEST} is no text of at most {LONGEST_NAME} characters")
            answer, is_new = self._answer(name)
            if is_new:
                try:
                    answer.set_result(handler(given))
                except BaseException as error:
                    answer.set_exception(error)
            return answer.result()  # of one that is under way, as soon as it is there

        return handle

    def _answer(self, name: str) -> tuple[Future[dict[str, Any]], bool]:
        """Where the answer of a request is or will be, and whether nobody has asked before."""
        with self._lock:
            found = self._answers.get(name)
            if found is not None:
                return found, False
            while len(self._answers) >= KEPT:
                self._answers.popitem(last=False)
            found = self._answers[name] = Future()
            return found, True

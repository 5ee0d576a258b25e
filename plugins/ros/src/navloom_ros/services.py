"""Services and their clients; `Node.service` and `Node.client` create them."""

from __future__ import annotations

import itertools
import threading
from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeout
from typing import Any

from navloom_ros.errors import BadToken, MalformedMessage, RosError
from navloom_ros.message_types import Types
from navloom_ros.qos import SERVICES
from navloom_ros.tokens import Attachment, Entity
from navloom_ros.wire import Keep, Question, Wire, epoch_ns

__all__ = ["Call", "Client", "NoAnswer", "Service"]


class NoAnswer(RosError):
    """A service has not answered: it does not exist, or the request has timed out."""


class Call:
    """A request that a service has received. It may be answered later, once, from any thread.

    Attributes:
        request: The decoded request, a message of the type `…_Request`.
    """

    def __init__(self, service: Service, question: Question, request: Any, beside: Attachment) -> None:
        self.request = request
        self._service = service
        self._question = question
        self._beside = beside

    def answer(self, response: Any = None, /, **values: Any) -> None:
        """Send the response, or one with these values. Raises UnfitMessage if it does not fit its type."""
        data = self._service.encoded(response, values)
        attachment = Attachment(self._beside.sequence, epoch_ns(), self._beside.gid)
        self._question.answer(self._service.key, data, attachment.data)

    def drop(self) -> None:
        """Finish the request without an answer."""
        self._question.drop()


class Service:
    """Passes requests to a handler, one at a time, on a separate thread.

    Args:
        wire, types, keep: Those of its node.
        entity, key: Its entry in the graph, and its Zenoh key.
        handler: Receives each call.

    Attributes:
        refused: Number of requests that could not be decoded, or for which the queue was full.
        failed: Number of requests whose handler raised an exception; their clients get no answer.
        reason: Why the last request of either kind got no answer.
    """

    def __init__(
        self, wire: Wire, types: Types, keep: Keep, entity: Entity, key: str, handler: Callable[[Call], None]
    ) -> None:
        self.entity = entity
        self.key = key
        self.refused = self.failed = 0
        self.reason = ""
        self._types = types
        self._handler = handler
        self._waiting: deque[Question | None] = deque()
        self._news = threading.Semaphore(0)
        self._room = (entity.qos or SERVICES).kept
        threading.Thread(target=self._work, name=f"service {entity.name}", daemon=True).start()
        keep(lambda: self._put(None))
        keep(wire.serve(key, self._on_question))

    def encoded(self, response: Any, values: Mapping[str, Any]) -> bytes:
        """Bytes of a response. Raises UnfitMessage."""
        name = f"{self.entity.type_name}_Response"
        return self._types.encode_as(name, self._types.new(name, **values) if response is None else response)

    def _on_question(self, question: Question) -> None:
        if len(self._waiting) >= self._room:
            self.refused += 1
            self.reason = f"{self._room} requests wait already"
            question.drop()
        else:
            self._put(question)

    def _put(self, question: Question | None) -> None:
        self._waiting.append(question)
        self._news.release()

    def _work(self) -> None:
        while self._news.acquire() and (question := self._waiting.popleft()) is not None:
            try:
                beside = Attachment.parsed(question.attachment)
                request = self._types.decode(f"{self.entity.type_name}_Request", question.data)
            except (BadToken, MalformedMessage) as error:
                self.refused += 1
                self.reason = str(error)
                question.drop()
                continue
            try:
                self._handler(Call(self, question, request, beside))
            except Exception as error:  # of foreign code; dropping the request ends the wait of its client
                self.failed += 1
                self.reason = f"{type(error).__name__}: {error}"
                question.drop()


class Client:
    """Sends requests to a service.

    Args:
        wire, types, entity, key: See `Service`.
    """

    def __init__(self, wire: Wire, types: Types, entity: Entity, key: str) -> None:
        self.entity = entity
        self._wire = wire
        self._types = types
        self._key = key
        self._sequence = itertools.count(1)

    def ask(self, request: Any = None, timeout: float = 10.0) -> Future[Any]:
        """Send a request; returns a future of the response, or of NoAnswer.

        Args:
            request: A message of the type `…_Request`, its values by field, or None for the defaults.
            timeout: Longest wait for the response, s.

        Raises:
            UnfitMessage: The request does not fit the service's type.
        """
        types, kind = self._types, self.entity.type_name
        if request is None or isinstance(request, Mapping):
            request = types.new(f"{kind}_Request", **(request or {}))
        data = types.encode_as(f"{kind}_Request", request)
        future: Future[Any] = Future()

        attachment = Attachment(next(self._sequence), epoch_ns(), self.entity.gid)

        def on_answer(answer: bytes, beside: bytes) -> None:
            if future.done() or not _answers(attachment, beside):
                return
            try:
                future.set_result(types.decode(f"{kind}_Response", answer))
            except MalformedMessage as error:
                future.set_exception(error)

        def on_end() -> None:
            if not future.done():
                future.set_exception(NoAnswer(f"service {self.entity.name} ({kind}) has not answered"))

        self._wire.ask(self._key, data, attachment.data, timeout, on_answer, on_end)
        return future

    def call(self, request: Any = None, timeout: float = 10.0) -> Any:
        """Send a request and wait for the response.

        Raises:
            NoAnswer: The service does not exist, or does not answer in time.
            MalformedMessage: The response cannot be decoded.
            UnfitMessage: The request does not fit the service's type.
        """
        try:
            return self.ask(request, timeout).result(timeout + 1.0)
        except FutureTimeout:
            raise NoAnswer(f"service {self.entity.name} has not answered within {timeout:g} s") from None


def _answers(asked: Attachment, beside: bytes) -> bool:
    """Whether the attachment of an answer has the sequence number and the client of the request."""
    try:
        answered = Attachment.parsed(beside)
    except BadToken:
        return False
    return (answered.sequence, answered.gid) == (asked.sequence, asked.gid)

"""A ROS node in plain Python: publishers, subscriptions, services and clients, over the wire of rmw_zenoh."""

from __future__ import annotations

import itertools
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeout
from dataclasses import dataclass
from types import TracebackType
from typing import Any

from navloom_ros.errors import BadToken, MalformedMessage, RosError
from navloom_ros.graph import Graph
from navloom_ros.message_types import Types
from navloom_ros.names import check_namespace, check_node_name, full_name, key_of, plain_buffer_key
from navloom_ros.qos import DEFAULT, SERVICES, Qos
from navloom_ros.tokens import PREFIX, Attachment, Entity
from navloom_ros.wire import ROUTER, Question, Wire, now_ns

__all__ = ["Call", "Client", "NoAnswer", "Node", "Publisher", "Received", "Service", "Subscription"]

WITH_BUFFERS = ("lyrical",)
"""Distributions whose publishers may send types with `uint8[]` to another key, see `plain_buffer_key`."""
LARGEST_DOMAIN = 232
"""Largest ROS_DOMAIN_ID."""


class NoAnswer(RosError):
    """A service that has not answered: it is not there, or it took too long."""


@dataclass(frozen=True)
class Received:
    """A message and what came beside it.

    Attributes:
        message: Decoded.
        sequence: Its number among those of its publisher, from 1.
        source_ns: When it was sent, ns since the epoch on the sender's clock.
        received_ns: When it arrived here, ns since the epoch on the clock of this host.
        gid: Of the publisher.
        arrived_ns: When it arrived here, on the monotonic clock of this host, ns.
    """

    message: Any
    sequence: int
    source_ns: int
    received_ns: int
    gid: bytes
    arrived_ns: int


class Publisher:
    """Sends messages of one type on one topic."""

    def __init__(self, node: Node, entity: Entity, key: str) -> None:
        self.entity = entity
        self._types = node.types
        self._put, end = node.wire.publisher(key, entity.qos or DEFAULT)
        node.keep(end)
        self._sequence = itertools.count(1)
        self._lock = threading.Lock()

    def publish(self, message: Any = None, /, **values: Any) -> None:
        """Send a message, or one with these values.

        Raises:
            UnfitMessage: It does not fit the topic's type.
        """
        if message is None:
            message = self._types.new(self.entity.type_name, **values)
        data = self._types.encode_as(self.entity.type_name, message)
        with self._lock:  # numbers arrive in their order
            self._put(data, Attachment(next(self._sequence), now_ns(), self.entity.gid).data)


class Subscription:
    """Keeps the last messages of a topic, as many as its quality of service says, until they are taken.

    Attributes:
        refused: Messages that could not be read, since the beginning; `reason` says why the last one was.
    """

    def __init__(self, node: Node, entity: Entity, key: str) -> None:
        self.entity = entity
        self.refused = 0
        self.reason = ""
        self._types = node.types
        qos = entity.qos or DEFAULT
        self._queue: deque[tuple[bytes, bytes, int, int]] = deque(maxlen=qos.kept)
        self._news = threading.Condition()
        self._closed = False
        node.keep(self.close)
        node.keep(node.wire.subscribe(key, qos, self._on_sample))
        if node.types.distribution in WITH_BUFFERS and not qos.transient_local:
            node.keep(node.wire.subscribe(plain_buffer_key(key), qos, self._on_sample))

    def take(self, timeout: float | None = 0.0) -> Received | None:
        """The oldest message that has not been taken; None where none comes in time, or the node is closed.

        Args:
            timeout: s to wait; None waits as long as the node is open.
        """
        while True:
            with self._news:
                self._news.wait_for(lambda: self._queue or self._closed, timeout)
                if not self._queue:
                    return None
                data, attachment, received_ns, arrived_ns = self._queue.popleft()
            try:
                beside = Attachment.parsed(attachment)
                message = self._types.decode(self.entity.type_name, data)
            except (BadToken, MalformedMessage) as error:
                self.refused += 1
                self.reason = str(error)
                continue
            return Received(message, beside.sequence, beside.source_ns, received_ns, beside.gid, arrived_ns)

    def close(self) -> None:
        """Let whoever waits go on."""
        with self._news:
            self._closed = True
            self._news.notify_all()

    def _on_sample(self, data: bytes, attachment: bytes) -> None:
        with self._news:
            self._queue.append((data, attachment, now_ns(), time.monotonic_ns()))
            self._news.notify()


class Call:
    """A request that has arrived at a service, to be answered once, from any thread, now or later."""

    def __init__(self, service: Service, question: Question, request: Any, beside: Attachment) -> None:
        self.request = request
        self._service = service
        self._question = question
        self._beside = beside

    def answer(self, response: Any = None, /, **values: Any) -> None:
        """Send the response, or one with these values. Raises UnfitMessage where it does not fit."""
        data = self._service.encoded(response, values)
        attachment = Attachment(self._beside.sequence, now_ns(), self._beside.gid)
        self._question.answer(self._service.key, data, attachment.data)

    def drop(self) -> None:
        """End it without an answer."""
        self._question.drop()


class Service:
    """Answers requests, one after the other, on a thread of its own.

    Attributes:
        refused: Requests that could not be read, or were too many to wait.
        failed: Requests whose handler raised; the client gets no answer. `reason` says why the last one had none.
    """

    def __init__(self, node: Node, entity: Entity, key: str, handler: Callable[[Call], None]) -> None:
        self.entity = entity
        self.key = key
        self.refused = self.failed = 0
        self.reason = ""
        self._types = node.types
        self._handler = handler
        self._waiting: deque[Question | None] = deque()
        self._news = threading.Semaphore(0)
        self._room = (entity.qos or SERVICES).kept
        threading.Thread(target=self._work, name=f"service {entity.name}", daemon=True).start()
        node.keep(lambda: self._put(None))
        node.keep(node.wire.serve(key, self._on_question))

    def encoded(self, response: Any, values: Mapping[str, Any]) -> bytes:
        """Bytes of a response."""
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
            except Exception as error:  # of a stranger's handler; the client is not kept waiting for it
                self.failed += 1
                self.reason = f"{type(error).__name__}: {error}"
                question.drop()


class Client:
    """Asks a service."""

    def __init__(self, node: Node, entity: Entity, key: str) -> None:
        self.entity = entity
        self._node = node
        self._key = key
        self._sequence = itertools.count(1)

    def ask(self, request: Any = None, timeout: float = 10.0) -> Future[Any]:
        """Send a request; the future gets the response, or NoAnswer.

        Args:
            request: Of the service's request type, or its values by field, or nothing for the defaults.
            timeout: s until it is given up.

        Raises:
            UnfitMessage: The request does not fit the service's type.
        """
        types, kind = self._node.types, self.entity.type_name
        if request is None or isinstance(request, Mapping):
            request = types.new(f"{kind}_Request", **(request or {}))
        data = types.encode_as(f"{kind}_Request", request)
        future: Future[Any] = Future()

        attachment = Attachment(next(self._sequence), now_ns(), self.entity.gid)

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

        self._node.wire.ask(self._key, data, attachment.data, timeout, on_answer, on_end)
        return future

    def call(self, request: Any = None, timeout: float = 10.0) -> Any:
        """Send a request and wait for the response.

        Raises:
            NoAnswer: There is no such service, or it took too long.
            MalformedMessage: The response is none.
        """
        try:
            return self.ask(request, timeout).result(timeout + 1.0)
        except FutureTimeout:
            raise NoAnswer(f"service {self.entity.name} has not answered within {timeout:g} s") from None


class Node:
    """A node on a robot's ROS network. Use it in a `with` statement.

    Args:
        name, namespace: As ROS knows it.
        router: Endpoint of the robot's Zenoh router.
        domain: ROS_DOMAIN_ID.
        types: Of the robot's distribution.
        remap: Names given instead of others, as `names.remapping` reads them.

    Attributes:
        graph: Who is there.

    Raises:
        NoRouter: There is no router.
        BadName: A name that ROS does not allow.
    """

    def __init__(
        self,
        name: str,
        *,
        namespace: str = "/",
        router: str = ROUTER,
        domain: int = 0,
        types: Types | None = None,
        remap: Mapping[str, str] | None = None,
    ) -> None:
        self.name = check_node_name(name)
        self.namespace = check_namespace(namespace)
        if not 0 <= domain <= LARGEST_DOMAIN:
            raise RosError(f"ROS domain {domain}: expected 0 to {LARGEST_DOMAIN}")
        self.domain = domain
        self.types = types or Types()
        self.graph = Graph()
        self._remap = dict(remap or {})
        self._changed = threading.Condition()
        self._ends: list[Callable[[], None]] = []
        self._numbers = itertools.count(1)
        self.wire = Wire(router, self.types.largest)
        try:
            self.keep(self.wire.watch(f"{PREFIX}/{domain}/**", self._on_token))
            self._declare(Entity("NN", domain, self.wire.session, "0", "0", self.namespace, self.name))
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Node:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End everything that it offers, and leave the network."""
        for end in reversed(self._ends):
            end()
        self._ends.clear()
        self.wire.close()

    def keep(self, end: Callable[[], None]) -> None:
        """Call this when the node closes."""
        self._ends.append(end)

    def publisher(self, topic: str, type_name: str, qos: Qos = DEFAULT) -> Publisher:
        """Offer a topic."""
        entity, key = self._endpoint("MP", topic, type_name, qos)
        made = Publisher(self, entity, key)
        self._declare(entity)
        return made

    def subscription(self, topic: str, type_name: str, qos: Qos = DEFAULT) -> Subscription:
        """Read a topic; nothing else of the network is received."""
        entity, key = self._endpoint("MS", topic, type_name, qos)
        made = Subscription(self, entity, key)
        self._declare(entity)
        return made

    def service(self, name: str, type_name: str, handler: Callable[[Call], None]) -> Service:
        """Offer a service; `handler` gets each call on a thread of the service, and answers it then or later."""
        entity, key = self._endpoint("SS", name, type_name, SERVICES)
        made = Service(self, entity, key, handler)
        self._declare(entity)
        return made

    def client(self, name: str, type_name: str) -> Client:
        """Use a service."""
        entity, key = self._endpoint("SC", name, type_name, SERVICES)
        self._declare(entity)
        return Client(self, entity, key)

    def wait_for(self, condition: Callable[[Graph], Any], timeout: float) -> Any:
        """Wait until something is true of the graph; what it gives, or gave last."""
        with self._changed:
            return self._changed.wait_for(lambda: condition(self.graph), timeout)

    def settle(self, quiet: float = 0.3, longest: float = 3.0) -> None:
        """Wait until nobody has come or gone for `quiet` s, at most `longest` s: then it is known who is there."""
        end = time.monotonic() + longest
        with self._changed:
            while time.monotonic() < end and self._changed.wait(quiet):
                pass

    def mismatches(self, topic: str) -> list[Entity]:
        """Publishers of a topic that this node's subscriptions cannot hear: of another type, or another hash."""
        name = full_name(topic, self.namespace, self.name, self._remap)
        ours = {(one.type_name, one.type_hash) for one in self.graph.find(name, ("MS",)) if self._is_own(one)}
        return [one for one in self.graph.find(name, ("MP",)) if ours and (one.type_name, one.type_hash) not in ours]

    def _is_own(self, entity: Entity) -> bool:
        return entity.session == self.wire.session

    def _endpoint(self, kind: str, name: str, type_name: str, qos: Qos) -> tuple[Entity, str]:
        full = full_name(name, self.namespace, self.name, self._remap)
        type_hash = self.types.hash_of(type_name)
        number = str(next(self._numbers))
        own = (kind, self.domain, self.wire.session, "0", number, self.namespace, self.name)
        return Entity(*own, full, type_name, type_hash, qos), key_of(self.domain, full, type_name, type_hash)

    def _declare(self, entity: Entity) -> None:
        self.keep(self.wire.token(entity.token))

    def _on_token(self, token: str, is_there: bool) -> None:
        with self._changed:
            (self.graph.add if is_there else self.graph.remove)(token)
            self._changed.notify_all()


def _answers(asked: Attachment, beside: bytes) -> bool:
    """Whether an answer is to this very request: it bears its number and its client."""
    try:
        answered = Attachment.parsed(beside)
    except BadToken:
        return False
    return (answered.sequence, answered.gid) == (asked.sequence, asked.gid)

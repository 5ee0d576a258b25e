"""The only module of this package that imports Zenoh: sends and receives bytes with attachments, as rmw_zenoh does.

The session is a client of the robot's router, because a router does not forward between peers. It opens no port.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from contextlib import suppress
from types import TracebackType
from typing import Any

import zenoh
import zenoh.ext

from navloom_ros.errors import MalformedMessage, RosError
from navloom_ros.qos import Qos

__all__ = ["ROUTER", "NoRouter", "Question", "Wire", "epoch_ns", "monotonic_ns", "settings"]

ROUTER = "tcp/127.0.0.1:7447"
"""Default endpoint of `rmw_zenohd`."""
HEARTBEAT = 0.5
"""Interval of the heartbeats of a latched, reliable publisher that has sent messages, s."""
CONNECT = 2.0
"""Longest wait for the router when a session opens, s."""

Keep = Callable[[Callable[[], None]], None]
"""Registers a function to call when the node closes."""
OnSample = Callable[[bytes, bytes], None]
"""Callback for a message and its attachment, as bytes. It runs on Zenoh's thread and must not block."""


class NoRouter(RosError):
    """No Zenoh router answers at an endpoint."""


class Question:
    """A received request. It may be answered later, from any thread."""

    def __init__(self, query: Any, data: bytes, attachment: bytes) -> None:
        self._query = query
        self.data = data
        self.attachment = attachment

    def answer(self, key: str, data: bytes, attachment: bytes) -> None:
        """Answer, once; the answer is lost if the client has timed out."""
        with suppress(zenoh.ZError):
            self._query.reply(key, data, attachment=attachment)
        self.drop()

    def drop(self) -> None:
        """Finish the request; without an answer if none was sent."""
        with suppress(zenoh.ZError):
            self._query.drop()


class Wire:
    """One session with the robot's router. Use it in a `with` statement: an open session hangs the process at exit.

    Args:
        router: Endpoint of the router, as tcp/192.168.0.7:7447.
        largest: Largest message or attachment that is received, bytes; larger ones are dropped before they are copied.

    Attributes:
        session: Zenoh id of this process, as in tokens.
    """

    def __init__(self, router: str, largest: int) -> None:
        try:
            self._session = zenoh.open(zenoh.Config.from_json5(json.dumps(settings(router))))
        except zenoh.ZError as error:
            reason = str(error).partition(" at /")[0]
            raise NoRouter(
                f"no Zenoh router at {router} ({reason}): start the robot's, as `ros2 run rmw_zenoh_cpp rmw_zenohd`, "
                "or name another one"
            ) from None
        self._largest = largest
        self.session = str(self._session.zid())

    def __enter__(self) -> Wire:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Leave the network."""
        with suppress(zenoh.ZError):
            self._session.close()  # type: ignore[no-untyped-call]

    @property
    def joined(self) -> bool:
        """The session has a link to the router now."""
        return bool(self._session.info.routers_zid())

    def token(self, key: str) -> Callable[[], None]:
        """Declare a liveliness token; the returned function undeclares it."""
        return _undeclarer(self._session.liveliness().declare_token(key))

    def watch(self, key: str, on_change: Callable[[str, bool], None]) -> Callable[[], None]:
        """Watch liveliness tokens; existing ones are reported first.

        Args:
            key: Key expression of the tokens.
            on_change: Receives the key of a token, and true if it appeared, false if it disappeared.

        Returns:
            A function that ends the watch.
        """

        def changed(sample: Any) -> None:
            on_change(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        handler = zenoh.handlers.Callback(changed, indirect=False)
        return _undeclarer(self._session.liveliness().declare_subscriber(key, handler, history=True))

    def publisher(self, key: str, qos: Qos) -> tuple[Callable[[bytes, bytes], None], Callable[[], None]]:
        """Declare a publisher. Returns a function that sends a message and its attachment, and one that ends it."""
        options: dict[str, Any] = {}
        if qos.transient_local:
            options = {"publisher_detection": True, "cache": zenoh.ext.CacheConfig(qos.kept)}
            if qos.reliable:
                options["sample_miss_detection"] = zenoh.ext.MissDetectionConfig(
                    heartbeat=None, sporadic_heartbeat=HEARTBEAT
                )
        waits = qos.reliable and qos.depth is None
        publisher = zenoh.ext.declare_advanced_publisher(
            self._session,
            key,
            congestion_control=zenoh.CongestionControl.BLOCK if waits else zenoh.CongestionControl.DROP,
            reliability=zenoh.Reliability.RELIABLE if qos.reliable else zenoh.Reliability.BEST_EFFORT,
            **options,
        )

        def put(data: bytes, attachment: bytes) -> None:
            with suppress(zenoh.ZError):  # the message is lost if the link is down
                publisher.put(data, attachment=attachment)

        return put, _undeclarer(publisher)

    def subscribe(
        self, key: str, qos: Qos, on_sample: OnSample, on_refusal: Callable[[str], None]
    ) -> Callable[[], None]:
        """Receive messages, and first the last ones of a latched topic; the returned function ends it.

        Args:
            key: Of the topic.
            qos: Quality of service of the subscription.
            on_sample: Receives each message.
            on_refusal: Receives the reason why a message was dropped. It must not block.
        """

        def receive(sample: Any) -> None:
            try:
                taken = self._taken(sample)
            except MalformedMessage as error:
                on_refusal(str(error))
            else:
                on_sample(*taken)

        options: dict[str, Any] = {}
        if qos.transient_local:
            options = {
                "subscriber_detection": True,
                "history": zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=qos.kept),
            }
            if qos.reliable:
                options["recovery"] = zenoh.ext.RecoveryConfig(periodic_queries=None, heartbeat=True)
        handler = zenoh.handlers.Callback(receive, indirect=False)
        return _undeclarer(zenoh.ext.declare_advanced_subscriber(self._session, key, handler, **options))

    def serve(self, key: str, on_question: Callable[[Question], None]) -> Callable[[], None]:
        """Receive requests. `on_question` runs on Zenoh's thread and must not block. The returned function ends it."""

        def receive(query: Any) -> None:
            try:
                taken = self._taken(query)
            except MalformedMessage:
                query.drop()
            else:
                on_question(Question(query, *taken))

        handler = zenoh.handlers.Callback(receive, indirect=False)
        return _undeclarer(self._session.declare_queryable(key, handler, complete=True))

    def ask(
        self, key: str, data: bytes, attachment: bytes, timeout: float, on_answer: OnSample, on_end: Callable[[], None]
    ) -> None:
        """Send a request. `on_answer` receives each answer, then `on_end` is called; both run on Zenoh's thread."""

        def receive(reply: Any) -> None:
            if reply.ok is not None:
                with suppress(MalformedMessage):
                    on_answer(*self._taken(reply.ok))

        try:
            self._session.get(
                key,
                zenoh.handlers.Callback(receive, on_end, indirect=False),
                target=zenoh.QueryTarget.ALL_COMPLETE,
                consolidation=zenoh.ConsolidationMode.NONE,
                timeout=timeout,
                payload=data,
                attachment=attachment,
            )
        except zenoh.ZError:  # the session has been closed
            on_end()

    def _taken(self, sample: Any) -> tuple[bytes, bytes]:
        """A message and its attachment. Raises MalformedMessage without copying them."""
        payload, attachment = sample.payload, sample.attachment
        if payload is None or attachment is None:
            raise MalformedMessage("it has no attachment: it is not of rmw_zenoh")
        largest = max(len(payload), len(attachment))
        if largest > self._largest:
            raise MalformedMessage(f"it has {largest} bytes; at most {self._largest} are received")
        return payload.to_bytes(), attachment.to_bytes()


def settings(router: str) -> dict[str, Any]:
    """Zenoh configuration of a client of one router: no listening port, no scouting."""
    return {
        "mode": "client",
        "connect": {"endpoints": [router], "timeout_ms": int(1000 * CONNECT), "exit_on_failure": True},
        "listen": {"endpoints": []},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "timestamping": {"enabled": True},
        "transport": {"shared_memory": {"enabled": False}},
        "adminspace": {"enabled": False},
    }


def monotonic_ns() -> int:
    """Time on this host's monotonic clock, ns."""
    return time.monotonic_ns()


def epoch_ns() -> int:
    """Time in ns since the epoch, as in attachments."""
    return time.time_ns()


def _undeclarer(entity: Any) -> Callable[[], None]:
    def undeclare() -> None:
        with suppress(zenoh.ZError):
            entity.undeclare()

    return undeclare

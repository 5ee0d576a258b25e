"""The only module here that speaks Zenoh: keys, bytes and attachments, as rmw_zenoh sends them.

A process joins as a client of the robot's router, since a router does not forward between peers; it listens nowhere.
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

from navloom_ros.errors import RosError
from navloom_ros.qos import Qos

__all__ = ["ROUTER", "NoRouter", "Question", "Wire", "settings"]

ROUTER = "tcp/127.0.0.1:7447"
"""Where `rmw_zenohd` listens."""
HEARTBEAT = 0.5
"""s between two heartbeats of a latched, reliable publisher that has news."""
CONNECT = 2.0
"""s that a router may take to answer, at first."""

OnSample = Callable[[bytes, bytes], None]
"""Takes the bytes of a message and of its attachment, on the network's thread: it must not wait."""


class NoRouter(RosError):
    """There is no Zenoh router at an address."""


class Question:
    """A request that a server has to answer; it may do so later, from any thread."""

    def __init__(self, query: Any, data: bytes, attachment: bytes) -> None:
        self._query = query
        self.data = data
        self.attachment = attachment

    def answer(self, key: str, data: bytes, attachment: bytes) -> None:
        """Answer once; whoever has stopped waiting does not get it."""
        with suppress(zenoh.ZError):
            self._query.reply(key, data, attachment=attachment)
        self.drop()

    def drop(self) -> None:
        """End it without an answer."""
        with suppress(zenoh.ZError):
            self._query.drop()


class Wire:
    """One session with the robot's router. Use it in a `with` statement: an open session hangs the process at its end.

    Args:
        router: Its endpoint, as tcp/192.168.0.7:7447.
        largest: Bytes of the largest message that is taken; larger ones are passed over before they are copied.

    Attributes:
        session: Zenoh's id of this process, as tokens have it.
        too_large: Messages that were passed over.
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
        self.too_large = 0

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
        """Whether there is a link to the router now."""
        return bool(self._session.info.routers_zid())

    def token(self, key: str) -> Callable[[], None]:
        """Say that an entity is there until what is returned is called."""
        return _undeclarer(self._session.liveliness().declare_token(key))

    def watch(self, key: str, on_change: Callable[[str, bool], None]) -> Callable[[], None]:
        """Follow tokens: each one's key, and whether it came or went; those that are there already come first."""

        def changed(sample: Any) -> None:
            on_change(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        handler = zenoh.handlers.Callback(changed, indirect=False)
        return _undeclarer(self._session.liveliness().declare_subscriber(key, handler, history=True))

    def publisher(self, key: str, qos: Qos) -> tuple[Callable[[bytes, bytes], None], Callable[[], None]]:
        """A function that sends a message and its attachment, and one that ends the publisher."""
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
            with suppress(zenoh.ZError):  # a link that is gone loses it
                publisher.put(data, attachment=attachment)

        return put, _undeclarer(publisher)

    def subscribe(self, key: str, qos: Qos, on_sample: OnSample) -> Callable[[], None]:
        """Receive messages; late joiners of a latched topic get the last ones."""

        def receive(sample: Any) -> None:
            taken = self._taken(sample)
            if taken is not None:
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
        """Take requests; `on_question` runs on the network's thread and must not wait."""

        def receive(query: Any) -> None:
            taken = self._taken(query)
            if taken is None:
                query.drop()
            else:
                on_question(Question(query, *taken))

        handler = zenoh.handlers.Callback(receive, indirect=False)
        return _undeclarer(self._session.declare_queryable(key, handler, complete=True))

    def ask(
        self, key: str, data: bytes, attachment: bytes, timeout: float, on_answer: OnSample, on_end: Callable[[], None]
    ) -> None:
        """Send a request; `on_answer` gets each answer, then `on_end` is called, both on the network's thread."""

        def receive(reply: Any) -> None:
            taken = self._taken(reply.ok) if reply.ok is not None else None
            if taken is not None:
                on_answer(*taken)

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

    def _taken(self, sample: Any) -> tuple[bytes, bytes] | None:
        payload, attachment = sample.payload, sample.attachment
        if payload is None or attachment is None:
            return None
        if len(payload) > self._largest or len(attachment) > self._largest:
            self.too_large += 1
            return None
        return payload.to_bytes(), attachment.to_bytes()


def settings(router: str) -> dict[str, Any]:
    """Zenoh's configuration of a client of one router, which listens nowhere and searches for nobody."""
    return {
        "mode": "client",
        "connect": {"endpoints": [router], "timeout_ms": int(1000 * CONNECT), "exit_on_failure": True},
        "listen": {"endpoints": []},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "timestamping": {"enabled": True},
        "transport": {"shared_memory": {"enabled": False}},
        "adminspace": {"enabled": False},
    }


def now_ns() -> int:
    """ns since the epoch, as attachments have it."""
    return time.time_ns()


def _undeclarer(entity: Any) -> Callable[[], None]:
    def undeclare() -> None:
        with suppress(zenoh.ZError):
            entity.undeclare()

    return undeclare

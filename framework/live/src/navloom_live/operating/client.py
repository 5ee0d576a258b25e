"""Requests that tools send to a live robot over its network."""

from __future__ import annotations

import json
import time
import uuid
from collections.abc import Callable, Mapping
from typing import Any

from navloom.errors import NavloomError

from navloom_live.hosting.directory import RobotFolder
from navloom_live.transport.keyspace import LINKED, SUPERVISOR, KeySpace
from navloom_live.transport.once import REQUEST
from navloom_live.transport.questions import TOO_MANY
from navloom_live.transport.zenoh_bus import TIMED_OUT, Answer, Bus

__all__ = ["AGAIN", "OPEN", "Client", "ClientError", "Refused", "Unanswered"]

AGAIN = 0.1
"""Shortest time between two requests of one kind, s: a router drops requests that come sooner, see `access.PACES`."""
JOIN = 2.0
"""Longest time in which a tool discovers the robot's processes, s."""
ATTEMPT = 2.4
"""Wait for an answer before a retry, s; longer than a service takes."""
UNKNOWN = "it may or may not have been done: `navloom status` shows which, `navloom doctor` why there was no answer"

OPEN: Mapping[str, Any] = {
    **dict.fromkeys(("plugin", "process", "pid", "host", "active", "enabled", "tick", "epoch")),
    **dict.fromkeys(("busy_s", "silence_s", "period_s", "step_s")),
    **{key: {} for key in ("versions", "published", "carries", "streams", "places", "hosts")},
    "clock_ns": -1,
    "faulted": 0,
    "fault": "",
    "config_sha256": "",
    "shares_memory": False,
    "shared_memory_mb": None,
}
"""Defaults of a description, for a node that does not answer or whose version lacks an entry."""
_NUMBER, _NONE = (int, float), type(None)
_TYPES: Mapping[str, type | tuple[type, ...]] = {
    **dict.fromkeys(("process", "host", "config_sha256", "fault"), str),
    **dict.fromkeys(("pid", "tick", "epoch", "clock_ns", "faulted", "wall_ns"), int),
    **dict.fromkeys(("ticks", "late_ticks", "driven_ticks", "own_ticks"), int),
    **dict.fromkeys(("active", "enabled", "shares_memory"), bool),
    **dict.fromkeys(("busy_s", "silence_s", "period_s", "step_s", "shared_memory_mb", "up_s"), (*_NUMBER, _NONE)),
    **dict.fromkeys(("chain_p50_s", "chain_p99_s"), _NUMBER),
    **dict.fromkeys(("versions", "published", "carries", "streams", "places", "hosts"), dict),
    "plugin": (str, _NONE),
}
"""Types of the entries of an instance's description that tools rely on."""
_COUNTED = frozenset({"received", "dropped", "malformed", "late", "latest"})
"""Counters that a description holds for each stream that the instance reads."""


class ClientError(NavloomError, RuntimeError):
    """No node answers; the text says which was asked and what to do."""

    exit_code = 1


class Unanswered(ClientError):
    """A node received the request, but no answer came: the request may or may not have been carried out."""


class Refused(NavloomError, ValueError):
    """The robot answered and refused the request; the text says why."""


class Client:
    """Sends requests to the nodes of one robot.

    Args:
        bus: A session on its network.
        keys: Its key space.
        home: Its folder, if it was started on this host.
    """

    def __init__(self, bus: Bus, keys: KeySpace, home: RobotFolder | None = None) -> None:
        self.bus, self.keys, self._home = bus, keys, home

    @property
    def was_ended(self) -> bool:
        """Whether the robot was started on this host and its supervisor has ended."""
        return self._home is not None and not self._home.is_claimed()

    def has_nodes(self) -> bool:
        """Whether any node of the robot is alive."""
        return bool(self.bus.alive(self.keys.alive("*", "*", "*")))

    def lives(self, role: str, instance: str) -> set[str]:
        """Identifiers of the current lives of an instance: usually one, replaced when the instance restarts."""
        return {key.rpartition("/")[2] for key in self.bus.alive(self.keys.alive(role, instance, "*"))}

    def call(self, role: str, instance: str, service: str, given: Mapping[str, Any], timeout: float = 5.0) -> Any:
        """Call a service of an instance and return its answer, within `timeout` seconds.

        Each request has a unique name, so that the instance carries it out once even if it is retried after a lost
        answer. A request is not retried if the instance has restarted in the meantime.

        Raises:
            Refused: The instance refuses; ClientError: it is not there; Unanswered: it is there, but no answer came.
        """
        key = self.keys.port(role, instance, service)
        return self._call(key, f"{role} {instance}", service, given, timeout, lambda: self.lives(role, instance))

    def call_supervisor(self, service: str, given: Mapping[str, Any], timeout: float = 10.0) -> Any:
        """Call a service of the robot's `navloom up`, like `call`.

        Raises:
            Refused: It refuses; ClientError: no `navloom up` supervises the robot; Unanswered: no answer came.
        """
        token = self.keys.process(SUPERVISOR, LINKED)
        key = self.keys.process(SUPERVISOR, service)
        return self._call(key, "its supervisor", service, given, timeout, lambda: set(self.bus.alive(token)))

    def _call(
        self, key: str, who: str, service: str, given: Mapping[str, Any], timeout: float, find: Callable[[], set[str]]
    ) -> Any:
        """Call a service; `find` returns the current lives of the one that serves it."""
        data = json.dumps({**given, REQUEST: uuid.uuid4().hex}).encode()
        began, asked = time.monotonic(), frozenset[str]()
        while (left := began + timeout - time.monotonic()) > 0.0:
            lives = find()
            if asked and lives - asked:
                raise Unanswered(f"robot {self.keys.prefix}: {who} restarted during the request ({service}); {UNKNOWN}")
            answer = self._asked_once(key, data, min(ATTEMPT, left)) if lives else None
            if answer is not None:
                try:
                    return json.loads(answer.data)
                except ValueError:
                    raise ClientError(f"robot {self.keys.prefix}: {who} answers {service} with no JSON") from None
            asked |= lives
            if not asked and time.monotonic() - began > JOIN:
                break
            time.sleep(AGAIN)
        if asked:
            raise Unanswered(
                f"robot {self.keys.prefix}: {who} does not answer within {timeout:g} s ({service}); {UNKNOWN}; "
                "the certificate may not allow this request"
            )
        raise ClientError(
            f"robot {self.keys.prefix}: {who} does not answer ({service}): it is not there; `navloom list` shows who "
            "is, `navloom doctor` why not"
        )

    def _asked_once(self, key: str, data: bytes, timeout: float) -> Answer | None:
        """One attempt: the answer, or None if there was none. Raises Refused."""
        for answer in self.bus.ask(key, data, timeout):
            if answer.refusal in ("", TIMED_OUT, TOO_MANY):
                return None if answer.refusal else answer
            raise Refused(answer.refusal)
        return None

    def ask_again(self, key: str, timeout: float) -> list[Answer]:
        """All answers to a query; without any, the query is sent once more in case the first came too soon."""
        answers = list(self.bus.ask(key, timeout=timeout))
        if not answers:
            time.sleep(AGAIN)
            answers = list(self.bus.ask(key, timeout=timeout))
        return answers

    def describe(self, timeout: float = 1.0) -> list[dict[str, Any]]:
        """Description of every instance that answers, sorted by role and name."""
        found = {(one["role"], one["instance"]): one for one in self.all_described(timeout)}
        return [found[source] for source in sorted(found)]

    def all_described(self, timeout: float = 1.0) -> list[dict[str, Any]]:
        """Every description that arrives, also several of one instance, which two processes run at once."""
        answers = self.ask_again(self.keys.port("*", "*", "describe"), timeout)
        found = (self.described(answer) for answer in answers if not answer.refusal)
        return [described for described in found if described is not None]

    def described(self, answer: Answer) -> dict[str, Any] | None:
        """An instance's description of itself; None if the answer is not a valid description.

        Role and instance come from the key: a shadow's plugin may answer anything, but only under its own key.
        """
        try:
            given = json.loads(answer.data)
        except ValueError:
            return None
        if not _is_description(given):
            return None
        role, instance, _ = self.keys.split(answer.key)
        return {**OPEN, **given, "role": role, "instance": instance}


def _is_description(given: Any) -> bool:
    """Whether all entries have the types that tools rely on; entries may be missing."""
    if not isinstance(given, dict):
        return False
    if not all(isinstance(given[name], kinds) for name, kinds in _TYPES.items() if name in given):
        return False
    places, hosts, streams = (given.get(name, {}) for name in ("places", "hosts", "streams"))
    names = [name for table in (places, hosts, given.get("versions", {})) for pair in table.items() for name in pair]
    return (
        all(isinstance(name, str) for name in names)
        and all(" " in node for node in places)
        and all(isinstance(counts, dict) and counts.keys() >= _COUNTED for counts in streams.values())
        and all(isinstance(counts[name], int) for counts in streams.values() for name in _COUNTED)
        and all(isinstance(counts.get("misrouted", 0), int) for counts in streams.values())
    )

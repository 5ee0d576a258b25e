"""Requests that tools send to a live robot over its network."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from navloom.errors import NavloomError
from navloom.inputs.typed_json import from_json

from navloom_live.hosting.runtime_folders import RobotFolder
from navloom_live.live.service import STOP, Answered, Asked, Nothing, Service, request_bytes
from navloom_live.timing import REQUEST_ATTEMPT, REQUEST_TIMEOUT, SUPERVISOR_TIMEOUT, TOOL_JOIN_WAIT
from navloom_live.transport.keyspace import LINKED, SUPERVISOR, KeySpace
from navloom_live.transport.query_limits import TOO_MANY
from navloom_live.transport.zenoh_bus import TIMED_OUT, Answer, Bus

if TYPE_CHECKING:
    from navloom_live.live.description import Description

__all__ = ["REQUEST_SPACING", "Client", "ClientError", "Refused", "Unanswered"]

REQUEST_SPACING = 0.1
"""Shortest time between two requests of one kind, s: a router drops requests that come sooner, see `access.PACES`."""
UNKNOWN = "it may or may not have been done: `navloom status` shows which, `navloom doctor` why there was no answer"


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
        may_operate: Whether the certificate of the session allows to act; without certificates, it does.

    Attributes:
        unreadable: Why the last description of a node could not be read, by role and instance.
    """

    def __init__(self, bus: Bus, keys: KeySpace, home: RobotFolder | None = None, may_operate: bool = True) -> None:
        self.bus, self.keys, self.home, self.may_operate = bus, keys, home, may_operate
        self.unreadable: dict[tuple[str, str], str] = {}

    @property
    def was_ended(self) -> bool:
        """Whether the robot was started on this host and its supervisor has ended."""
        return self.home is not None and not self.home.is_claimed()

    def has_nodes(self) -> bool:
        """Whether any node of the robot is alive."""
        return bool(self.bus.alive(self.keys.alive("*", "*", "*")))

    def lives(self, role: str, instance: str) -> set[str]:
        """Identifiers of the current lives of an instance: usually one, replaced when the instance restarts."""
        return {key.rpartition("/")[2] for key in self.bus.alive(self.keys.alive(role, instance, "*"))}

    def call(
        self,
        role: str,
        instance: str,
        service: Service[Asked, Answered],
        asked: Asked,
        timeout: float = REQUEST_TIMEOUT,
    ) -> Answered:
        """Call a service of an instance and return its answer, within `timeout` seconds.

        Each request has a unique name, so that the instance carries it out once even if it is retried after a lost
        answer. A request is not retried if the instance has restarted in the meantime.

        Raises:
            Refused: The instance refuses; ClientError: it is not there; Unanswered: it is there, but no answer came.
        """
        key = self.keys.port(role, instance, service.name)
        return self._call(key, f"{role} {instance}", service, asked, timeout, lambda: self.lives(role, instance))

    def call_supervisor(
        self, service: Service[Asked, Answered], asked: Asked, timeout: float = SUPERVISOR_TIMEOUT
    ) -> Answered:
        """Call a service of the robot's `navloom up`, like `call`.

        Raises:
            Refused: It refuses; ClientError: no `navloom up` supervises the robot; Unanswered: no answer came.
        """
        token = self.keys.process(SUPERVISOR, LINKED)
        key = self.keys.process(SUPERVISOR, service.name)
        return self._call(key, "its supervisor", service, asked, timeout, lambda: set(self.bus.alive(token)))

    def stop(self) -> None:
        """Stop the robot until the gate's service `resume`."""
        self.call("gate", "main", STOP, Nothing())

    def _call(
        self,
        key: str,
        who: str,
        service: Service[Asked, Answered],
        asked: Asked,
        timeout: float,
        find: Callable[[], set[str]],
    ) -> Answered:
        """Call a service; `find` returns the current lives of the one that serves it."""
        data, name = request_bytes(asked), service.name
        began, told = time.monotonic(), frozenset[str]()
        while (left := began + timeout - time.monotonic()) > 0.0:
            lives = find()
            # A later life does not know the request, and might carry it out a second time.
            if told and lives - told:
                raise Unanswered(f"robot {self.keys.prefix}: {who} restarted during the request ({name}); {UNKNOWN}")
            answer = self._asked_once(key, data, min(REQUEST_ATTEMPT, left)) if lives else None
            if answer is not None:
                try:
                    return from_json(service.answered, answer.data)
                except ValueError as error:
                    raise ClientError(
                        f"robot {self.keys.prefix}: the answer of {who} to {name} cannot be read ({error}); install "
                        "the same version of navloom on both"
                    ) from None
            told |= lives
            # Not there: by now a node that is there has been discovered.
            if not told and time.monotonic() - began > TOOL_JOIN_WAIT:
                break
            time.sleep(REQUEST_SPACING)
        if told:
            raise Unanswered(
                f"robot {self.keys.prefix}: {who} does not answer within {timeout:g} s ({name}); {UNKNOWN}; "
                "the certificate may not allow this request"
            )
        raise ClientError(
            f"robot {self.keys.prefix}: {who} does not answer ({name}): it is not there; `navloom list` shows who "
            "is, `navloom doctor` why not"
        )

    def _asked_once(self, key: str, data: bytes, timeout: float) -> Answer | None:
        """One attempt: the answer, or None if there was none. Raises Refused."""
        for answer in self.bus.ask(key, data, timeout):
            if answer.refusal in ("", TIMED_OUT, TOO_MANY):
                # Refusals of the network, not of the node: a retry helps.
                return None if answer.refusal else answer
            raise Refused(answer.refusal)
        return None

    def ask_again(self, key: str, timeout: float) -> list[Answer]:
        """All answers to a query; without any, the query is sent once more in case the first came too soon."""
        answers = list(self.bus.ask(key, timeout=timeout))
        if not answers:
            time.sleep(REQUEST_SPACING)
            answers = list(self.bus.ask(key, timeout=timeout))
        return answers

    def describe(self, timeout: float = 1.0) -> list[Description]:
        """Description of every instance that answers, sorted by role and name."""
        found = {(node.role, node.instance): node for node in self.all_described(timeout)}
        return [found[source] for source in sorted(found)]

    def all_described(self, timeout: float = 1.0) -> list[Description]:
        """Every description that arrives, also several of one instance, which two processes run at once.

        `unreadable` says which answers were none.
        """
        from navloom_live.live.description import DescriptionError

        self.unreadable = {}
        found = []
        for answer in self.ask_again(self.keys.port("*", "*", "describe"), timeout):
            try:
                found += [] if answer.refusal else [self.described(answer)]
            except DescriptionError as error:
                role, instance, _ = self.keys.split(answer.key)
                self.unreadable[role, instance] = str(error)
        return found

    def described(self, answer: Answer) -> Description:
        """The description in an answer. Raises DescriptionError."""
        from navloom_live.live.description import read_description

        role, instance, _ = self.keys.split(answer.key)
        return read_description(role, instance, answer.data)

"""What tools ask of a live robot, over its own network."""

from __future__ import annotations

import contextlib
import json
import time
from collections.abc import Mapping
from typing import Any

from navloom.messages import Message
from navloom.messages.codec import CodecError, decode
from navloom.runtime.directory import RobotFolder
from navloom.runtime.keyspace import KeySpace
from navloom.runtime.zenoh_bus import Bus

__all__ = ["Client", "ClientError", "Refused"]

JOIN = 2.0
"""s until a tool has found the robot's processes."""


class ClientError(RuntimeError):
    """Nobody answers; the text says who was asked and what to do."""


class Refused(ValueError):
    """The robot answered, but does not do it; the text says why."""


class Client:
    """Asks the nodes of one robot.

    Args:
        bus: A session on its network.
        keys: Its names.
        home: Its folder, where it was started on this host.
    """

    def __init__(self, bus: Bus, keys: KeySpace, home: RobotFolder | None = None) -> None:
        self.bus, self.keys, self._home = bus, keys, home

    @property
    def was_ended(self) -> bool:
        """Whether what ran the robot on this host does so no more."""
        return self._home is not None and not self._home.is_claimed()

    def has_nodes(self) -> bool:
        """Whether any node of the robot is there."""
        return bool(self.bus.alive(self.keys.alive("*", "*", "*")))

    def call(self, role: str, instance: str, service: str, given: Mapping[str, Any], timeout: float = 4.0) -> Any:
        """What an instance answers.

        Raises:
            Refused: It says no; ClientError: nobody answers within s.
        """
        key, data = self.keys.port(role, instance, service), json.dumps(given).encode()
        limit = time.monotonic() + min(JOIN, timeout)
        while True:
            for answer in self.bus.ask(key, data, timeout):
                if answer.refusal:
                    if answer.refusal == "Timeout":
                        break
                    raise Refused(answer.refusal)
                return json.loads(answer.data)
            if time.monotonic() > limit:
                raise ClientError(
                    f"robot {self.keys.prefix}: {role} {instance} does not answer ({service}); "
                    "`navloom list` shows who is there, `navloom doctor` why not; a certificate may not be let ask this"
                )
            time.sleep(0.05)

    def last(self, role: str, instance: str, port: str, timeout: float = 1.0) -> Message | None:
        """The last message of a stream whose publisher keeps it; None where there is none."""
        for answer in self.bus.ask(self.keys.port(role, instance, port), timeout=timeout):
            if not answer.refusal:
                with contextlib.suppress(CodecError):
                    return decode(answer.data, answer.label)[0]
        return None

    def describe(self, timeout: float = 1.0) -> list[dict[str, Any]]:
        """Every instance that answers, in order of role and name."""
        found = {}
        for answer in self.bus.ask(self.keys.port("*", "*", "describe"), timeout=timeout):
            if not answer.refusal:
                found[answer.key] = json.loads(answer.data)
        return [found[key] for key in sorted(found)]

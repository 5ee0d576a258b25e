"""Keys on the network: `<realm>/<robot>/<role>/<instance>/<port>`, services and liveliness tokens."""

from __future__ import annotations

import re
from dataclasses import dataclass

__all__ = ["ALIVE", "ATTENDANT", "CLAIM", "FAULT", "GAINED", "LARGEST", "LINKED", "SUPERVISOR", "KeySpace",
           "key_part"]  # fmt: skip

ALIVE = "alive"
"""Key part of an instance's liveliness tokens."""
FAULT = "fault"
"""Port of the step reports with a fault, and of the first report without one after them; live only."""
LINKED = "linked"
"""Liveliness token of a process that has declared all streams that it reads."""
GAINED = "gained"
"""Liveliness token of a process that is about to start in a robot that is up, declared by the supervisor."""
ATTENDANT = "attendant"
"""Process name under which a recorder announces that it listens; no process has this name."""
CLAIM = "claim"
"""Key part of the liveliness tokens by which a process claims its nodes, see `hosting.node_claims`."""
SUPERVISOR = "supervisor"
"""Process name under which `navloom up` serves requests that concern the robot's processes."""
LARGEST = 64 * 2**20
"""Largest message, bytes; a larger one is counted and not copied."""


def key_part(name: str) -> str:
    """A name, as of a host, with every character replaced that has a meaning in a key or in a life or claim."""
    return re.sub(r"[^A-Za-z0-9._-]", "_", name)


@dataclass(frozen=True)
class KeySpace:
    """Keys of one robot."""

    realm: str
    robot: str

    @property
    def prefix(self) -> str:
        """Common beginning of all keys."""
        return f"{self.realm}/{self.robot}"

    def port(self, role: str, instance: str, port: str) -> str:
        """A stream or service of an instance; "*" matches any."""
        return f"{self.realm}/{self.robot}/{role}/{instance}/{port}"

    def alive(self, role: str, instance: str, life: str) -> str:
        """Liveliness token of an instance in one life of its process."""
        return self.port(role, instance, f"{ALIVE}/{life}")

    def process(self, name: str, service: str) -> str:
        """A service of a process."""
        return f"{self.realm}/{self.robot}/process/{name}/{service}"

    def split(self, key: str) -> tuple[str, str, str]:
        """Role, instance and the rest of a key of this robot."""
        role, instance, rest = key.removeprefix(f"{self.prefix}/").split("/", 2)
        return role, instance, rest

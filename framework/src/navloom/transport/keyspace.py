"""Names on the network: `<realm>/<robot>/<role>/<instance>/<port>`, and what hangs below it."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["ALIVE", "ATTENDANT", "FAULT", "LARGEST", "LINKED", "STEP", "KeySpace"]

ALIVE = "alive"
"""Where the liveliness tokens of an instance are."""
STEP = "step"
"""Port of every node's step reports."""
FAULT = "fault"
"""Port of the step reports that say of a fault, and of the first one after them that does not; live only."""
LINKED = "linked"
"""Liveliness token of a process that has declared what it reads, under its key."""
ATTENDANT = "attendant"
"""Name under which who hears everything announces that it does; none of a process."""
LARGEST = 64 * 2**20
"""Bytes of a message at most; a larger one is counted and not copied."""


@dataclass(frozen=True)
class KeySpace:
    """Keys of one robot."""

    realm: str
    robot: str

    @property
    def prefix(self) -> str:
        """What all of them begin with."""
        return f"{self.realm}/{self.robot}"

    def port(self, role: str, instance: str, port: str) -> str:
        """A stream, or a service of an instance; "*" stands for any."""
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

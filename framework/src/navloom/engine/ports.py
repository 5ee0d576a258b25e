"""How a node is wired: what it reads, how, and what it publishes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

__all__ = ["Input", "NodeSpec", "Reading"]

Reading = Literal["latest", "new", "track", "offers"]
"""How a port is read.

- latest: the newest message, or None.
- new: those since the node last stepped, oldest first.
- track: the newest ones up to a bound, consumed or not; by place, oldest first, as long as the step lasts.
- offers: newest (message, envelope) of the selected instance, for the gate.
"""


@dataclass(frozen=True)
class Input:
    """One thing a node reads.

    Attributes:
        name: What the node calls it.
        role, port: What it is wired to; the selected instance of the role is meant.
        reading: How.
        delayed: `~`: as published up to the end of the previous tick.
        triggers: A new message makes the node step.
    """

    name: str
    role: str
    port: str
    reading: Reading = "latest"
    delayed: bool = False
    triggers: bool = False

    def __str__(self) -> str:
        return f"{'~' if self.delayed else ''}{self.role}.{self.port}"


@dataclass(frozen=True)
class NodeSpec:
    """One row of the node table.

    Attributes:
        role: Role, or the framework's own node: operator, goal, reference, gate.
        inputs: What it reads.
        outputs: Its ports.
        cause: Input whose Platform stamp its outputs derive from; empty for the platform itself.
        ticks: It steps in every tick; else a trigger is needed.
    """

    role: str
    inputs: tuple[Input, ...]
    outputs: tuple[str, ...]
    cause: str = ""
    ticks: bool = False

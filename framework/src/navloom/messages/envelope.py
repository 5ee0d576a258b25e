"""What travels round a message, and what a step leaves behind."""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["Envelope", "StepRecord"]


class Envelope(NamedTuple):
    """What travels round every message.

    Attributes:
        key: `<realm>/<robot>/<role>/<instance>/<port>`.
        sequence: Rises by one with each message of the key.
        tick: Tick of the step that made it.
        stamp_ns: Run clock of that tick.
        cause_ns: Run clock of the newest Platform output it derives from.
        epoch: Selection in force when it was made.
    """

    key: str
    sequence: int
    tick: int
    stamp_ns: int
    cause_ns: int
    epoch: int


class StepRecord(NamedTuple):
    """What one step of a node consumed, enough to feed it again.

    Attributes:
        role, instance: Whose step.
        tick: When.
        trigger: Port (or "tick") that made it step.
        consumed: Input and the sequences read at it, see `InputRead`.
        params_version: Rises with each change of the parameters.
        resets: How often the instance was reset: 0, as a run makes new objects instead.
        duration_ns: Time the step took on this machine: never in a message or a trace.
        stamp_ns: Run clock of the tick.
        epoch: Selection in force.
        fault: What the plugin raised, empty for nothing.
        told: What the executor told the node beside its inputs, see `StepReport`.
    """

    role: str
    instance: str
    tick: int
    trigger: str
    consumed: tuple[tuple[str, tuple[int, ...]], ...]
    params_version: int
    resets: int
    duration_ns: int
    stamp_ns: int = 0
    epoch: int = 0
    fault: str = ""
    told: str = ""

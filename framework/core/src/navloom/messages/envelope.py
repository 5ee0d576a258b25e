"""The envelope of a message, and the record of a step."""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["Envelope", "StepRecord"]


class Envelope(NamedTuple):
    """Origin and times of a message.

    Attributes:
        key: `<realm>/<robot>/<role>/<instance>/<port>`.
        sequence: Increases by one with each message of the key.
        tick: Tick of the step that made it.
        stamp_ns: Run clock of that tick.
        cause_ns: Run clock of the newest Platform output that it derives from.
        epoch: Epoch of the selection when it was made.
    """

    key: str
    sequence: int
    tick: int
    stamp_ns: int
    cause_ns: int
    epoch: int


class StepRecord(NamedTuple):
    """What one step of a node consumed, so that a replay can repeat it.

    Attributes:
        role, instance: The node.
        tick: Tick of the step.
        trigger: Input (or "tick") that made it step.
        consumed: Inputs with the sequence numbers read, see `InputRead`.
        params_version: Increases with each change of the parameters.
        resets: How often the instance was reset: 0, as a run makes new objects instead.
        duration_ns: Duration of the step on this machine; never in a message or a trace.
        stamp_ns: Run clock of the tick.
        epoch: Epoch of the selection.
        fault: Exception that the plugin raised, as text; empty for none.
        told: What the executor told the node in addition to its inputs, see `StepReport`.
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

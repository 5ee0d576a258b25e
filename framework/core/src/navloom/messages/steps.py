"""Reports of a node's steps, for nodes that wait for it, for supervision and for replay."""

from __future__ import annotations

from typing import Annotated

from navloom.messages.schema import Message, Most, Name, Words, message

__all__ = ["InputRead", "Parameters", "PortMark", "StepReport"]


@message()
class InputRead(Message):
    """What a step read from one input.

    Attributes:
        input: Name of the input in the node.
        sequences: Sequence numbers of the messages: all new ones of a queue, or the newest one; of a track, the first
            and the last of each run without a gap.
    """

    input: Name
    sequences: tuple[int, ...]


@message()
class PortMark(Message):
    """High-water mark of a port.

    Attributes:
        port: Name of the port.
        sequence: Number of the last message published on it; 0 for none yet.
    """

    port: Name
    sequence: int


@message()
class StepReport(Message):
    """Report of one tick of a node; also sent if the node publishes nothing, so that a missing report is noticed.

    Attributes:
        trigger: Input (or "tick") that made it step; "check" for a gate that stopped between two ticks; empty if it
            did not step.
        read: The messages that it consumed.
        published: Every port with its mark after this tick.
        enabled: It steps when triggered; a waiting alternative, or a plugin that failed in lockstep, does not.
        params_version: Increases with each change of the parameters.
        resets: How often the instance was reset: 0, as a run makes new objects instead.
        duration_ns: Duration of the step on its machine.
        fault: Exception that the plugin raised in this tick, as text; empty for none.
        told: What the executor told the node in addition to its inputs, as a JSON object; empty for nothing. See
            `engine.nodes.executor_inputs`.
    """

    trigger: Name
    read: Annotated[tuple[InputRead, ...], Most(1024)]
    published: Annotated[tuple[PortMark, ...], Most(256)]
    enabled: bool
    params_version: int
    resets: int
    duration_ns: int
    fault: Words
    told: Annotated[str, Most(1 << 17)] = ""


@message()
class Parameters(Message):
    """Parameters of an instance that were changed during the run.

    Attributes:
        version: Number of changes so far.
        values: TOML assignments `name = value`, one per string.
    """

    version: int
    values: Annotated[tuple[str, ...], Most(256)]

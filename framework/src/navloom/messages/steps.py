"""What a node says of each of its steps, for those who wait for it, watch over it, or replay it."""

from __future__ import annotations

from typing import Annotated

from navloom.messages.schema import Message, Most, Name, Words, message

__all__ = ["InputRead", "Parameters", "PortMark", "StepReport"]


@message()
class InputRead(Message):
    """What a step read at one input.

    Attributes:
        input: What the node calls it.
        sequences: Numbers of the messages: all new ones of a trigger, the last one of a sample; of a track the first
            and the last number of each run without a gap.
    """

    input: Name
    sequences: tuple[int, ...]


@message()
class PortMark(Message):
    """High-water mark of a port: sequence of the last message published there, 0 for none yet."""

    port: Name
    sequence: int


@message()
class StepReport(Message):
    """One tick of a node; sent in silent ones too, so that a missing one means something.

    Attributes:
        trigger: Input (or "tick") that made it step; "check" for a gate that stopped between two ticks; empty where
            it did not step.
        read: What it consumed.
        published: Every port with its mark after this tick.
        enabled: It steps when triggered; an alternative that waits, or a plugin that broke in lockstep, does not.
        params_version: Rises with each change of the parameters.
        resets: How often the instance was reset: 0, as a run makes new objects instead.
        duration_ns: Time the step took on its machine.
        fault: What the plugin raised in this tick, empty for nothing.
        told: What the executor told the node beside its inputs, as a JSON object; empty for nothing. See
            `engine.own_nodes`.
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
    """Parameters of an instance that were changed while it ran.

    Attributes:
        version: Counts the changes.
        values: TOML assignments `name = value`, one a string.
    """

    version: int
    values: Annotated[tuple[str, ...], Most(256)]

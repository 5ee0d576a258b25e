"""Finds the first difference between two messages that should be equal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from navloom.messages import Message
from navloom.messages.codec import encode, schema_label
from navloom.messages.kinds import brief
from navloom.messages.schema import in_version

from navloom_recording.reader import Recorded

__all__ = ["ReplayDifference", "first_difference", "is_same"]


@dataclass(frozen=True)
class ReplayDifference:
    """One difference between a replay and the recording.

    Attributes:
        tick: Tick of the step.
        node: "role instance".
        port: Port of the message.
        field: Dotted path of the field, with array indices; empty for the message as a whole.
        recorded, replayed: The two values as text.
    """

    tick: int
    node: str
    port: str
    field: str
    recorded: str
    replayed: str

    def __str__(self) -> str:
        where = f"{self.port}.{self.field}" if self.field else self.port
        return f"tick {self.tick}, {self.node}, {where}: recorded {self.recorded}, replayed {self.replayed}"


def is_same(recorded: Recorded, data: bytes | memoryview, label: str, replayed: Message) -> bool:
    """Whether a replayed message, in the recorded version of its schema, is the recorded one, bit for bit."""
    replayed = in_version(replayed, label)
    return schema_label(type(replayed)) == label and encode(replayed, recorded.envelope) == data


def first_difference(recorded: Any, replayed: Any, place: str = "") -> tuple[str, str, str] | None:
    """Path, recorded and replayed value of the first difference of two values; None if they are equal."""
    if type(recorded) is not type(replayed):
        return place, _named(recorded), _named(replayed)
    if isinstance(recorded, Message):
        for name in type(recorded).kinds:
            found = first_difference(getattr(recorded, name), getattr(replayed, name), f"{place}.{name}".lstrip("."))
            if found is not None:
                return found
        return None
    if isinstance(recorded, tuple):
        if len(recorded) != len(replayed):
            return place, f"{len(recorded)} entries", f"{len(replayed)} entries"
        for number, pair in enumerate(zip(recorded, replayed, strict=True)):
            found = first_difference(*pair, f"{place}[{number}]")
            if found is not None:
                return found
        return None
    if isinstance(recorded, np.ndarray):
        return _of_arrays(recorded, replayed, place)
    same = recorded == replayed and repr(recorded) == repr(replayed)  # 0.0 and -0.0 differ
    return None if same else (place, repr(recorded), repr(replayed))


def _of_arrays(recorded: Any, replayed: Any, place: str) -> tuple[str, str, str] | None:
    if recorded.shape != replayed.shape:
        return place, f"shape {recorded.shape}", f"shape {replayed.shape}"
    differing = np.argwhere(
        # 0.0 and -0.0 are equal and have other bytes.
        (recorded != replayed) | (np.signbit(recorded) != np.signbit(replayed))
        if recorded.dtype.kind == "f"
        else recorded != replayed
    )
    if not len(differing):
        return None
    at = tuple(int(index) for index in differing[0])
    text = ", ".join(map(str, at))
    return f"{place}[{text}]", repr(recorded[at].item()), repr(replayed[at].item())


def _named(value: Any) -> str:
    return type(value).__name__ if isinstance(value, Message) else brief(value)

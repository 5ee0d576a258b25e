"""What waits to be sent to one browser: the newest of each kind, so that a slow or frozen one delays nothing."""

from __future__ import annotations

import asyncio
import json
from dataclasses import dataclass
from typing import Any

__all__ = ["Frame", "Outbox", "binary_frame", "text_frame"]


@dataclass(frozen=True)
class Frame:
    """A message for browsers, encoded once for all of them; only its age and the time are added when it is sent.

    Attributes:
        slot: Its kind; a newer frame of the same slot replaces it.
        head: JSON object without its closing brace.
        raw: Bytes that follow the head in a binary frame; None for a text frame.
        stamp_ns: Run clock of what it shows; None if it has no age.
    """

    slot: str
    head: str
    raw: bytes | None
    stamp_ns: int | None

    def wire(self, age: float | None, now: float) -> str | bytes:
        """What is sent, with the age, s, and the server's time, s."""
        head = f'{self.head},"age":{"null" if age is None else f"{age:.3f}"},"sent":{now:.3f}}}'
        if self.raw is None:
            return head
        encoded = head.encode()
        return b"".join((len(encoded).to_bytes(4, "little"), encoded, self.raw))


def text_frame(kind: str, fields: dict[str, Any], stamp_ns: int | None, slot: str = "") -> Frame:
    """A text frame of a kind. Its slot is the kind unless given."""
    return Frame(slot or kind, json.dumps({"kind": kind, **fields}, allow_nan=False)[:-1], None, stamp_ns)


def binary_frame(kind: str, header: dict[str, Any], raw: bytes, stamp_ns: int | None, slot: str = "") -> Frame:
    """A binary frame: length of the header, u32 little endian, the header as JSON, then the raw bytes."""
    return Frame(slot or kind, json.dumps({"kind": kind, **header}, allow_nan=False)[:-1], raw, stamp_ns)


class Outbox:
    """Frames that wait for one browser, at most one a slot. For the server's loop only."""

    def __init__(self) -> None:
        self._waiting: dict[str, Frame] = {}
        self._news = asyncio.Event()

    def __len__(self) -> int:
        """Number of frames that wait."""
        return len(self._waiting)

    def put(self, frame: Frame) -> None:
        """Add a frame, in the place of an older one of its slot."""
        self._waiting[frame.slot] = frame
        self._news.set()

    async def take(self) -> Frame:
        """The frame that has waited longest, as soon as there is one."""
        await self._news.wait()
        frame = self._waiting.pop(next(iter(self._waiting)))
        if not self._waiting:
            self._news.clear()
        return frame

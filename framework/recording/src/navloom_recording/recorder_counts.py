"""Counts the messages that a recorder kept and lost, by stream."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from typing import Any

__all__ = ["RecorderCounts"]


@dataclass
class RecorderCounts:
    """Counters of a recorder.

    Attributes:
        messages: Number of messages kept.
        dropped: By key, messages received while the recorder's queue was full.
        lost: By key, messages never received: gaps in the sequence.
        malformed: By key, payloads that were not messages of that stream.
    """

    messages: int = 0
    dropped: defaultdict[str, int] = field(default_factory=lambda: defaultdict(int))
    lost: defaultdict[str, int] = field(default_factory=lambda: defaultdict(int))
    malformed: defaultdict[str, int] = field(default_factory=lambda: defaultdict(int))
    _last: dict[str, int] = field(default_factory=dict)

    def note(self, key: str, sequence: int) -> None:
        """Count a kept message. A falling sequence number means that the publisher restarted."""
        last = self._last.get(key)
        if last is not None and sequence > last + 1:
            self.lost[key] += sequence - last - 1
        self._last[key] = sequence
        self.messages += 1

    def has(self, key: str, sequence: int) -> bool:
        """Whether this is the message of the stream that was kept last."""
        return self._last.get(key) == sequence

    def missed(self) -> int:
        """Number of messages of all streams that are missing in the recording."""
        return sum(sum(one.values()) for one in (self.dropped, self.lost, self.malformed))

    def summary(self) -> dict[str, Any]:
        """The counters as they are stored in the file."""
        return {
            "messages": self.messages,
            "dropped": dict(sorted(self.dropped.items())),
            "lost": dict(sorted(self.lost.items())),
            "malformed": dict(sorted(self.malformed.items())),
        }

"""What a recorder kept and lost, stream by stream."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from typing import Any

__all__ = ["RecorderCounts"]


@dataclass
class RecorderCounts:
    """Counters of a recorder.

    Attributes:
        messages: Kept.
        dropped: By key, came in but found the recorder's queue full.
        lost: By key, never came in: gaps in its sequence.
        malformed: By key, were no messages of that stream.
    """

    messages: int = 0
    dropped: defaultdict[str, int] = field(default_factory=lambda: defaultdict(int))
    lost: defaultdict[str, int] = field(default_factory=lambda: defaultdict(int))
    malformed: defaultdict[str, int] = field(default_factory=lambda: defaultdict(int))
    _last: dict[str, int] = field(default_factory=dict)

    def note(self, key: str, sequence: int) -> None:
        """A message was kept. A number that falls is a publisher that began anew."""
        last = self._last.get(key)
        if last is not None and sequence > last + 1:
            self.lost[key] += sequence - last - 1
        self._last[key] = sequence
        self.messages += 1

    def has(self, key: str, sequence: int) -> bool:
        """It is the message of its stream that was kept last."""
        return self._last.get(key) == sequence

    def missed(self) -> int:
        """Messages of all streams that are not in the recording."""
        return sum(sum(one.values()) for one in (self.dropped, self.lost, self.malformed))

    def summary(self) -> dict[str, Any]:
        """As it stands in the file."""
        return {
            "messages": self.messages,
            "dropped": dict(sorted(self.dropped.items())),
            "lost": dict(sorted(self.lost.items())),
            "malformed": dict(sorted(self.malformed.items())),
        }

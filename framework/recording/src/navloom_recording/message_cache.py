"""Recent messages of a recording, by key and sequence, bounded so that a long recording fits in memory."""

from __future__ import annotations

from collections import defaultdict, deque

from navloom.messages.codec import CodecError

from navloom_recording.reader import RawRecorded, Recorded

__all__ = ["Entry", "Shelf"]

MOST = 8192
"""Most messages that are kept of a key; more than any node reads back."""
MOST_BYTES = 96 << 20
AT_LEAST = 64
"""Most bytes that are kept of a key, and the number of messages that are kept whatever their size."""


class Entry:
    """One message, decoded only once, so that comparisons by identity see the same object each time."""

    __slots__ = ("_opened", "place", "raw")

    def __init__(self, raw: RawRecorded, place: int) -> None:
        self.raw, self.place = raw, place
        self._opened: Recorded | None = None

    def open(self) -> Recorded | None:
        """The message; None if it cannot be decoded."""
        if self._opened is None:
            try:
                self._opened = self.raw.open()
            # Counted by the reader; here it is only missing.
            except CodecError:
                return None
        return self._opened


class Shelf:
    """Holds entries by key. A restarted publisher counts from 1 again, so the entry nearest in the file is taken."""

    def __init__(self) -> None:
        self._order: defaultdict[str, deque[Entry]] = defaultdict(deque)
        self._bytes: defaultdict[str, int] = defaultdict(int)
        self._by_number: defaultdict[str, dict[int, list[Entry]]] = defaultdict(dict)

    def put(self, entry: Entry) -> None:
        """Keep a message; drop the oldest of its key if there are too many."""
        key, order = entry.raw.key, self._order[entry.raw.key]
        order.append(entry)
        self._bytes[key] += len(entry.raw.data)
        self._by_number[key].setdefault(entry.raw.sequence, []).append(entry)
        while len(order) > MOST or (self._bytes[key] > MOST_BYTES and len(order) > AT_LEAST):
            self._forget(key)

    def get(self, key: str, sequence: int, place: int) -> Entry | None:
        """The message of a sequence number that is nearest to a place in the file; None if it is not kept."""
        # MCAP keeps 32 bits of a sequence number.
        found = self._by_number[key].get(sequence & 0xFFFFFFFF)
        return min(found, key=lambda entry: abs(entry.place - place)) if found else None

    def recent(self, key: str) -> deque[Entry]:
        """The kept messages of a key, oldest first."""
        return self._order[key]

    def _forget(self, key: str) -> None:
        entry = self._order[key].popleft()
        self._bytes[key] -= len(entry.raw.data)
        same = self._by_number[key][entry.raw.sequence]
        same.remove(entry)
        if not same:
            del self._by_number[key][entry.raw.sequence]

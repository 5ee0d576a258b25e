"""The outcome of an import for the user: what was taken of each topic, and notes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

__all__ = ["Imported", "Topic", "reasons_of"]


@dataclass
class Topic:
    """A topic of the bag and the outcome of its import.

    Attributes:
        name, type: The ROS name and type.
        sensor: Port in the recording; empty if the topic was skipped.
        messages: Number of converted messages; of transforms, those that were read.
        skipped: Number of skipped messages by reason; if the whole topic was skipped, all its messages.
    """

    name: str
    type: str
    sensor: str = ""
    messages: int = 0
    skipped: Counter[str] = field(default_factory=Counter)

    def skip(self, why: str, count: int) -> None:
        """Skip the whole topic."""
        self.sensor = ""
        self.skipped[why] = count

    def to_json(self) -> dict[str, Any]:
        """An entry of `navloom ros import --json`."""
        return {**vars(self), "skipped": dict(self.skipped)}


@dataclass
class Imported:
    """Outcome of an import: the topics in order of name, the first and the last stamp, ns, and what else to know."""

    topics: list[Topic]
    first_ns: int = 0
    last_ns: int = 0
    notes: list[str] = field(default_factory=list)


def reasons_of(topics: Iterable[Topic]) -> str:
    """The most frequent reason of each topic that was skipped."""
    return "; ".join(
        f"{topic.name} ({topic.type}): {topic.skipped.most_common(1)[0][0]}" for topic in topics if topic.skipped
    )

"""How much a shadow of a running robot differs from the active instance so far."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

__all__ = ["ShadowState"]


@dataclass(frozen=True)
class ShadowState:
    """Comparison of a shadow with the active instances, as it stands now.

    Attributes:
        role, instance: The shadow.
        against: The active instance that it was compared with last.
        ticks: Number of ticks compared; None if it is not compared.
        unanswered: Number of ticks in which only one of the two answered.
        differing_share: Share of the compared ticks in which they differ; None without any.
        now, mean: Newest difference, and mean absolute difference, by name; units in `difference_units`.
        stops: Number of ticks in which it commanded no motion while the active instance did.
        handovers: Number of ticks in which one of two avoiders would have driven and the other one not.
    """

    role: str
    instance: str
    against: str | None = None
    ticks: int | None = None
    unanswered: int = 0
    differing_share: float | None = None
    now: Mapping[str, float] = field(default_factory=dict)
    mean: Mapping[str, float] = field(default_factory=dict)
    stops: int = 0
    handovers: int = 0

    def to_json(self) -> dict[str, Any]:
        """The JSON object; of a shadow that is not compared, only its names, and `ticks` null."""
        if self.ticks is None:
            return {"role": self.role, "instance": self.instance, "ticks": None}
        return asdict(self)

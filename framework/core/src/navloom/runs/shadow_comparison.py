"""Compares the answers of shadows with those of the active instance, tick by tick."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from navloom.engine.catalogue import FRAMEWORK, Catalogue
from navloom.engine.differences import differences, is_differing, would_stop
from navloom.engine.shadow_state import ShadowState
from navloom.messages import Envelope, HandOver, Message, StepRecord

if TYPE_CHECKING:
    from navloom.engine.system import System

__all__ = ["Disagreement", "DrivingSummary", "ShadowSummary", "ShadowWatch", "Sizes", "shadow_table"]


@dataclass(frozen=True)
class Sizes:
    """Root mean square and maximum of a difference, in its unit."""

    rms: float
    max: float


@dataclass(frozen=True)
class DrivingSummary:
    """The part of a `ShadowSummary` for the ticks in which the active avoider drove."""

    ticks: int
    differing_share: float | None
    differences: Mapping[str, Sizes]


@dataclass(frozen=True)
class ShadowSummary:
    """Summary of a finished comparison.

    Attributes:
        role, instance: The shadow.
        against: The active instances, in the order in which they were active.
        ticks: Number of ticks compared.
        unanswered, stops, handovers: See `Disagreement`.
        differing_share: Share of the compared ticks in which any difference exceeds its tolerance; None without any.
        first_differing_tick, first_differing_s: The first of them, and its time, s; None if there is none.
        differences: Sizes of each difference over all compared ticks, by name.
        driving: The same for the ticks in which the active avoider drove; None for other roles.
    """

    role: str
    instance: str
    against: list[str]
    ticks: int
    unanswered: int
    differing_share: float | None
    stops: int = 0
    handovers: int = 0
    first_differing_tick: int | None = None
    first_differing_s: float | None = None
    differences: Mapping[str, Sizes] = field(default_factory=dict)
    driving: DrivingSummary | None = None

    def to_json(self) -> dict[str, Any]:
        """For `--json` and the journal of a study."""
        return asdict(self)


@dataclass(eq=False)
class Disagreement:
    """Comparison of one shadow with the active instances.

    Attributes:
        role, instance: The shadow.
        against: The active instances, in the order in which they were active.
        times: Time of each compared tick, s on the run clock, at which the answers were made.
        ticks: Numbers of the compared ticks.
        values: By name, the difference in each tick (`engine.differences`); NaN where it is not defined.
        differing: For each tick, whether any difference exceeds its tolerance.
        driving: For each tick of an avoider, whether the active avoider drove.
        unanswered: Number of ticks in which only one of the two answered.
        stops: Number of ticks in which it commanded no motion while the active instance did.
        handovers: Number of ticks in which one of two avoiders would have driven and the other one not.
    """

    role: str
    instance: str
    against: list[str] = field(default_factory=list)
    times: list[float] = field(default_factory=list)
    ticks: list[int] = field(default_factory=list)
    values: dict[str, list[float]] = field(default_factory=dict)
    differing: list[bool] = field(default_factory=list)
    driving: list[bool] = field(default_factory=list)
    unanswered: int = 0
    stops: int = 0
    handovers: int = 0

    def add(self, tick: int, time: float, against: str, found: Mapping[str, float], driving: bool = False) -> None:
        """Add one tick."""
        if against not in self.against:
            self.against.append(against)
        before = len(self.ticks)
        self.ticks.append(tick)
        self.times.append(time)
        self.differing.append(is_differing(dict(found)))
        self.driving.append(driving)
        for name in [*self.values, *(name for name in found if name not in self.values)]:
            self.values.setdefault(name, [math.nan] * before).append(found.get(name, math.nan))

    def so_far(self) -> ShadowState:
        """State for `navloom status`: the summary, with the newest and the mean absolute value of each difference."""
        now = {name: values[-1] for name, values in self.values.items() if not math.isnan(values[-1])}
        sizes = {name: np.abs(np.array(values, dtype=np.float64)) for name, values in self.values.items()}
        return ShadowState(
            self.role,
            self.instance,
            against=self.against[-1] if self.against else None,
            ticks=len(self.ticks),
            unanswered=self.unanswered,
            differing_share=_share(np.array(self.differing, dtype=np.bool_)),
            now=now,
            mean={name: float(np.nanmean(size)) for name, size in sizes.items() if not np.isnan(size).all()},
            stops=self.stops,
            handovers=self.handovers,
        )

    def summary(self) -> ShadowSummary:
        """Ticks compared, the share that differ, and RMS and maximum of each difference."""
        drove = np.array(self.driving, dtype=np.bool_)
        first = self.differing.index(True) if True in self.differing else None
        differing = np.array(self.differing, dtype=np.bool_)
        driving = DrivingSummary(int(drove.sum()), _share(differing[drove]), self._sizes(drove))
        return ShadowSummary(
            self.role,
            self.instance,
            against=list(self.against),
            ticks=len(self.ticks),
            unanswered=self.unanswered,
            differing_share=_share(differing),
            stops=self.stops,
            handovers=self.handovers,
            first_differing_tick=None if first is None else self.ticks[first],
            first_differing_s=None if first is None else self.times[first],
            differences=self._sizes(np.ones_like(drove)),
            driving=driving if self.role == "avoider" else None,
        )

    def _sizes(self, these: NDArray[np.bool_]) -> dict[str, Sizes]:
        """RMS and maximum of each difference over the ticks of a mask."""
        found = {}
        for name, values in self.values.items():
            known = np.abs(np.array(values, dtype=np.float64))[these]
            known = known[~np.isnan(known)]
            if known.size:
                found[name] = Sizes(math.sqrt(float((known**2).mean())), float(known.max()))
        return found


def _share(flags: NDArray[np.bool_]) -> float | None:
    return float(flags.mean()) if flags.size else None


class ShadowWatch:
    """An observer that compares answers of the same tick, even if they are published at different times.

    Args:
        shadows: By role, the instances that run beside the active one.
        horizon: Number of ticks after which no answer can come any more: the longest `latency`.
        catalogue: Declarations of the nodes.
    """

    wants_steps = False

    def __init__(
        self, shadows: Mapping[str, tuple[str, ...]], horizon: int = 0, catalogue: Catalogue = FRAMEWORK
    ) -> None:
        self.wants: frozenset[tuple[str, str]] | None = frozenset(
            (role, port)
            for role in shadows
            for port in (*catalogue.answer_ports(role), *(("handover",) if role == "avoider" else ()))
        )
        self.horizon = horizon
        self.found = {(role, name): Disagreement(role, name) for role, names in shadows.items() for name in names}
        self._open: dict[str, dict[int, dict[str, tuple[bool, Message, Envelope]]]] = {role: {} for role in shadows}
        self._engaged: dict[int, dict[str, bool]] = {}

    @classmethod
    def of(cls, system: System) -> ShadowWatch | None:
        """The watch over a system's shadows; None if there are none."""
        period = system.config.run.period
        shadows: dict[str, tuple[str, ...]] = {}
        for table in system.config.alternative:
            if table.shadow:
                shadows[table.role] = (*shadows.get(table.role, ()), table.instance)
        delays = [part.table.latency for part in system.parts.values()]
        horizon = math.ceil(round(max(delays, default=0.0) / period, 6))
        return cls(shadows, horizon, system.catalogue) if shadows else None

    def on_message(self, role: str, instance: str, active: bool, port: str, message: Message, at: Envelope) -> None:
        """Keep an answer until the other answers of its tick have come or can no longer come."""
        if isinstance(message, HandOver):
            self._engaged.setdefault(at.tick, {})[instance] = message.engaged
            return
        open_ticks = self._open[role]
        for tick in [tick for tick in open_ticks if tick < at.tick - self.horizon]:
            self._close(role, tick)
        open_ticks.setdefault(at.tick, {})[instance] = (active, message, at)

    def on_step(self, record: StepRecord) -> None:
        """Never called: `wants_steps` is false."""

    def finish(self) -> list[Disagreement]:
        """Compare the remaining answers, and return all comparisons in the order of the config."""
        for role, open_ticks in self._open.items():
            for tick in sorted(open_ticks):
                self._close(role, tick)
        return list(self.found.values())

    def _close(self, role: str, tick: int) -> None:
        answers = self._open[role].pop(tick)
        engaged = self._engaged.pop(tick, {}) if role == "avoider" else {}
        ours = next(((name, *answer[1:]) for name, answer in answers.items() if answer[0]), None)
        names = [name for name, answer in answers.items() if not answer[0]]
        # An instance that was swapped out continues as a shadow; one that was swapped in is no longer one.
        for name in [*names, *(n for r, n in self.found if r == role and n not in answers)]:
            seen = self.found.setdefault((role, name), Disagreement(role, name))
            if ours is None or name not in answers:
                seen.unanswered += 1
                continue
            against, message, at = ours
            theirs, drove = answers[name][1], engaged.get(against, False)
            seen.add(tick, at.stamp_ns * 1e-9, against, differences(role, message, theirs), drove)
            seen.stops += would_stop(message, theirs)
            seen.handovers += engaged.get(name, drove) != drove


def shadow_table(found: list[Disagreement]) -> str:
    """Every difference of every tick as CSV, one a line, numbers with 9 digits."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["time_s", "tick", "role", "instance", "quantity", "difference", "differs"])
    for disagreement in found:
        for name, values in disagreement.values.items():
            for time, tick, value, differs in zip(
                disagreement.times, disagreement.ticks, values, disagreement.differing, strict=True
            ):
                if not math.isnan(value):
                    writer.writerow(
                        [
                            f"{time:.9g}",
                            tick,
                            disagreement.role,
                            disagreement.instance,
                            name,
                            f"{value:.9g}",
                            int(differs),
                        ]
                    )
    return text.getvalue()

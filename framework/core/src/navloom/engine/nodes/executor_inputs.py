"""What an executor tells goal, gate and localizer nodes in addition to their inputs, so that a replay can repeat it.

A step record holds it as the text `told`, a JSON object; empty for nothing. Its fields are defined here.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

from navloom.inputs.typed_json import from_json
from navloom.messages import Goal, OperatorRequest, Point2D, StopReason
from navloom.messages.stop_reasons import STOPS

__all__ = ["GateTold", "GoalTold", "LocalizerTold", "Obeyed"]


@dataclass(frozen=True)
class GoalTold:
    """What the goal node was told for one step.

    Attributes:
        fault: Failure that ends the goal; empty for none.
        lost: The platform is silent.
        restarted: Roles whose instance restarted since the previous step, sorted.
        submitted: Requests that came through a service instead of a port since the previous step.
    """

    fault: str = ""
    lost: bool = False
    restarted: tuple[str, ...] = ()
    submitted: tuple[OperatorRequest, ...] = ()

    @property
    def text(self) -> str:
        """Text for the step record; empty for nothing."""
        # Empty instead of a text of defaults: recordings of quiet ticks stay small.
        if self == GoalTold():
            return ""
        submitted = tuple(_Submitted.of(request) for request in self.submitted)
        return json.dumps(asdict(_GoalRecord(self.fault, self.lost, self.restarted, submitted)))

    @classmethod
    def of(cls, text: str) -> GoalTold:
        """From a step record."""
        told = from_json(_GoalRecord, text or "{}")
        return cls(told.fault, told.lost, told.restarted, tuple(one.request for one in told.submitted))


@dataclass(frozen=True)
class _Submitted:
    """A request as a step record holds it; its goal as number, x, y, heading and points to pass."""

    do: Any  # `OperatorRequest` checks it
    goal: tuple[int, float, float, float | None, tuple[tuple[float, float], ...]] | None = None

    @classmethod
    def of(cls, request: OperatorRequest) -> _Submitted:
        goal = request.goal
        if goal is None:
            return cls(request.do)
        via = tuple((point.x, point.y) for point in goal.via)
        return cls(request.do, (goal.goal_id, goal.x, goal.y, goal.heading, via))

    @property
    def request(self) -> OperatorRequest:
        if self.goal is None:
            return OperatorRequest(self.do)
        number, x, y, heading, via = self.goal
        return OperatorRequest(self.do, Goal(number, x, y, heading, tuple(Point2D(*point) for point in via)))


@dataclass(frozen=True)
class _GoalRecord:
    """`GoalTold` as a step record holds it."""

    fault: str = ""
    lost: bool = False
    restarted: tuple[str, ...] = ()
    submitted: tuple[_Submitted, ...] = ()


@dataclass(frozen=True)
class LocalizerTold:
    """What a localizer's node was told for one step.

    Attributes:
        places: What came through a service since the previous step: a pose, x, y, m, heading, rad, and its standard
            deviations, m and rad, or None for an exact one; or None, to search anywhere.
    """

    places: tuple[tuple[float, float, float, float | None, float | None] | None, ...] = ()

    @property
    def text(self) -> str:
        """Text for the step record; empty for nothing."""
        return json.dumps(asdict(self)) if self.places else ""

    @property
    def requests(self) -> Iterator[OperatorRequest]:
        """The places as requests."""
        for place in self.places:
            if place is None:
                yield OperatorRequest("relocalise")
            else:
                x, y, heading, spread, heading_spread = place
                goal = Goal(0, x, y, heading, ())
                yield OperatorRequest("place", goal, spread=spread, heading_spread=heading_spread)

    @classmethod
    def of(cls, text: str) -> LocalizerTold:
        """From a step record."""
        return from_json(cls, text or "{}")


def place_of(request: OperatorRequest) -> tuple[float, float, float, float | None, float | None] | None:
    """A request as `LocalizerTold` holds it."""
    goal = request.goal
    if goal is None or goal.heading is None:
        return None
    return goal.x, goal.y, goal.heading, request.spread, request.heading_spread


@dataclass(frozen=True)
class Obeyed:
    """A request that the gate received through a service.

    Attributes:
        do, role, instance: Fields of the request.
        driving: Sequence number of the newest command of an operator who was driving; 0 for none.
    """

    do: Any  # `OperatorRequest` checks it
    role: str
    instance: str
    driving: int


@dataclass(frozen=True)
class GateTold:
    """What the gate node was told for one step.

    Attributes:
        now_ns: Live: what the platform's clock shows now.
        silent: Live: the platform is silent.
        gone: Live: why a required node does not do its part, as `gone_text` writes it; empty for none.
        obeyed: Live: requests that came through a service since the previous step.
        contact: A contact was latched between two steps.
        warm: "role instance" of the instances that were able to take over.
        waiting: Which node waits for which stream; empty for none.
        restarted: Live: the platform restarted.
        late: Live: the goal node, if its last step is too old; otherwise empty.
        speed_limit: Live: see `CommandGate`.
    """

    now_ns: int | None = None
    silent: bool = False
    gone: str = ""
    obeyed: tuple[Obeyed, ...] = ()
    contact: bool = False
    warm: tuple[str, ...] = ()
    waiting: str = ""
    restarted: bool = False
    late: str = ""
    speed_limit: float = 0.0

    @property
    def text(self) -> str:
        """Text for the step record: only the fields that are set."""
        if self.now_ns is None and not self.warm and not self.waiting:
            return ""
        # Only what is set: the record is written in every tick, and most of it is empty.
        words = {name: value for name, value in vars(self).items() if value}
        if self.obeyed:
            words["obeyed"] = [vars(one) for one in self.obeyed]
        return json.dumps(words)

    @classmethod
    def of(cls, text: str) -> GateTold:
        """From a step record."""
        return from_json(cls, text or "{}")


def gone_text(gone: StopReason | None) -> str:
    """Why a required node does not do its part, as step records hold it: a missing node by its name alone."""
    return "" if gone is None else gone.text.removeprefix(STOPS["gone"].text)


def gone_of(text: str) -> StopReason | None:
    """The reason that `gone_text` wrote."""
    reason = StopReason.parse(text)
    is_name = reason is not None and reason.kind == "other"
    return StopReason.parse(f"{STOPS['gone'].text}{text}") if is_name else reason

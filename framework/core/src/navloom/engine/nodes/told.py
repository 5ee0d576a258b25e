"""What an executor tells the goal and gate nodes in addition to their inputs, so that a replay can repeat it.

A step record holds it as the text `told`, a JSON object; empty for nothing. Its fields are defined here.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from navloom.messages import Goal, OperatorRequest, Point2D

__all__ = ["GateTold", "GoalTold", "Obeyed"]


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
        if self == GoalTold():
            return ""
        told = {
            "fault": self.fault,
            "lost": self.lost,
            "restarted": list(self.restarted),
            "submitted": [_request_words(request) for request in self.submitted],
        }
        return json.dumps(told)

    @classmethod
    def of(cls, text: str) -> GoalTold:
        """From a step record."""
        told = _words(text)
        return cls(
            told.get("fault", ""),
            told.get("lost", False),
            tuple(told.get("restarted", ())),
            tuple(_request(one) for one in told.get("submitted", ())),
        )


@dataclass(frozen=True)
class Obeyed:
    """A request that the gate received through a service.

    Attributes:
        do, role, instance: Fields of the request.
        driving: Sequence number of the newest command of an operator who was driving; 0 for none.
    """

    do: Any
    role: str
    instance: str
    driving: int


@dataclass(frozen=True)
class GateTold:
    """What the gate node was told for one step.

    Attributes:
        now_ns: Live: what the platform's clock shows now.
        silent: Live: the platform is silent.
        gone: Live: a missing node without which the robot does not drive; empty for none.
        obeyed: Live: requests that came through a service since the previous step.
        contact: A contact was latched between two steps.
        warm: "role instance" of the instances that were able to take over.
        waiting: Which node waits for which stream; empty for none.
        restarted: Live: the platform restarted.
        late: Live: the goal node, if its last step is too old; otherwise empty.
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

    @property
    def text(self) -> str:
        """Text for the step record: only the fields that are set."""
        if self.now_ns is None and not self.warm and not self.waiting:
            return ""
        words = {name: value for name, value in vars(self).items() if value}
        if self.obeyed:
            words["obeyed"] = [vars(one) for one in self.obeyed]
        return json.dumps(words)

    @classmethod
    def of(cls, text: str) -> GateTold:
        """From a step record."""
        told = _words(text)
        obeyed = tuple(Obeyed(**one) for one in told.pop("obeyed", ()))
        return cls(**{**told, "obeyed": obeyed, "warm": tuple(told.get("warm", ()))})


def _words(text: str) -> dict[str, Any]:
    return dict(json.loads(text)) if text else {}


def _request_words(request: OperatorRequest) -> Mapping[str, Any]:
    goal = request.goal
    via = [] if goal is None else [[point.x, point.y] for point in goal.via]
    of_goal = None if goal is None else [goal.goal_id, goal.x, goal.y, goal.heading, via]
    return {"do": request.do, "goal": of_goal}


def _request(words: Mapping[str, Any]) -> OperatorRequest:
    goal = words["goal"]
    if goal is not None:
        number, x, y, heading, via = goal
        goal = Goal(number, x, y, heading, tuple(Point2D(*point) for point in via))
    return OperatorRequest(words["do"], goal)

"""What executors tell goal and gate beside their inputs, so that a replay can tell them the same.

It goes into their step records as the text `told`, a JSON object; empty where nothing was told. Its words stand here.
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
    """What a goal was told for one step.

    Attributes:
        fault: What broke, for which the goal ends; empty for nothing.
        lost: The platform is not heard.
        restarted: Roles whose instance came back since the step before, sorted.
        submitted: Requests that came by a service instead of a port since the step before.
    """

    fault: str = ""
    lost: bool = False
    restarted: tuple[str, ...] = ()
    submitted: tuple[OperatorRequest, ...] = ()

    @property
    def text(self) -> str:
        """As it stands in a step record."""
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
    """A request that the gate took from a service.

    Attributes:
        do, role, instance: Of the request.
        driving: Number of the newest command of an operator who drove himself then; 0 for none.
    """

    do: Any
    role: str
    instance: str
    driving: int


@dataclass(frozen=True)
class GateTold:
    """What a gate was told for one step.

    Attributes:
        now_ns: Live: what the platform's clock shows by now.
        silent: Live: the platform is not heard.
        gone: Live: the part without which the robot does not drive; empty for none.
        obeyed: Live: requests that came by a service since the step before.
        contact: A contact was latched between two steps.
        warm: "role instance" of those that were found able to take over.
        waiting: Node that waits for a stream, and which; empty for none.
    """

    now_ns: int | None = None
    silent: bool = False
    gone: str = ""
    obeyed: tuple[Obeyed, ...] = ()
    contact: bool = False
    warm: tuple[str, ...] = ()
    waiting: str = ""

    @property
    def text(self) -> str:
        """As it stands in a step record: only what differs from nothing."""
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

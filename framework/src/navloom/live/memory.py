"""What a robot must not forget when the process that knew it dies: every other process keeps it too."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import Any

from navloom.messages import Envelope, Feedback, GateStatus, Message, Parameters, Selection
from navloom.navigation.gate import ENDING, HIDING, LEFT

__all__ = ["Memory"]


@dataclass
class Memory:
    """The selection, the gate's latched stop, the goal on its way, and parameters that were changed.

    Attributes:
        epoch, selected: Of the newest selection.
        stop: (tick, why the robot stands until somebody resumes, empty where it does not).
        goal: (tick, number of the goal on its way, 0 for none).
        last_goal: Highest number of a goal so far.
        parameters: By "role instance": version and assignments.
        clock_ns: Run clock when this was written down; -1 where it was not known.
    """

    epoch: int = -1
    selected: dict[str, str] = field(default_factory=dict)
    stop: tuple[int, str] = (-1, "")
    goal: tuple[int, int] = (-1, 0)
    last_goal: int = 0
    parameters: dict[str, tuple[int, tuple[str, ...]]] = field(default_factory=dict)
    clock_ns: int = -1

    def note(self, source: tuple[str, str], message: Message, at: Envelope) -> None:
        """Remember what a message says."""
        if isinstance(message, Selection) and message.epoch >= self.epoch:
            self.epoch = message.epoch
            self.selected = message.chosen
        elif isinstance(message, GateStatus):
            self.stop = (at.tick, self._stop_of(message))
        elif isinstance(message, Feedback):
            self.goal = (at.tick, message.goal_id)
            self.last_goal = max(self.last_goal, message.goal_id)
        elif isinstance(message, Parameters):
            self.parameters[" ".join(source)] = (message.version, message.values)

    def _stop_of(self, message: GateStatus) -> str:
        """Why the robot stands until somebody resumes, by the gate's word; some words say nothing of it."""
        before = self.stop[1]
        if message.reason == ENDING:
            return before or ("operator" if message.latched else "")
        if message.reason.startswith(HIDING) and not message.latched:
            return before
        return message.reason if message.latched or message.reason.startswith(LEFT) else ""

    def to_bytes(self) -> bytes:
        """For another process."""
        return json.dumps(vars(self)).encode()

    def learn(self, data: bytes) -> None:
        """Take over what another process knows and this one does not, or not as newly."""
        try:
            other: dict[str, Any] = json.loads(data)
            if other["epoch"] > self.epoch:
                self.epoch, self.selected = int(other["epoch"]), dict(other["selected"])
            self.stop = max(self.stop, (int(other["stop"][0]), str(other["stop"][1])))
            self.goal = max(self.goal, (int(other["goal"][0]), int(other["goal"][1])))
            self.last_goal = max(self.last_goal, int(other["last_goal"]))
            self.clock_ns = max(self.clock_ns, int(other["clock_ns"]))
            for place, (version, values) in other["parameters"].items():
                known = self.parameters.get(place, (-1, ()))
                self.parameters[place] = max(known, (int(version), tuple(map(str, values))))
        except (ValueError, KeyError, TypeError, IndexError):
            return

"""State of a robot that must survive the death of a process: every process keeps a copy."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import Any

from navloom.messages import Envelope, Feedback, GateStatus, Message, Parameters, Selection

__all__ = ["Memory"]


@dataclass
class Memory:
    """The selection, the gate's latched stop, the active goal, and changed parameters.

    Attributes:
        epoch, selected: Epoch and active instances of the newest selection.
        stop: (tick, reason of a stop that lasts until `resume`; empty for none).
        goal: (tick, number of the active goal; 0 for none).
        last_goal: Highest goal number so far.
        parameters: Version and assignments, by "role instance".
        clock_ns: Run clock when this was written, ns; -1 if unknown.
    """

    epoch: int = -1
    selected: dict[str, str] = field(default_factory=dict)
    stop: tuple[int, str] = (-1, "")
    goal: tuple[int, int] = (-1, 0)
    last_goal: int = 0
    parameters: dict[str, tuple[int, tuple[str, ...]]] = field(default_factory=dict)
    clock_ns: int = -1

    def note(self, source: tuple[str, str], message: Message, at: Envelope) -> None:
        """Update the memory from a message."""
        # The first selection of a restarted gate has the epoch of the config.
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
        """Reason of a stop that lasts until `resume`, from the gate's status; some statuses leave it as it was."""
        before, why = self.stop[1], message.why
        if why is None:
            return ""
        if why.kind == "ending":
            # A gate that ends in order always says "stopped", which is no operator's stop.
            return before or ("operator" if message.latched else "")
        if why.stop.hides and not message.latched:
            # A silent platform hides why the gate was stopped before; that reason returns afterwards.
            return before
        return why.text if message.latched or why.stop.restores else ""

    def to_bytes(self) -> bytes:
        """Serialised for another process."""
        return json.dumps(vars(self)).encode()

    def learn(self, data: bytes) -> None:
        """Take over newer entries from another process's memory; malformed data is ignored."""
        try:
            other: dict[str, Any] = json.loads(data)
            if other["epoch"] > self.epoch:
                self.epoch, self.selected = int(other["epoch"]), dict(other["selected"])
            # By tick: the newer one counts, whichever process has it.
            self.stop = max(self.stop, (int(other["stop"][0]), str(other["stop"][1])))
            self.goal = max(self.goal, (int(other["goal"][0]), int(other["goal"][1])))
            self.last_goal = max(self.last_goal, int(other["last_goal"]))
            self.clock_ns = max(self.clock_ns, int(other["clock_ns"]))
            for place, (version, values) in other["parameters"].items():
                known = self.parameters.get(place, (-1, ()))
                self.parameters[place] = max(known, (int(version), tuple(map(str, values))))
        # A process of another version may keep other entries; the robot goes on without them.
        except (ValueError, KeyError, TypeError, IndexError):
            return

"""Passes the messages of a live robot to observers, on a separate thread."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence

from navloom.engine.system import System
from navloom.plugins.run_observers import Onlooker

from navloom_live.live.live_node_builder import all_sources
from navloom_live.live.mailbox import Inlet, Mailbox
from navloom_live.live.process_streams import Switchboard

__all__ = ["LiveShow"]

WAITING = 1024
"""Most messages of one stream that may wait for observers; beyond that the oldest are dropped."""
OBSERVER_END_WAIT = 2.0
"""Longest wait for an observer that still handles a message when the run has ended, s."""


class LiveShow:
    """Passes the messages of a live robot to observers. A slow or hanging observer does not delay the robot.

    Args:
        system: The robot's system.
        board: Streams of this process; connect it afterwards.
        onlookers: The observers' objects.
        is_active: Whether an instance is the active one of its role.
    """

    def __init__(
        self, system: System, board: Switchboard, onlookers: Sequence[Onlooker], is_active: Callable[[str, str], bool]
    ) -> None:
        self._is_active, self._ends = is_active, False
        self._mailbox = Mailbox()
        self._streams: list[tuple[str, str, str, Inlet, list[Onlooker]]] = []
        ports = {spec.role: spec.outputs for spec in system.specs}
        for role, name in all_sources(system):
            for port in ports[role]:
                shown = [onlooker for onlooker in onlookers if onlooker.wants is None or (role, port) in onlooker.wants]
                if shown:
                    inlet = board.inlet((role, name), port, self._mailbox, WAITING)
                    self._streams.append((role, name, port, inlet, shown))
        self._thread = threading.Thread(target=self._run, name="observers", daemon=True)
        if self._streams:
            self._thread.start()

    def close(self) -> None:
        """Pass on the messages received so far, and end."""
        self._ends = True
        self._mailbox.ring()
        if self._streams:
            self._thread.join(OBSERVER_END_WAIT)

    def _run(self) -> None:
        seen, is_last = 0, False
        while not is_last:
            is_last = self._ends
            for role, name, port, inlet, shown in self._streams:
                for message, envelope in inlet.take():
                    for onlooker in shown:
                        onlooker.on_message(role, name, self._is_active(role, name), port, message, envelope)
            if not is_last:
                seen = self._mailbox.wait(seen, None)

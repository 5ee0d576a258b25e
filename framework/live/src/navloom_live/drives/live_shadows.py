"""Compares the shadows of a live robot with its active instances during each drive, and serves the comparison."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable

from navloom.engine.difference_units import TOLERANCES
from navloom.engine.shadow_state import ShadowState
from navloom.engine.streams import FRAMEWORK_PORTS, MAP
from navloom.engine.system import System
from navloom.runs.shadow_comparison import Disagreement, ShadowWatch

from navloom_live.live.live_node_builder import all_sources
from navloom_live.live.mailbox import Inlet, Mailbox
from navloom_live.live.process_streams import Switchboard
from navloom_live.operating.shadow_report import differing_text
from navloom_live.transport.keyspace import SUPERVISOR
from navloom_live.transport.query_limits import Desk

__all__ = ["LiveShadows"]

LATE = 10
"""Ticks after which the answer of a shadow in another process counts as missing; more than two looks at the messages
take at 20 ticks per second."""
WAITING = 1024
"""Most messages of one stream that may wait for the next look."""
NOTABLE = 10.0
"""Differences that are reported as they occur, in tolerances: 0.1 m/s and 0.1 rad/s."""
REPORT_INTERVAL = 10.0
"""Shortest time between two reports on the same shadow, s."""
FEW = 20
"""Fewest compared ticks for such a report: a share of fewer says little."""
LARGE = frozenset(port.role for port in FRAMEWORK_PORTS.ports() if port.answers and port.quality is MAP)
"""Roles whose answers are not compared: each would have to be sent to this process."""

Source = tuple[str, str]


class LiveShadows:
    """Compares answers of the same tick, by the definitions of `navloom run`, since the newest goal began.

    Args:
        system: The robot.
        board: Streams of this process; `board.connect` connects them.
        is_active: Whether an instance is the active one of its role.
        say: Receives a line when a shadow begins to differ much.
    """

    def __init__(
        self, system: System, board: Switchboard, is_active: Callable[[str, str], bool], say: Callable[[str], None]
    ) -> None:
        self._board, self._is_active, self._say = board, is_active, say
        self._mailbox, self._streams = Mailbox(), list[tuple[str, str, str, Inlet]]()
        self._lock, self._told = threading.Lock(), dict[Source, float]()
        self._desk: Desk | None = None
        self._follow(system)

    def extend(self, system: System) -> None:
        """Compare an instance that the robot has gained, too."""
        with self._lock:
            before = self._watch
            self._follow(system)
            for source, one in (before.found if before is not None else {}).items():
                if self._watch is not None:
                    self._watch.found[source] = one

    def _follow(self, system: System) -> None:
        self._system, self._watch = system, self._new_watch(system)
        wanted = frozenset[tuple[str, str]]() if self._watch is None else self._watch.wants or frozenset()
        known = {(role, name, port) for role, name, port, _ in self._streams}
        for role, name in all_sources(system):
            for port in sorted(port for owner, port in wanted if owner == role):
                if (role, name, port) not in known:
                    inlet = self._board.inlet((role, name), port, self._mailbox, WAITING, rings=False)
                    self._streams.append((role, name, port, inlet))
        if self._watch is not None and self._desk is None:
            self._offer()

    @staticmethod
    def _new_watch(system: System) -> ShadowWatch | None:
        shadows: dict[str, tuple[str, ...]] = {}
        for table in system.config.alternative:
            if table.shadow and table.role not in LARGE:
                shadows[table.role] = (*shadows.get(table.role, ()), table.instance)
        return ShadowWatch(shadows, LATE, system.catalogue) if shadows else None

    def _offer(self) -> None:
        """Serve the comparison to tools."""
        self._desk, key = Desk(), self._board.keys.process(SUPERVISOR, "shadows")
        answer = self._desk.window(
            "shadows",
            lambda question: question.answer(
                key, json.dumps([state.to_json() for state in self.so_far()]).encode(), "json"
            ),
        )
        self._board.bus.serve(key, answer)

    def begin(self) -> None:
        """A goal begins: forget the comparison of the previous one."""
        with self._lock:
            self._watch = self._new_watch(self._system)

    def look(self) -> None:
        """Take the messages that have come. Call it several times a second."""
        with self._lock:
            if self._watch is None:
                return
            came = [(at.tick, role, name, port, message, at)
                    for role, name, port, inlet in self._streams for message, at in inlet.take()]  # fmt: skip
            for _, role, name, port, message, at in sorted(came, key=lambda one: one[0]):
                self._watch.on_message(role, name, self._is_active(role, name), port, message, at)
            found = list(self._watch.found.values()) if came else []
        for one in found:
            self._tell(one)

    def so_far(self) -> list[ShadowState]:
        """State of the comparison of each shadow, see `Disagreement.so_far`. From any thread."""
        with self._lock:
            found = [] if self._watch is None else list(self._watch.found.values())
            return [one.so_far() for one in found if not self._is_active(one.role, one.instance)]

    def finish(self) -> list[Disagreement]:
        """The comparisons of the drive that has ended."""
        with self._lock:
            return [] if self._watch is None else self._watch.finish()

    def _tell(self, disagreement: Disagreement) -> None:
        """Report a large difference, now and then."""
        now, last = time.monotonic(), {name: values[-1] for name, values in disagreement.values.items()}
        is_notable = any(abs(value) > NOTABLE * TOLERANCES[name] for name, value in last.items())
        if len(disagreement.ticks) < FEW or not is_notable or self._is_active(disagreement.role, disagreement.instance):
            return
        if now - self._told.get((disagreement.role, disagreement.instance), -REPORT_INTERVAL) >= REPORT_INTERVAL:
            self._told[disagreement.role, disagreement.instance] = now
            self._say(f"{disagreement.role} {disagreement.instance} {differing_text(disagreement.so_far())}")

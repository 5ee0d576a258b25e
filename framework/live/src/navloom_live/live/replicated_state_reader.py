"""Every process follows the run clock and the state that must outlive any single process."""

from __future__ import annotations

from collections.abc import Callable

from navloom.engine.system import System
from navloom.messages import Odometry

from navloom_live.live.mailbox import Inlet, Mailbox
from navloom_live.live.process_streams import Switchboard
from navloom_live.live.replicated_state import Memory
from navloom_live.live.run_clock import RunClock
from navloom_live.timing import CLOCK_READ_INTERVAL

__all__ = ["MemoryReader"]


class MemoryReader:
    """Reads the streams from which a process keeps its run clock and its memory.

    Args:
        system: The robot.
        board: Streams of the process.
        clock, memory: Updated from the streams; without a clock the platform is not read.
        wake: Called with each "role instance" of a pending swap.
        ends: Whether the process is ending.
    """

    def __init__(
        self,
        system: System,
        board: Switchboard,
        clock: RunClock | None,
        memory: Memory,
        wake: Callable[[str], None],
        ends: Callable[[], bool],
    ) -> None:
        self._clock, self._memory, self._wake, self._ends = clock, memory, wake, ends
        self._board = board
        self._mailbox = Mailbox()
        streams = [(("gate", "main"), "selection"), (("gate", "main"), "status"), (("goal", "main"), "feedback")]
        if clock is not None:
            streams.append((("platform", system.config.platform.instance), "odometry"))
        streams += [(source, "parameters") for source in system.parts]
        self._inlets: list[tuple[tuple[str, str], Inlet]] = [
            (source, _inlet(board, source, port, self._mailbox)) for source, port in streams
        ]

    def follow(self, source: tuple[str, str]) -> None:
        """Read the parameters of an instance that was added to the robot, too, once the board connects them."""
        self._inlets.append((source, _inlet(self._board, source, "parameters", self._mailbox)))

    def run(self) -> None:
        """Read until the process ends."""
        seen = 0
        while not self._ends():
            seen = self._mailbox.wait(seen, CLOCK_READ_INTERVAL)
            for source, inlet in self._inlets:
                for message, envelope in inlet.take():
                    if isinstance(message, Odometry) and self._clock is not None:
                        self._clock.observe(envelope.stamp_ns, inlet.arrived_ns, envelope.tick)
                    else:
                        # A waiting instance does not step, so that its own runner reads nothing.
                        for entry in getattr(message, "pending", ()):
                            self._wake(entry)
                        self._memory.note(source, message, envelope)


def _inlet(board: Switchboard, source: tuple[str, str], port: str, mailbox: Mailbox) -> Inlet:
    """The inlet of one stream. For odometry the newest message is enough, and it does not wake the thread."""
    is_clock = port == "odometry"
    return board.inlet(source, port, mailbox, 1 if is_clock else 16, rings=not is_clock)
